"""Hold one aircraft's newest pictures, as they came and smaller; all on the server's loop."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass

import cv2
import numpy as np

from tirgeo_ros.io.files.encoded_picture import MOST_OF_VIDEO, size_of
from tirgeo_ros.page.pace import LEVELS

_KEPT, _KEPT_BYTES = 100, 16 * 2**20  # pictures to cut targets out of: three seconds
_HELD = 30  # pictures that were the last on somebody's screen: he may press on one for long
_CUT_HALF = 80  # pixels: half a cut-out's side
_LOG = logging.getLogger("tirgeo.page")
_REDUCED = {
    1: cv2.IMREAD_COLOR,
    2: cv2.IMREAD_REDUCED_COLOR_2,
    4: cv2.IMREAD_REDUCED_COLOR_4,
}


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
    """Take pictures in, wake who waits for one, and make smaller ones once for all who want them.

    Pictures are made smaller on ``workers``, one thread: then viewers of slow links take nothing
    from the others.
    """

    def __init__(self, workers: Executor) -> None:
        self.newest: Picture | None = None
        self.damaged = 0
        self._workers = workers
        self._kept: deque[Picture] = deque(maxlen=_KEPT)
        self._kept_bytes = 0
        self._held: deque[Picture] = deque(maxlen=_HELD)
        self._smaller: dict[int, asyncio.Future[bytes]] = {}  # by level, of the newest alone
        self._waking: set[Callable[[], None]] = set()

    def show(self, stamp_ns: int, begun_ns: int, jpeg: bytes) -> None:
        """Take the newest picture; one that is no JPEG of a video is counted, the first said."""
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
        self._keep(self.newest)
        for wake in self._waking:
            wake()

    def wake(self, call: Callable[[], None]) -> None:
        """Call at each picture."""
        self._waking.add(call)

    def forget(self, call: Callable[[], None]) -> None:
        """Call no more."""
        self._waking.discard(call)

    def hold(self, pictures: Iterable[Picture]) -> None:
        """Keep pictures for targets: those that a page had last when it stopped the video."""
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
        """Return what a thread calls for a JPEG around a pixel; None of a picture not kept."""
        every = (*self._kept, *self._held)
        found = next((one for one in every if one.stamp_ns == stamp_ns), None)
        return lambda: _cut_out(found, u, v) if found else None

    def _keep(self, picture: Picture) -> None:
        if len(self._kept) == _KEPT:
            self._kept_bytes -= len(self._kept.popleft().jpeg)
        self._kept.append(picture)
        self._kept_bytes += len(picture.jpeg)
        while self._kept_bytes > _KEPT_BYTES and len(self._kept) > 1:
            self._kept_bytes -= len(self._kept.popleft().jpeg)


def _smaller(jpeg: bytes, level: int) -> bytes:
    divisor, quality, _ = LEVELS[level]
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), _REDUCED[divisor])
    made = image is not None and cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    small: bytes = made[1].tobytes() if made else jpeg
    return min(small, jpeg, key=len)


def _cut_out(picture: Picture, u: float, v: float) -> bytes | None:
    image = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        return None
    left, top = (max(0, round(at) - _CUT_HALF) for at in (u, v))
    part = image[top : top + 2 * _CUT_HALF, left : left + 2 * _CUT_HALF]
    if not part.size:
        return None
    made: bytes = cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    return made
