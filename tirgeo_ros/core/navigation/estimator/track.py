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
"""Keep the track of a whole flight in few points."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Generic, TypeVar

from tirgeo_ros.core.types.poses import BodyPose

T = TypeVar("T")

#: The whole track is sent each time: with more points it would delay the filter.
MOST_POINTS = 1000
_FIRST_SPACING_M = 1.0


class Track(Generic[T]):
    """Keep points of a track, each made once from a pose by ``point_of``.

    Two points are a metre apart or more. When there are ``MOST_POINTS``, every second one is
    dropped and the spacing doubles, so the track still covers the whole flight.
    """

    def __init__(self, point_of: Callable[[BodyPose], T]) -> None:
        self._point_of = point_of
        self.clear()

    def clear(self) -> None:
        """Begin a new track."""
        self._points: list[T] = []
        self._spacing_m = _FIRST_SPACING_M
        self._last: BodyPose | None = None  # the pose of the last point
        self._newest: BodyPose | None = None

    def add(self, body: BodyPose) -> None:
        """Add a pose; a stamp earlier than the newest begins a new track."""
        if self._newest is not None and body.stamp_ns < self._newest.stamp_ns:
            self.clear()
        self._newest = body
        last = self._last
        if last is not None and math.dist(last.position_n, body.position_n) < self._spacing_m:
            return
        if len(self._points) == MOST_POINTS:
            del self._points[1::2]
            self._spacing_m *= 2
        self._points.append(self._point_of(body))
        self._last = body

    def points(self) -> list[T]:
        """Return the points in order of time; the last one is where the aircraft is now."""
        if self._newest is None or self._newest is self._last:
            return list(self._points)
        return [*self._points, self._point_of(self._newest)]
