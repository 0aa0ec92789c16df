"""Choose pictures of a bag, and read them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from contextlib import suppress
from functools import cached_property
from typing import NamedTuple

from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.core.types.errors import BagError, MessageError, TirgeoError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.tools.replay.flight_topics import PICTURES, resolved


class Window(NamedTuple):
    """Hold which pictures are wanted: seconds after the first message, and at most one in each."""

    from_s: float = 0.0
    to_s: float = math.inf
    every_s: float = 0.0  # 0: all


class Chosen(NamedTuple):
    """Hold a chosen picture's number in the flight, from 0, and its stamp."""

    number: int
    stamp_ns: int


class FlightPictures:
    """Read the pictures of a bag: of the raw topic, or else of the compressed one.

    Raise BagError if the bag has neither.
    """

    def __init__(self, reader: BagReader, namespace: str) -> None:
        self._reader, self._cdr = reader, Cdr()
        names = {topic: resolved(topic, namespace) for topic in PICTURES}
        there = [topic for topic, name in names.items() if name in reader.topics()]
        if not there:
            hint = "" if namespace else "; is there a --namespace?"
            absent = " or ".join(names.values())
            raise BagError(f"{reader.path}: needed topic absent: {absent}{hint}")
        self._topic, self._name = there[0], names[there[0]]

    @cached_property
    def _times_ns(self) -> list[tuple[int, int]]:
        """Return the log time and the stamp of each picture; the bag is read once for them."""
        return [(message.log_time_ns, _stamp_ns(message)) for message in self._messages()]

    @property
    def stamps_ns(self) -> list[int]:
        """Return the stamps of all pictures."""
        return [stamp_ns for _, stamp_ns in self._times_ns]

    def chosen(self, window: Window) -> list[Chosen]:
        """Return the pictures in a window, the first in each interval of ``every_s``."""
        found: list[Chosen] = []
        first_ns, newest = self._reader.span_ns[0], None
        for number, (log_time_ns, stamp_ns) in enumerate(self._times_ns):
            since_s = (log_time_ns - first_ns) * 1e-9
            if since_s > window.to_s:
                break
            interval = number if window.every_s <= 0 else since_s // window.every_s
            if since_s >= window.from_s and interval != newest:
                newest = interval
                found.append(Chosen(number, stamp_ns))
        return found

    def read(self, numbers: Collection[int]) -> Iterator[tuple[int, RawPixels | TirgeoError]]:
        """Yield the pictures of these numbers, in order; an error for one that is damaged."""
        last = max(numbers, default=-1)
        for number, message in enumerate(self._messages()):
            if number > last:
                return
            if number in numbers:
                try:
                    content = self._cdr.deserialize(message.data, message.typename, message.topic)
                    yield number, convert.pixels(self._topic, content)
                except TirgeoError as error:
                    yield number, error

    def _messages(self) -> Iterator[BagMessage]:
        return self._reader.messages([self._name])


def _stamp_ns(message: BagMessage) -> int:
    """Return a picture's stamp; one without, or without a header, has that of its arrival."""
    with suppress(MessageError):
        return header_stamp_ns(message.data) or message.log_time_ns
    return message.log_time_ns
