"""Decode, paint and encode pictures in the order in which they come, beside the other work.

A picture's place in the output, its pose, its words and what is counted are decided before. Then
painting needs only the pictures before it, and is done by one process; a thread of that encodes.
"""

from __future__ import annotations

import mmap
import os
import pickle
import sys
import traceback
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import IO, Any, NamedTuple, final

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.overlay.picture_painter import PicturePainter, Scene, Unpainted
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels
from tirgeo_ros.core.types.errors import PictureError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess, parent_pipes

#: A picture of 4K in colour. What is not used takes no memory.
_SLOT_BYTES = 25 << 20


class Place(NamedTuple):
    """Hold where an array is."""

    slot: int
    shape: tuple[int, ...]
    dtype: str


class SharedSlots:
    """Hold the newest ``number`` arrays; the next one takes the place of the oldest.

    ``descriptor`` is that of the memory, for ``SharedSlots(number, descriptor)`` in the child.
    """

    def __init__(self, number: int, descriptor: int | None = None) -> None:
        """Make the memory, or map what another process has made (Linux). Raises OSError."""
        self.descriptor = _made(number * _SLOT_BYTES) if descriptor is None else descriptor
        self._memory = mmap.mmap(self.descriptor, number * _SLOT_BYTES)
        self.number, self._next = number, 0

    def put(self, array: npt.NDArray[Any]) -> Place | None:
        """Copy an array of any shape; return its place, None if it is too large for one."""
        if array.nbytes > _SLOT_BYTES:
            return None
        place = Place(self._next, array.shape, array.dtype.str)
        self._next = (self._next + 1) % self.number
        self.get(place)[...] = array
        return place

    def get(self, place: Place) -> npt.NDArray[Any]:
        """Return the array at a place, which changes when another one is put there."""
        offset = place.slot * _SLOT_BYTES
        return np.ndarray(place.shape, np.dtype(place.dtype), self._memory, offset)

    def close(self) -> None:
        """Free the memory, once nobody uses its arrays."""
        os.close(self.descriptor)


def shared_slots(number: int) -> SharedSlots | None:
    """Return new slots; None where the system gives none, as under ``ulimit -f``."""
    try:
        return SharedSlots(number)
    except OSError:
        return None


def _made(size: int) -> int:
    descriptor = os.memfd_create("tirgeo")
    try:
        os.ftruncate(descriptor, size)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


_RUN = "from tirgeo_ros.tools.replay.picture_stage import main; main()"
_ELSEWHERE = np.empty((0, 0), np.uint8)
#: Pictures that are decoded ahead: those of a video in one block of messages, and a few megabytes.
_MOST_AHEAD = 8
#: A thread that has decoded gets the interpreter back within this, s, not only after 5 ms.
SWITCH_S = 5e-4


class Painted(NamedTuple):
    """Hold a finished picture as it is written."""

    jpeg: bytes
    image: Pixels | None  # (h, w, 3) BGR, where it was asked for
    outline_n: Array | None  # its footprint (N, 3), NED, m, where it was asked for


class _Order(NamedTuple):
    picture: Unpainted
    scene: Scene | None  # if it is another one than before
    with_outline: bool


class _Common(NamedTuple):
    """Hold what all pictures have in common."""

    config: OverlayConfig
    ground: Ground | None
    keeps_images: bool


class _Work:
    """Paint pictures, then encode them; the two may be done in two threads."""

    def __init__(self, common: _Common) -> None:
        config, ground, self._keeps_images = common
        terrain = ground if isinstance(ground, Terrain) else None
        self._painter = PicturePainter(config, (), terrain)
        self._quality = [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality]

    def painted(self, order: _Order) -> tuple[Pixels, Array | None]:
        if order.scene is not None:
            self._painter.set_scene(order.scene)
        result = self._painter.paint(order.picture)
        outline_n = self._painter.footprint(result.pose) if order.with_outline else None
        return result.image, outline_n

    def encoded(self, image: Pixels, outline_n: Array | None) -> Painted:
        jpeg = cv2.imencode(".jpg", image, self._quality)[1].tobytes()
        return Painted(jpeg, image if self._keeps_images else None, outline_n)


class _Here:
    """Paint pictures as they are sent."""

    most_under_way = 0

    def __init__(self) -> None:
        self._work: _Work
        self._done: deque[Painted] = deque()

    def begin(self, common: _Common) -> None:
        self._work = _Work(common)

    def send(self, order: _Order) -> None:
        self._done.append(self._work.encoded(*self._work.painted(order)))

    def receive(self) -> Painted:
        return self._done.popleft()

    def close(self) -> None:
        """Do nothing: there is nothing to end."""


class _Beside:
    """Paint pictures in a process of their own; their pixels go there through shared memory."""

    most_under_way = 8  # enough that neither side waits for the other's slower ones

    def __init__(self) -> None:
        # One more when it is sent, and one that is just being painted.
        self._slots = shared_slots(self.most_under_way + 2)
        self._memory = (self._slots.number, self._slots.descriptor) if self._slots else ()
        self._child = ChildProcess(_RUN, self._memory[1:])

    def begin(self, common: _Common) -> None:
        # It reads an elevation model itself, while the first messages are read here.
        self._send((common._replace(ground=None), *self._memory))

    def send(self, order: _Order) -> None:
        place = self._slots.put(order.picture.pixels) if self._slots else None
        if place is not None:
            order = order._replace(picture=replace(order.picture, pixels=_ELSEWHERE))
        self._send((order, place))

    def receive(self) -> Painted:
        with _explained():
            painted = self._child.receive()
        assert isinstance(painted, Painted)
        return painted

    def _send(self, thing: object) -> None:
        with _explained():
            self._child.send(thing)

    def close(self) -> None:
        self._child.close()
        if self._slots is not None:
            self._slots.close()


@final
class PictureStage:
    """Paint pictures here, or in a process of their own if there are several cores.

    This is a context manager; call ``begin`` once, then ``send``, and ``receive`` once for each
    picture sent; at most ``most_under_way`` may be sent and not received. ``decoder`` decodes.
    """

    def __init__(self, cores: int) -> None:
        """Start the process, if there is one: it loads its modules meanwhile."""
        self.decoder = PictureDecoder(cores)
        self._painter: _Here | _Beside = _Beside() if cores > 1 else _Here()
        self.most_under_way = self._painter.most_under_way
        self._scene = Scene()

    def begin(self, config: OverlayConfig, ground: Ground, *, keeps_images: bool) -> None:
        """Take what all pictures have in common; ``keeps_images``: return their pixels too."""
        self._painter.begin(_Common(config, ground, keeps_images))

    def send(self, picture: Unpainted, scene: Scene, *, with_outline: bool) -> None:
        """Give a picture to be painted, in its scene. Raises PictureError if that has failed."""
        self._painter.send(_Order(picture, self._changed(scene), with_outline))

    def receive(self) -> Painted:
        """Return the oldest picture that was sent. Raises PictureError if painting failed."""
        return self._painter.receive()

    def _changed(self, scene: Scene) -> Scene | None:
        """Return the scene without a map that is there already; None if it is the one before."""
        before, self._scene = self._scene, scene
        if all(new is old for new, old in zip(scene, before, strict=True)):
            return None
        return scene._replace(draped=None) if scene.draped is before.draped else scene

    def __enter__(self) -> PictureStage:
        return self

    def __exit__(self, *_: object) -> None:
        self.decoder.close()
        self._painter.close()


def available_cores() -> int:
    """Return the number of processor cores that this process may use; 1 on other than Linux."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


@contextmanager
def _explained() -> Iterator[None]:
    try:
        yield
    except ChildEndedError as ended:
        raise PictureError(
            f"the process that draws the pictures ended (exit code {ended.code}){ended.last}; if "
            "memory is short, use one core (taskset -c 0 tirgeo ...)"
        ) from None


def main() -> None:
    """Paint what the parent sends, and answer each picture."""
    sys.setswitchinterval(SWITCH_S)
    cv2.setNumThreads(1)  # the other cores have work of their own
    with parent_pipes() as (orders, answers), ThreadPoolExecutor(1) as encoder:
        common, *memory = pickle.load(orders)  # noqa: S301  from our own parent
        slots = SharedSlots(*memory) if memory else None
        work = _Work(common._replace(ground=ground_of(common.config)))
        while True:
            order, place = pickle.load(orders)  # noqa: S301  as above
            if slots is not None and place is not None:
                order = order._replace(picture=replace(order.picture, pixels=slots.get(place)))
            encoder.submit(_answer, answers, work, *work.painted(order))


def _answer(answers: IO[bytes], work: _Work, image: Pixels, outline_n: Array | None) -> None:
    try:
        pickle.dump(work.encoded(image, outline_n), answers, protocol=pickle.HIGHEST_PROTOCOL)
        answers.flush()
    except BaseException:  # noqa: BLE001  whatever it is, the parent waits for this answer
        traceback.print_exc()
        os._exit(1)


class PictureDecoder:
    """Decode pictures when they are asked for; with several ``cores`` also ahead, in a thread."""

    def __init__(self, cores: int) -> None:
        self._thread = ThreadPoolExecutor(1) if cores > 1 else None
        self._ahead: dict[int, tuple[object, Future[RawPixels]]] = {}  # by the message's id
        self._switch_s = sys.getswitchinterval()
        if self._thread is not None:
            sys.setswitchinterval(SWITCH_S)

    def begin(self, topic: str, message: Any) -> None:
        """Begin to decode a picture that will be asked for."""
        if self._thread is not None and len(self._ahead) < _MOST_AHEAD:
            found = self._thread.submit(convert.pixels, topic, message)
            self._ahead[id(message)] = message, found  # while it is held, nothing else has its id

    def pixels(self, topic: str, message: Any) -> RawPixels:
        """Return the pixels of a picture. Raises MessageError as ``convert.pixels`` does."""
        if id(message) not in self._ahead:
            return convert.pixels(topic, message)
        return self._ahead.pop(id(message))[1].result()

    def close(self) -> None:
        """End the thread."""
        if self._thread is not None:
            sys.setswitchinterval(self._switch_s)
            self._thread.shutdown(cancel_futures=True)
