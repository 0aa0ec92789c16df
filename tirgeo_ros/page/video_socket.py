"""Send one aircraft's video to one viewer."""

from __future__ import annotations

import asyncio
import socket
import struct
import time
from collections import deque
from statistics import median

from aiohttp import WSMsgType, web

from tirgeo_ros.page.limits import Allowance
from tirgeo_ros.page.pace import Pace
from tirgeo_ros.page.video_feed import Picture, VideoFeed

#: stamp_ns, sent_ns, number, width, height; the JPEG follows.
HEADER = struct.Struct("<QQIHH")
#: What a page that lies about what it has drawn can make the kernel hold.
_KERNEL_BUFFER = 256 * 1024
_ANSWERS_A_S = 150.0
_AGES = 30  # pictures over which an age is taken
_SENT = 3  # pictures of which one may be on the screen: two unanswered, and the one before


class VideoViewer:
    """Be one WebSocket's video; ``who`` is the session or address behind it."""

    def __init__(self, feed: VideoFeed, socket_: web.WebSocketResponse, who: str) -> None:
        self.who = who
        self._feed, self._socket = feed, socket_
        self._pace = Pace()
        self._news = asyncio.Event()  # a picture, or an answer
        self._ages_ms: deque[float] = deque(maxlen=_AGES)
        self._sent: dict[int, Picture] = {}  # by number, the newest _SENT

    @property
    def latency_ms(self) -> float | None:
        """Return the time from taking a picture to its being on the screen, lately."""
        return median(self._ages_ms) if self._ages_ms else None

    async def run(self) -> None:
        """Send pictures and take answers until the peer leaves."""
        sending = asyncio.create_task(self._send())
        self._feed.wake(self._news.set)
        try:
            await self._take_answers()
        finally:
            self._feed.forget(self._news.set)
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
                continue
            self._news.clear()
            await self._news.wait()

    async def _send_one(self, picture: Picture) -> None:
        jpeg = await self._feed.bytes_at(picture, self._pace.level)
        head = HEADER.pack(
            max(picture.stamp_ns, 0),
            time.time_ns(),
            picture.number & 0xFFFFFFFF,
            picture.width,
            picture.height,
        )
        self._pace.sent(picture.number, time.monotonic())
        self._sent[picture.number] = picture
        if len(self._sent) > _SENT:
            del self._sent[min(self._sent)]
        await self._socket.send_bytes(head + jpeg)

    async def _take_answers(self) -> None:
        """Take ``shown NUMBER``; what else a page says ends the connection."""
        allowance = Allowance(_ANSWERS_A_S, _ANSWERS_A_S)
        async for message in self._socket:
            word, _, number = str(message.data).partition(" ")
            right = message.type is WSMsgType.TEXT and word == "shown" and _is_number(number)
            if not right or not allowance.take(time.monotonic()):
                await self._socket.close(code=1008, message=b"only shown NUMBER, once for each")
                return
            self._shown(int(number))
            await asyncio.sleep(0)  # a flood must not hold up the others

    def _shown(self, number: int) -> None:
        if not self._pace.shown(number, time.monotonic()):
            return
        age_ms = (time.time_ns() - self._sent[number].begun_ns) * 1e-6
        self._ages_ms.append(age_ms)
        self._news.set()


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= 10


def bound_kernel_buffer(request: web.Request) -> None:
    """Keep the kernel from growing the buffer of what is sent."""
    own = request.transport.get_extra_info("socket") if request.transport else None
    if own is not None:
        own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_BUFFER)
