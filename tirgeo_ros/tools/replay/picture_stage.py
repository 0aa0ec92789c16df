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
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import IO, NamedTuple, final

import cv2

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.draping import Ground
from tirgeo_ros.core.overlay.map_renderer import MapRenderer
from tirgeo_ros.core.overlay.picture_painter import PicturePainter, Scene, Unpainted
from tirgeo_ros.core.types.arrays import Array, Pixels
from tirgeo_ros.core.types.errors import PictureError
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess, parent_pipes
from tirgeo_ros.tools.replay.picture_decoder import SWITCH_S, PictureDecoder

_RUN = "from tirgeo_ros.tools.replay.picture_stage import main; main()"
#: Pictures that may be under way: enough that neither side waits for the other's slower ones.
_MOST_UNDER_WAY = 8


class Painted(NamedTuple):
    """Hold a finished picture as it is written."""

    jpeg: bytes
    image: Pixels | None  # (h, w, 3) BGR, where it was asked for
    outline_n: Array | None  # its footprint (N, 3), NED, m, where it was asked for


class _Order(NamedTuple):
    picture: Unpainted
    scene: Scene | None  # if it is another one than before
    with_outline: bool


class _Work:
    """Paint pictures, then encode them; the two may be done in two threads."""

    def __init__(
        self, config: OverlayConfig, ground: Ground | None, *, keeps_images: bool
    ) -> None:
        terrain = ground if isinstance(ground, Terrain) else None
        self._drawing = MapRenderer(config, (), terrain)
        self._painter = PicturePainter(config, self._drawing)
        self._quality = [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality]
        self._keeps_images = keeps_images

    def painted(self, order: _Order) -> tuple[Pixels, Array | None]:
        if order.scene is not None:
            self._painter.set_scene(order.scene)
        result = self._painter.paint(order.picture)
        outline_n = self._drawing.footprint(result.pose) if order.with_outline else None
        return result.image, outline_n

    def encoded(self, image: Pixels, outline_n: Array | None) -> Painted:
        jpeg = cv2.imencode(".jpg", image, self._quality)[1].tobytes()
        return Painted(jpeg, image if self._keeps_images else None, outline_n)


@final
class PictureStage:
    """Paint pictures here, or in a process of their own if there are several cores.

    This is a context manager; call ``begin`` once, then ``send``, and ``receive`` once for each
    picture sent; at most ``most_under_way`` may be sent and not received. ``decoder`` decodes.
    """

    def __init__(self, cores: int) -> None:
        """Start the process, if there is one: it loads its modules meanwhile."""
        self.decoder = PictureDecoder(cores)
        self._child = ChildProcess(_RUN) if cores > 1 else None
        self.most_under_way = _MOST_UNDER_WAY if self._child else 0
        self._work: _Work | None = None
        self._done: deque[Painted] = deque()
        self._scene = Scene()

    def begin(self, config: OverlayConfig, ground: Ground, *, keeps_images: bool) -> None:
        """Take what all pictures have in common; ``keeps_images``: return their pixels too."""
        if self._child is None:
            self._work = _Work(config, ground, keeps_images=keeps_images)
        else:
            with _mended():
                self._child.send((config, keeps_images))

    def send(self, picture: Unpainted, scene: Scene, *, with_outline: bool) -> None:
        """Give a picture to be painted, in its scene. Raises PictureError if that has failed."""
        order = _Order(picture, self._changed(scene), with_outline)
        if self._child is not None:
            with _mended():
                self._child.send(order)
        elif self._work is not None:
            self._done.append(self._work.encoded(*self._work.painted(order)))

    def receive(self) -> Painted:
        """Return the oldest picture that was sent. Raises PictureError if painting failed."""
        if self._child is None:
            return self._done.popleft()
        with _mended():
            painted = self._child.receive()
        assert isinstance(painted, Painted)
        return painted

    def _changed(self, scene: Scene) -> Scene | None:
        """Return the scene without a map that is there already; None if it is the one before."""
        before, self._scene = self._scene, scene
        if all(new is old for new, old in zip(scene, before, strict=True)):
            return None
        return scene._replace(laid=None) if scene.laid is before.laid else scene

    def __enter__(self) -> PictureStage:
        return self

    def __exit__(self, *_: object) -> None:
        self.decoder.close()
        if self._child is not None:
            self._child.close()


def available_cores() -> int:
    """Return the number of processor cores that this process may use."""
    may_use = getattr(os, "sched_getaffinity", None)
    return len(may_use(0)) if may_use else os.cpu_count() or 1


@contextmanager
def _mended() -> Iterator[None]:
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
    with parent_pipes() as (orders, answers), ThreadPoolExecutor(1) as encoder:
        config, keeps_images = pickle.load(orders)  # noqa: S301  from our own parent
        work = _Work(config, ground_of(config), keeps_images=keeps_images)
        while True:
            order: _Order = pickle.load(orders)  # noqa: S301  as above
            encoder.submit(_answer, answers, work, *work.painted(order))


def _answer(answers: IO[bytes], work: _Work, image: Pixels, outline_n: Array | None) -> None:
    try:
        pickle.dump(work.encoded(image, outline_n), answers, protocol=pickle.HIGHEST_PROTOCOL)
        answers.flush()
    except BaseException:  # noqa: BLE001  whatever it is, the parent waits for this answer
        traceback.print_exc()
        os._exit(1)
