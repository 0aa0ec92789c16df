"""Decode, paint and encode pictures in the order in which they come, beside the other work.

A picture's place in the output, its pose, its words and what is counted are decided before. Then
painting needs only the pictures before it, and is done by one process; a thread of that encodes.
"""

from __future__ import annotations

import os
import pickle
import sys
import traceback
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import IO, Any, NamedTuple

import cv2

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.ground.backprojection import Ground, Terrain
from tirgeo_ros.core.overlay.picture_painter import PicturePainter, Scene, Unpainted
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels
from tirgeo_ros.core.types.errors import PictureError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess, parent_pipes

_RUN = "from tirgeo_ros.tools.replay.picture_stage import main; main()"
#: Pictures sent to the process: enough that neither side waits for the other's slower ones.
_MOST_UNDER_WAY = 8
#: Pictures that are decoded ahead: those of a video in one block of messages, and a few megabytes.
_MOST_AHEAD = 8
#: A thread that has decoded gets the interpreter back within this, s, not only after 5 ms.
_SWITCH_S = 5e-4


class Painted(NamedTuple):
    """Hold a finished picture as it is written."""

    jpeg: bytes
    image: Pixels | None  # (h, w, 3) BGR, where it was asked for
    outline_n: Array | None  # its footprint (N, 3), NED, m, where it was asked for


class _Order(NamedTuple):
    picture: Unpainted
    scene: Scene | None  # if it is another one than before
    with_outline: bool


class _Painter:
    """Paint pictures, then encode them; the two may be done in two threads."""

    def __init__(
        self, config: OverlayConfig, ground: Ground | None, *, keeps_images: bool
    ) -> None:
        terrain = ground if isinstance(ground, Terrain) else None
        self._painter = PicturePainter(config, (), terrain)
        self._quality = [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality]
        self._keeps_images = keeps_images

    def painted(self, order: _Order) -> tuple[Pixels, Array | None]:
        if order.scene is not None:
            self._painter.set_scene(order.scene)
        result = self._painter.paint(order.picture)
        outline_n = self._painter.footprint(result.pose) if order.with_outline else None
        return result.image, outline_n

    def encoded(self, image: Pixels, outline_n: Array | None) -> Painted:
        jpeg = cv2.imencode(".jpg", image, self._quality)[1].tobytes()
        return Painted(jpeg, image if self._keeps_images else None, outline_n)


class PictureStage:
    """Paint pictures here, or in a process of their own if there are several ``cores``.

    This is a context manager; call ``begin`` once, then ``send``, and ``receive`` once for each
    picture sent; at most ``most_under_way`` may be sent and not received. With several cores,
    pictures are decoded ahead, in a thread, if ``decode_ahead`` announces them.
    """

    def __init__(self, cores: int) -> None:
        """Start the process, if there is one: it loads its modules meanwhile."""
        self._child = ChildProcess(_RUN) if cores > 1 else None
        self._decoder = ThreadPoolExecutor(1) if cores > 1 else None
        self.most_under_way = _MOST_UNDER_WAY if cores > 1 else 0
        self._ahead: dict[int, tuple[object, Future[RawPixels]]] = {}  # by the message's id
        self._painter: _Painter
        self._done: deque[Painted] = deque()  # painted here
        self._scene = Scene()
        self._switch_s = sys.getswitchinterval()
        if self._decoder is not None:
            sys.setswitchinterval(_SWITCH_S)

    def begin(self, config: OverlayConfig, ground: Ground, *, keeps_images: bool) -> None:
        """Take what all pictures have in common; ``keeps_images``: return their pixels too."""
        if self._child is None:
            self._painter = _Painter(config, ground, keeps_images=keeps_images)
            return
        # It reads an elevation model itself, while the first messages are read here.
        with _explained():
            self._child.send((config, keeps_images))

    def decode_ahead(self, topic: str, message: Any) -> None:
        """Begin to decode a picture that will be asked for."""
        if self._decoder is not None and len(self._ahead) < _MOST_AHEAD:
            future = self._decoder.submit(convert.pixels, topic, message)
            self._ahead[id(message)] = message, future  # while it is held, its id is its own

    def pixels(self, topic: str, message: Any) -> RawPixels:
        """Return the pixels of a picture. Raises MessageError as ``convert.pixels`` does."""
        if id(message) not in self._ahead:
            return convert.pixels(topic, message)
        return self._ahead.pop(id(message))[1].result()

    def send(self, picture: Unpainted, scene: Scene, *, with_outline: bool) -> None:
        """Give a picture to be painted, in its scene. Raises PictureError if that has failed."""
        before, self._scene = self._scene, scene
        changed: Scene | None = scene  # without a map that is there already
        if all(new is old for new, old in zip(scene, before, strict=True)):
            changed = None
        elif scene.draped is before.draped:
            changed = scene._replace(draped=None)
        order = _Order(picture, changed, with_outline)
        if self._child is None:
            self._done.append(self._painter.encoded(*self._painter.painted(order)))
            return
        with _explained():
            self._child.send(order)

    def receive(self) -> Painted:
        """Return the oldest picture that was sent. Raises PictureError if painting failed."""
        if self._child is None:
            return self._done.popleft()
        with _explained():
            painted: Painted = self._child.receive()
        return painted

    def __enter__(self) -> PictureStage:
        return self

    def __exit__(self, *_: object) -> None:
        if self._decoder is not None:
            sys.setswitchinterval(self._switch_s)
            self._decoder.shutdown(cancel_futures=True)
        if self._child is not None:
            self._child.close()


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
    sys.setswitchinterval(_SWITCH_S)
    cv2.setNumThreads(1)  # the other cores have work of their own
    with parent_pipes() as (orders, answers), ThreadPoolExecutor(1) as encoder:
        config, keeps_images = pickle.load(orders)  # noqa: S301  from our own parent
        painter = _Painter(config, ground_of(config), keeps_images=keeps_images)
        while True:
            order = pickle.load(orders)  # noqa: S301  as above
            encoder.submit(_answer, answers, painter, *painter.painted(order))


def _answer(answers: IO[bytes], painter: _Painter, image: Pixels, outline_n: Array | None) -> None:
    try:
        pickle.dump(painter.encoded(image, outline_n), answers, protocol=pickle.HIGHEST_PROTOCOL)
        answers.flush()
    except BaseException:  # noqa: BLE001  whatever it is, the parent waits for this answer
        traceback.print_exc()
        os._exit(1)
