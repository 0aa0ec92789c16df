# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Send the video: each aircraft's newest pictures, as fast and large as a viewer's link allows."""

from __future__ import annotations

import asyncio
import logging
import math
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

import cv2
import numpy as np
from aiohttp import WSMsgType, web

from tirgeo_ros.io.messages.pictures import MOST_OF_VIDEO, size_of
from tirgeo_ros.page.connections import Allowance

_FIRST = 4  # index into LEVELS
#: Most pictures on the way to a screen, and only one while their bytes alone take longer than
#: _ALONE_S: on a slow link a second would wait for the first, and be old when it arrives.
_UNANSWERED, _ALONE_S = 2, 0.08
_LOST_S = 3.0  # then a picture counts as answered: the page may have failed on it
#: A trip lasts from sending a picture to its answer. Trips above _LONG_S make pictures smaller,
#: trips below _SHORT_S larger; the new size aims at _WANTED_S, or surely at _SURE_S.
_LONG_S, _SHORT_S, _WANTED_S, _SURE_S = 0.28, 0.16, 0.2, 0.1
_VERY_LONG_S, _IN_SUCCESSION = 0.6, 2  # one long trip alone may be a hiccup
_READABLE = 5  # smallest size that shows a person; smaller ones only for very long trips
#: Periods of trying a larger size; it has failed if trips are long within _SOON_S.
_PROBE_S, _RAREST_PROBE_S, _SOON_S = 1.0, 32.0, 3.0
_KEPT_BYTES = 16 * 2**20  # of pictures to cut targets out of: five seconds
_HELD = 30  # last pictures of stopped videos: an operator may still press on them
_CUT_HALF = 80  # pixels: half a cut-out's side
_REDUCED = {1: cv2.IMREAD_COLOR, 2: cv2.IMREAD_REDUCED_COLOR_2, 4: cv2.IMREAD_REDUCED_COLOR_4}
#: stamp_ns, sent_ns, number, width, height; the JPEG follows.
HEADER = struct.Struct("<QQIHH")
#: Limit of the kernel's buffer, for a page that reports pictures as shown without reading them.
_KERNEL_BUFFER = 256 * 1024
_ANSWERS_A_S = 150.0
_AGES = 30  # pictures over which an age is taken
_SENT = 3  # pictures that may be on the screen: two unanswered, and the one before
_LOG = logging.getLogger("tirgeo.page")


class Level(NamedTuple):
    """Hold one size of picture."""

    divisor: int  # of width and height: 1, 2 or 4
    quality: int  # of the JPEG; 0: the bytes as they came
    share: float  # of the original bytes, as measured on overlays of 640 x 512


#: From the original picture down; each has about two thirds of the bytes of the one before.
LEVELS = (
    Level(1, 0, 1.0),
    Level(1, 60, 0.68),
    Level(1, 30, 0.46),
    Level(2, 75, 0.28),
    Level(2, 50, 0.19),
    Level(2, 25, 0.125),
    Level(4, 80, 0.08),
    Level(4, 50, 0.048),
)


class Pace:
    """Choose the size of pictures for one viewer, by the time until each is on the screen."""

    def __init__(self) -> None:
        self.level = _FIRST
        self._on_the_way: dict[int, tuple[float, int]] = {}  # number -> sent at, level
        self._probe_at_s, self._probe_every_s = 0.0, _PROBE_S
        self._probed_s = -math.inf
        self._trip_s = 0.0  # of the last picture
        self._least_s: dict[int, float] = {}  # shortest trip by level
        self._long = 0  # trips in succession

    def may_send(self, now_s: float) -> bool:
        """Return whether a picture may be sent."""
        self._forget(lambda _, sent_s: now_s - sent_s > _LOST_S)
        return len(self._on_the_way) < (1 if self._transfer_s() > _ALONE_S else _UNANSWERED)

    def sent(self, number: int, now_s: float) -> None:
        """Record that a picture is sent at the present level."""
        self._on_the_way[number] = now_s, self.level

    def shown(self, number: int, now_s: float) -> bool:
        """Record that a picture is on the screen; return whether it was waiting for this answer.

        Pictures sent before it count as answered too.
        """
        if number not in self._on_the_way:
            return False
        sent_s, level = self._on_the_way[number]
        self._forget(lambda other, _: other <= number)
        self._trip_s = now_s - sent_s
        self._least_s[level] = min(self._trip_s, self._least_s.get(level, math.inf))
        if level != self.level:
            return True  # its size is no longer sent
        self._long = self._long + 1 if self._trip_s > _LONG_S else 0
        if self._long >= _IN_SUCCESSION or self._trip_s > _VERY_LONG_S:
            self._shrink(self._trip_s, now_s)
        elif self._trip_s < _SHORT_S and self.level > 0:
            self._grow(self._trip_s, now_s)
        return True

    def _transfer_s(self) -> float:
        """Return how long (s) the bytes of the last trip took, by trips of smaller pictures."""
        smaller = [n for n in self._least_s if n > self.level]
        if not smaller or self.level not in self._least_s:
            return self._trip_s
        least = max(smaller)
        more_s = self._least_s[self.level] - self._least_s[least]
        return more_s / (1 - LEVELS[least].share / LEVELS[self.level].share)

    def _forget(self, which: Callable[[int, float], bool]) -> None:
        sent = self._on_the_way.items()
        self._on_the_way = {number: at for number, at in sent if not which(number, at[0])}

    def _shrink(self, trip_s: float, now_s: float) -> None:
        """Take the level whose trip is short enough if trips are proportional to the bytes."""
        share = LEVELS[self.level].share * _WANTED_S / trip_s
        least = len(LEVELS) - 1 if trip_s > _VERY_LONG_S else max(_READABLE, self.level)
        fitting = (n for n, level in enumerate(LEVELS) if level.share <= share)
        self.level = min(max(next(fitting, least), self.level + 1), least)
        failed = now_s - self._probed_s < _SOON_S  # the link carries no more: try less often
        self._probe_every_s = min(self._probe_every_s * 2, _RAREST_PROBE_S) if failed else _PROBE_S
        self._long, self._probed_s = 0, -math.inf
        self._probe_at_s = now_s + self._probe_every_s

    def _grow(self, trip_s: float, now_s: float) -> None:
        """Take the best level whose trip is surely short; from time to time try the next one."""
        share = LEVELS[self.level].share * _SURE_S / trip_s
        best = next(n for n, level in enumerate(LEVELS) if level.share <= share or n == self.level)
        if best < self.level:
            self.level = best
        elif now_s >= self._probe_at_s:
            self.level -= 1
            self._probed_s = now_s
            self._probe_at_s = now_s + self._probe_every_s


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Hold one picture of the video."""

    number: int  # 1, 2, ... since the start
    stamp_ns: int
    begun_ns: int  # server's clock: when the picture was taken
    jpeg: bytes
    width: int
    height: int


class VideoFeed:
    """Take pictures, wake the viewers that wait for one, and make each smaller size once for all.

    Pictures are made smaller on ``workers``, one thread, so that viewers on slow links do not slow
    down the others.
    """

    def __init__(self, workers: Executor) -> None:
        self.newest: Picture | None = None
        self.damaged = 0
        self._workers = workers
        self._kept: deque[Picture] = deque()
        self._kept_bytes = 0
        self._held: deque[Picture] = deque(maxlen=_HELD)
        self._smaller: dict[int, asyncio.Future[bytes]] = {}  # by level, of the newest alone
        self.waking: set[Callable[[], None]] = set()  # called at each picture

    def show(self, stamp_ns: int, begun_ns: int, jpeg: bytes) -> None:
        """Take the newest picture; count data that are no JPEG of a video, and log the first."""
        width, height = size_of(jpeg, ("JPEG",))
        if not 0 < width * height <= MOST_OF_VIDEO:
            if not self.damaged:
                most = f"{MOST_OF_VIDEO * 1e-6:.1f} million pixels"
                _LOG.warning("a picture that is no JPEG of up to %s is not shown", most)
            self.damaged += 1
            return
        number = self.newest.number + 1 if self.newest else 1
        self.newest = Picture(number, stamp_ns, begun_ns, jpeg, width, height)
        self._smaller = {}
        self._kept.append(self.newest)
        self._kept_bytes += len(jpeg)
        while self._kept_bytes > _KEPT_BYTES and len(self._kept) > 1:
            self._kept_bytes -= len(self._kept.popleft().jpeg)
        for wake in self.waking:
            wake()

    def hold(self, pictures: Iterable[Picture]) -> None:
        """Keep the pictures that a page had last when its video stopped, to cut out targets."""
        self._held.extend(pictures)

    async def bytes_at(self, picture: Picture, level: int) -> bytes:
        """Return the JPEG at a level; never more bytes than the picture has."""
        if LEVELS[level].quality == 0:
            return picture.jpeg
        work = asyncio.get_running_loop().run_in_executor
        if picture is not self.newest:
            return await work(self._workers, _smaller, picture.jpeg, level)
        if level not in self._smaller:
            self._smaller[level] = work(self._workers, _smaller, picture.jpeg, level)
        return await asyncio.shield(self._smaller[level])

    def cut_out(self, stamp_ns: int, u: float, v: float) -> Callable[[], bytes | None]:
        """Return a function that makes a JPEG around a pixel, None if the picture is dropped."""
        every = (*self._kept, *self._held)
        picture = next((picture for picture in every if picture.stamp_ns == stamp_ns), None)
        return lambda: _cut_out(picture, u, v) if picture else None


def _smaller(jpeg: bytes, level: int) -> bytes:
    divisor, quality, _ = LEVELS[level]
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), _REDUCED[divisor])
    coded = image is not None and cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    small: bytes = coded[1].tobytes() if coded else jpeg
    return min(small, jpeg, key=len)


def _cut_out(picture: Picture, u: float, v: float) -> bytes | None:
    image = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        return None
    left, top = (max(0, round(at) - _CUT_HALF) for at in (u, v))
    part = image[top : top + 2 * _CUT_HALF, left : left + 2 * _CUT_HALF]
    if not part.size:
        return None
    coded: bytes = cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    return coded


class VideoViewer:
    """Send the video to one WebSocket; ``who`` is the session or address behind it."""

    def __init__(self, feed: VideoFeed, socket_: web.WebSocketResponse, who: str) -> None:
        self.who = who
        self._feed, self._socket = feed, socket_
        self._pace = Pace()
        self._news = asyncio.Event()  # a picture, or an answer
        self._ages_ms: deque[float] = deque(maxlen=_AGES)
        self._sent: dict[int, Picture] = {}  # by number, the newest _SENT

    @property
    def latency_ms(self) -> float | None:
        """Return the median time from taking a picture to showing it, of the newest ones."""
        return median(self._ages_ms) if self._ages_ms else None

    async def run(self) -> None:
        """Send pictures and take answers until the peer leaves."""
        sending = asyncio.create_task(self._send())
        self._feed.waking.add(self._news.set)
        try:
            await self._take_answers()
        finally:
            self._feed.waking.discard(self._news.set)
            self._feed.hold(self._sent.values())
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _send(self) -> None:
        last = 0
        while True:
            newest = self._feed.newest
            if newest and newest.number != last and self._pace.may_send(time.monotonic()):
                last = newest.number
                await self._send_one(newest)
            else:
                self._news.clear()
                await self._news.wait()

    async def _send_one(self, picture: Picture) -> None:
        jpeg = await self._feed.bytes_at(picture, self._pace.level)
        stamp_ns, number = max(picture.stamp_ns, 0), picture.number & 0xFFFFFFFF
        head = HEADER.pack(stamp_ns, time.time_ns(), number, picture.width, picture.height)
        self._pace.sent(picture.number, time.monotonic())
        self._sent[picture.number] = picture
        if len(self._sent) > _SENT:
            del self._sent[min(self._sent)]
        await self._socket.send_bytes(head + jpeg)

    async def _take_answers(self) -> None:
        """Take ``shown NUMBER``; any other message of the page ends the connection."""
        allowance = Allowance(_ANSWERS_A_S, _ANSWERS_A_S)
        async for message in self._socket:
            word, _, number = str(message.data).partition(" ")
            is_number = number.isascii() and number.isdigit() and len(number) <= 10
            valid = message.type is WSMsgType.TEXT and word == "shown" and is_number
            if not valid or not allowance.take(time.monotonic()):
                await self._socket.close(code=1008, message=b"only shown NUMBER, once for each")
                return
            if self._pace.shown(int(number), time.monotonic()):
                age_ns = time.time_ns() - self._sent[int(number)].begun_ns
                self._ages_ms.append(age_ns * 1e-6)
                self._news.set()
            await asyncio.sleep(0)  # a flood must not delay the others


def bound_kernel_buffer(request: web.Request) -> None:
    """Keep the kernel from growing its buffer of bytes to send."""
    own = request.transport.get_extra_info("socket") if request.transport else None
    if own is not None:
        own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_BUFFER)
