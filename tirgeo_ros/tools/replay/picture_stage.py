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
"""Decode, paint and encode pictures in the order of their arrival, in parallel to the other work.

A picture's place in the output, its pose, its texts and its counts are decided before. Painting
then depends only on earlier pictures; one process paints, and a thread of that process encodes.
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
from tirgeo_ros.core.overlay.frame_shapes import Unpainted
from tirgeo_ros.core.overlay.picture_painter import PicturePainter, Scene
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels
from tirgeo_ros.core.types.errors import PictureError
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess, parent_pipes
from tirgeo_ros.io.messages import pictures as picture_messages

_RUN = "from tirgeo_ros.tools.replay.picture_stage import main; main()"
#: Pictures sent and not yet received: with so many, neither process waits for slow pictures.
_MOST_UNDER_WAY = 8
#: Pictures that are decoded ahead: as many as one block of messages has, and a few megabytes.
_MOST_AHEAD = 8
#: A thread that has decoded gets the interpreter back within this time (s), instead of 5 ms.
_SWITCH_S = 5e-4


class Painted(NamedTuple):
    """Hold a finished picture as it is written."""

    jpeg: bytes
    image: Pixels | None  # (h, w, 3) BGR, if requested
    outline_n: Array | None  # footprint (N, 3), NED, m, if requested


class _Order(NamedTuple):
    picture: Unpainted
    scene: Scene | None  # None if it is the scene of the picture before
    with_outline: bool


class _Painter:
    """Paint pictures, then encode them; two threads may do the two."""

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
        outline_n = self._painter.shaper.footprint(result.pose) if order.with_outline else None
        return result.image, outline_n

    def encoded(self, image: Pixels, outline_n: Array | None) -> Painted:
        jpeg = cv2.imencode(".jpg", image, self._quality)[1].tobytes()
        return Painted(jpeg, image if self._keeps_images else None, outline_n)


class PictureStage:
    """Paint pictures here, or in a process of their own if there are several ``cores``.

    This is a context manager; call ``begin`` once, then ``send``, and ``receive`` once for each
    picture sent; at most ``most_under_way`` may be sent and not yet received. With several cores,
    a thread decodes in advance the pictures that ``decode_ahead`` announces.
    """

    def __init__(self, cores: int) -> None:
        """Start the process, if several cores are used, so that it loads its modules early."""
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
        """Set the parameters of all pictures; ``keeps_images``: return their pixels too."""
        if self._child is None:
            self._painter = _Painter(config, ground, keeps_images=keeps_images)
            return
        # The process reads an elevation model itself, while the first messages are read here.
        with _explained():
            self._child.send((config, keeps_images))

    def decode_ahead(self, topic: str, message: Any) -> None:
        """Begin to decode a picture whose ``pixels`` will be needed."""
        if self._decoder is not None and len(self._ahead) < _MOST_AHEAD:
            future = self._decoder.submit(picture_messages.pixels, topic, message)
            self._ahead[id(message)] = message, future  # keeps the message: its id stays unique

    def pixels(self, topic: str, message: Any) -> RawPixels:
        """Return the pixels of a picture. Raise MessageError as ``pictures.pixels`` does."""
        if id(message) not in self._ahead:
            return picture_messages.pixels(topic, message)
        return self._ahead.pop(id(message))[1].result()

    def send(self, picture: Unpainted, scene: Scene, *, with_outline: bool) -> None:
        """Send a picture and its scene to be painted. Raise PictureError if painting failed."""
        before, self._scene = self._scene, scene
        changed: Scene | None = scene  # without the map, if the painter has it already
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
        """Return the oldest picture that was sent. Raise PictureError if painting failed."""
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
            "memory ran out, use one core (taskset -c 0 tirgeo ...)"
        ) from None


def main() -> None:
    """Paint the pictures that the parent sends, and answer with each of them."""
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
