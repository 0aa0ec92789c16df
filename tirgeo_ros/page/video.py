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
import socket
import struct
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor
from statistics import median
from typing import NamedTuple

import cv2
import numpy as np
from aiohttp import WSMsgType, web

from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.io.messages.pictures import MOST_OF_VIDEO, size_of
from tirgeo_ros.io.messages.shapes_codec import coarser
from tirgeo_ros.page.connections import Allowance
from tirgeo_ros.page.pace import LEVELS, Pace
from tirgeo_ros.page.picture_ring import Picture, PictureRing

_BACK_NS, _STEP_NS = 120_000_000_000, 100_000_000  # of the pictures to go back to
_COARSE_BYTES = 5000  # of the shapes of a smaller picture
_CUT_HALF = 80  # pixels: half a cut-out's side
#: stamp_ns, sent_ns, number, width, height, bytes of the shapes; the shapes and the JPEG follow.
HEADER = struct.Struct("<QQIHHI")
#: Limit of the kernel's buffer, for a page that reports pictures as shown without reading them.
_KERNEL_BUFFER = 256 * 1024
_ANSWERS_A_S = 150.0
_AGES = 30  # pictures over which an age is taken
_SENT = 5  # pictures that may be answered yet
_LOG = logging.getLogger("tirgeo.page")


class Sizes(NamedTuple):
    """Hold the bytes of a picture at one level."""

    shapes: bytes
    jpeg: bytes


class VideoFeed:
    """Take pictures, wake the viewers that wait for one, and make each smaller size once for all.

    Pictures are made smaller on ``workers``, one thread, so that viewers on slow links do not slow
    down the others. ``kept_bytes`` limits the pictures that are kept, to go back to.
    """

    def __init__(self, workers: Executor, kept_bytes: int) -> None:
        self.newest: Picture | None = None
        self.damaged = 0
        self._workers = workers
        self.kept = PictureRing(kept_bytes)
        self._smaller: dict[int, asyncio.Future[Sizes]] = {}  # by level, of the newest alone
        self.waking: set[Callable[[], None]] = set()  # called at each picture

    def show(self, stamp_ns: int, begun_ns: int, jpeg: bytes, shapes: bytes = b"") -> None:
        """Take the newest picture; count data that are no JPEG of a video, and log the first."""
        width, height = size_of(jpeg, ("JPEG",))
        if not 0 < width * height <= MOST_OF_VIDEO:
            if not self.damaged:
                most = f"{MOST_OF_VIDEO * 1e-6:.1f} million pixels"
                _LOG.warning("a picture that is no JPEG of up to %s is not shown", most)
            self.damaged += 1
            return
        number = self.newest.number + 1 if self.newest else 1
        self.newest = Picture(number, stamp_ns, begun_ns, jpeg, shapes, width, height)
        self._smaller = {}
        was_kept = not self.kept.fault
        self.kept.add(self.newest)
        if was_kept and self.kept.fault:
            _LOG.warning("no pictures are kept to go back to: %s", self.kept.fault)
        for wake in self.waking:
            wake()

    async def bytes_at(self, picture: Picture, level: int) -> Sizes:
        """Return a picture at a level; never more bytes than it has."""
        if LEVELS[level].quality == 0:
            return Sizes(picture.shapes, picture.jpeg)
        work = asyncio.get_running_loop().run_in_executor
        if picture is not self.newest:
            return await work(self._workers, _smaller, picture, level)
        if level not in self._smaller:
            self._smaller[level] = work(self._workers, _smaller, picture, level)
        return await asyncio.shield(self._smaller[level])

    def stamps_ns(self) -> list[int]:
        """Return the stamps to go back to: of the last 120 s, at most ten a second."""
        kept = self.kept.stamps_ns()
        stamps = kept[-1:]
        for stamp in reversed(kept):
            # A stamp that goes back is of the flight before.
            if not 0 <= stamps[0] - stamp <= _BACK_NS or stamp > stamps[-1]:
                break
            if stamps[-1] - stamp >= _STEP_NS:
                stamps.append(stamp)
        return stamps[::-1]

    def cut_out(self, stamp_ns: int, u: float, v: float) -> Callable[[], bytes | None]:
        """Return a function that makes a JPEG around a pixel, None if the picture is dropped."""
        picture = self.kept.get(stamp_ns)
        return lambda: _cut_out(picture, u, v) if picture else None


def message_of(picture: Picture, sizes: Sizes) -> bytes:
    """Return the bytes of a picture for the page."""
    stamp_ns, number = max(picture.stamp_ns, 0), picture.number & 0xFFFFFFFF
    size = picture.width, picture.height
    head = HEADER.pack(stamp_ns, time.time_ns(), number, *size, len(sizes.shapes))
    return b"".join((head, *sizes))


def _smaller(picture: Picture, level: int) -> Sizes:
    divisor, quality, _, is_coarse = LEVELS[level]
    small, jpeg = picture.jpeg, np.frombuffer(picture.jpeg, np.uint8)
    image = cv2.imdecode(jpeg, cv2.IMREAD_UNCHANGED)
    if image is not None:  # grey stays grey
        size = picture.width // divisor, picture.height // divisor
        image = image if divisor == 1 else cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        small = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    shapes = _coarse(picture.shapes) if is_coarse else picture.shapes
    return Sizes(shapes, min(small, picture.jpeg, key=len))


def _coarse(shapes: bytes) -> bytes:
    try:
        return coarser(shapes, _COARSE_BYTES)
    except MessageError:  # no map rather than one that was not meant
        return b""


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
        self._begun_ns: dict[int, int] = {}  # by number, the newest _SENT

    @property
    def latency_ms(self) -> float | None:
        """Return the median time from taking a picture to showing it, of the newest ones."""
        return median(self._ages_ms) if self._ages_ms else None

    async def run(self) -> None:
        """Send pictures and take answers until the peer leaves."""
        sending = asyncio.create_task(self._send_or_close())
        self._feed.waking.add(self._news.set)
        try:
            await self._take_answers()
        finally:
            self._feed.waking.discard(self._news.set)
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _send_or_close(self) -> None:
        """Send pictures; if that fails, close the connection: the page then opens another."""
        try:
            await self._send()
        except ConnectionError:
            return  # the peer has left
        except Exception:  # noqa: BLE001 whatever it is, the viewer waits for pictures
            _LOG.exception("a viewer's video begins anew: a fault in this program")
            await self._socket.close(code=1011, message=b"a fault in this program")

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
        message = message_of(picture, await self._feed.bytes_at(picture, self._pace.level))
        self._pace.sent(picture.number, len(message), time.monotonic())
        self._begun_ns[picture.number] = picture.begun_ns
        if len(self._begun_ns) > _SENT:
            del self._begun_ns[min(self._begun_ns)]
        await self._socket.send_bytes(message)

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
                age_ns = time.time_ns() - self._begun_ns[int(number)]
                self._ages_ms.append(age_ns * 1e-6)
                self._news.set()
            await asyncio.sleep(0)  # a flood must not delay the others


def bound_kernel_buffer(request: web.Request) -> None:
    """Keep the kernel from growing its buffer of bytes to send."""
    own = request.transport.get_extra_info("socket") if request.transport else None
    if own is not None:
        own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_BUFFER)
