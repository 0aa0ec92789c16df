"""Decode pictures ahead of their turn, in a thread: OpenCV leaves the interpreter to others."""

from __future__ import annotations

import sys
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.io import messages as convert

#: Pictures that are decoded ahead: those of a video in one block of messages, and a few megabytes.
_MOST_AHEAD = 8
#: A thread that has decoded gets the interpreter back within this, s, not only after 5 ms.
SWITCH_S = 5e-4


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
