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
"""Hold the poses of the last few seconds and interpolate between them.

Between two poses, position and covariance are interpolated linearly, and the attitude along the
shortest arc. Outside them, and across a gap that is too wide, the result is a reason instead of a
pose: nothing is extrapolated here.
"""

from __future__ import annotations

from bisect import bisect_left
from enum import Enum
from typing import Generic, TypeVar

from tirgeo_ros.core.frames.rotations import slerp
from tirgeo_ros.core.streams.sanity_checks import pose_fault
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import BodyPose, CameraPose

T = TypeVar("T")
P = TypeVar("P", BodyPose, CameraPose)


class Miss(Enum):
    """Name why a buffer has no entry at a stamp; the value is the name in diagnostics."""

    EMPTY = "empty"  # nothing has come yet
    TOO_OLD = "too_old"  # before the oldest entry that is kept
    TOO_NEW = "too_new"  # after the newest entry: it may still come
    GAP = "gap"  # the entries on both sides are too far apart


class StampedBuffer(Generic[T]):
    """Hold the entries of the last ``span_s`` seconds, in order of their stamps.

    A stamp that goes back (a new bag, a clock that was set) clears the history and is counted in
    ``went_back``. An entry with the same stamp as the newest one replaces it.
    """

    def __init__(self, span_s: float = 3.0, max_gap_s: float = 0.25) -> None:
        self.went_back = 0
        self.keep(span_s, max_gap_s)
        self._stamps: list[int] = []
        self._entries: list[T] = []

    def keep(self, span_s: float = 3.0, max_gap_s: float = 0.25) -> None:
        """Set how long entries are kept, and the longest gap that is interpolated."""
        self._span_ns = round(span_s * 1e9)
        self._max_gap_ns = round(max_gap_s * 1e9)

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self._stamps)

    @property
    def newest_ns(self) -> int | None:
        """Return the newest entry's stamp, or None."""
        return self._stamps[-1] if self._stamps else None

    def clear(self) -> None:
        """Remove every entry; keep ``went_back``."""
        self._stamps.clear()
        self._entries.clear()

    def put(self, stamp_ns: int, entry: T) -> None:
        """Add an entry and remove those that are older than the span."""
        if self._stamps and stamp_ns < self._stamps[-1]:
            self.went_back += 1
            self.clear()
        if self._stamps and stamp_ns == self._stamps[-1]:
            self._entries[-1] = entry
            return
        self._stamps.append(stamp_ns)
        self._entries.append(entry)
        if self._stamps[0] < stamp_ns - self._span_ns:
            old = bisect_left(self._stamps, stamp_ns - self._span_ns)
            del self._stamps[:old], self._entries[:old]

    def latest(self, span_s: float) -> list[T]:
        """Return the entries of the last ``span_s`` seconds up to the newest one, in order."""
        if not self._stamps:
            return []
        return self._entries[bisect_left(self._stamps, self._stamps[-1] - round(span_s * 1e9)) :]

    def around(self, stamp_ns: int) -> tuple[T, T, float] | Miss:
        """Return the entries before and after a stamp, and the fraction between them, 0 to 1.

        At the stamp of an entry both are that entry. Without two such entries, return a Miss.
        """
        if not self._stamps:
            return Miss.EMPTY
        if stamp_ns > self._stamps[-1]:
            return Miss.TOO_NEW
        after = bisect_left(self._stamps, stamp_ns)
        if self._stamps[after] == stamp_ns:
            return self._entries[after], self._entries[after], 0.0
        if after == 0:
            return Miss.TOO_OLD
        start, end = self._stamps[after - 1], self._stamps[after]
        if end - start > self._max_gap_ns:
            return Miss.GAP
        fraction = (stamp_ns - start) / (end - start)
        return self._entries[after - 1], self._entries[after], fraction


class PoseBuffer(StampedBuffer[P]):
    """Hold body or camera poses; refuse those that are not valid.

    ``max_gap_s`` is the longest time between two poses that is interpolated across. ``invalid``
    counts the refused poses, ``fault`` is the reason for the newest refusal.
    """

    def __init__(self, span_s: float = 3.0, max_gap_s: float = 0.25) -> None:
        super().__init__(span_s, max_gap_s)
        self.invalid, self.fault, self.max_gap_s = 0, "", max_gap_s

    def add(self, pose: P) -> bool:
        """Add a pose; return False, and count it with its fault, if it is not a valid pose."""
        fault = pose_fault(pose.position_n, attitude_of(pose), pose.covariance)
        if fault:
            self.invalid, self.fault = self.invalid + 1, fault
            return False
        self.put(pose.stamp_ns, pose)
        return True

    def at(self, stamp_ns: int) -> P | Miss:
        """Return the pose at a stamp, or the reason why there is none."""
        around = self.around(stamp_ns)
        if isinstance(around, Miss):
            return around
        start, end, fraction = around
        if fraction == 0.0:
            return start
        return type(start)(  # a weighted mean of two covariances is a covariance
            stamp_ns,
            start.position_n + fraction * (end.position_n - start.position_n),
            slerp(attitude_of(start), attitude_of(end), fraction),
            start.covariance + fraction * (end.covariance - start.covariance),
        )


def attitude_of(pose: BodyPose | CameraPose) -> Array:
    """Return ``q_nb`` of a body pose or ``q_nc`` of a camera pose."""
    return pose.q_nb if isinstance(pose, BodyPose) else pose.q_nc
