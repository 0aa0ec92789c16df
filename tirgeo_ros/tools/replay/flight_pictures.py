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
"""Choose and read the pictures of a recorded flight."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from functools import cached_property
from typing import NamedTuple

from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.core.types.errors import MessageError, TirgeoError
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import pictures as picture_messages
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.tools.replay.registration import picture_topic


class Window(NamedTuple):
    """Hold which pictures are wanted; times are seconds after the first message."""

    from_s: float = 0.0
    to_s: float = math.inf
    every_s: float = 0.0  # at most one picture in each interval of this length; 0: all


class Chosen(NamedTuple):
    """Hold a chosen picture's number in the flight, from 0, and its stamp."""

    number: int
    stamp_ns: int


class FlightPictures:
    """Read a bag's pictures, of the raw topic or else the compressed one. Raise BagError."""

    def __init__(self, reader: BagReader, namespace: str) -> None:
        self._reader, self._cdr = reader, Cdr()
        self._topic, self._name = picture_topic(reader, namespace)

    @cached_property
    def _times_ns(self) -> list[tuple[int, int]]:
        """Return the log time and the stamp of each picture; the bag is read once for them."""
        times_ns = []
        for message in self._reader.messages([self._name]):
            stamp_ns = 0  # without a stamp or a header, a picture gets its log time
            with suppress(MessageError):
                stamp_ns = header_stamp_ns(message.data)
            times_ns.append((message.log_time_ns, stamp_ns or message.log_time_ns))
        return times_ns

    @property
    def stamps_ns(self) -> list[int]:
        """Return the stamps of all pictures."""
        return [stamp_ns for _, stamp_ns in self._times_ns]

    def chosen(self, window: Window) -> list[Chosen]:
        """Return the pictures in a window, the first in each interval of ``every_s``."""
        pictures: list[Chosen] = []
        first_ns, newest = self._reader.span_ns[0], None
        for number, (log_time_ns, stamp_ns) in enumerate(self._times_ns):
            since_s = (log_time_ns - first_ns) * 1e-9
            if since_s > window.to_s:
                break
            interval = number if window.every_s <= 0 else since_s // window.every_s
            if since_s >= window.from_s and interval != newest:
                newest = interval
                pictures.append(Chosen(number, stamp_ns))
        return pictures

    def read(
        self, numbers: Collection[int], wants: Callable[[int], bool] = lambda _: True
    ) -> Iterator[tuple[int, RawPixels | TirgeoError]]:
        """Yield the pictures of these numbers, in order; an error for one that is damaged.

        Just before a picture would be decoded, ``wants`` may decline it.
        """
        last = max(numbers, default=-1)
        for number, message in enumerate(self._reader.messages([self._name])):
            if number > last:
                return
            if number in numbers and wants(number):
                try:
                    content = self._cdr.deserialize(message.data, message.typename, message.topic)
                    yield number, picture_messages.pixels(self._topic, content)
                except TirgeoError as error:
                    yield number, error
