"""Buffer the newest samples before there is a state, and select those an alignment may use."""

from __future__ import annotations

import bisect
import math
import operator
from collections import deque
from collections.abc import Sequence
from typing import TypeVar

from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
    SetHeading,
    Source,
    VelocitySample,
)

_LEAST_INSTANTS = 3  # two always fit, and would hide a wrong one
#: Bound on the measurements kept per second: five sources at 100 Hz.
_MOST_HZ = 500
_MOST_IMU_HZ = 1000
_T = TypeVar("_T", bound=NavigationInput)


class AlignmentSamples:
    """Hold the samples of the last ``keep_s``; an IMU that repeats one reading is ``frozen``."""

    def __init__(self, keep_s: float, largest_gap_s: float) -> None:
        self._keep_ns = round(keep_s * 1e9)
        self._gap_ns = round(largest_gap_s * 1e9)
        self._imu: deque[ImuSample] = deque(maxlen=math.ceil(keep_s * _MOST_IMU_HZ))
        self._aiding: deque[NavigationInput] = deque(maxlen=math.ceil(keep_s * _MOST_HZ))
        self._first_ns = 0
        self._changed_ns = 0  # stamp of the last reading that differed from the one before
        self.frozen = False

    @property
    def ready(self) -> bool:
        """Return whether there is an IMU interval."""
        return len(self._imu) > 1

    @property
    def newest_ns(self) -> int:
        """Return the stamp of the newest IMU sample."""
        return self._imu[-1].stamp_ns

    @property
    def imu_s(self) -> float:
        """Return the time since the first IMU sample ever, s."""
        return (self.newest_ns - self._first_ns) * 1e-9 if self._imu else 0.0

    def add(self, sample: NavigationInput) -> None:
        """Take one sample."""
        if isinstance(sample, ImuSample):
            self._add_imu(sample)
        else:
            self._aiding.append(sample)
        newest = self._imu[-1].stamp_ns if self._imu else sample.stamp_ns
        for queue in (self._imu, self._aiding):
            while queue and queue[0].stamp_ns < newest - self._keep_ns:
                queue.popleft()

    def _add_imu(self, sample: ImuSample) -> None:
        before = self._imu[-1] if self._imu else None
        if before is None:
            self._first_ns = self._changed_ns = sample.stamp_ns
        elif (
            before.specific_force_b.tolist() != sample.specific_force_b.tolist()
            or before.angular_rate_b.tolist() != sample.angular_rate_b.tolist()
        ):
            self._changed_ns = sample.stamp_ns
        # Readings that never changed are a bench without noise; those of a live sensor have
        # changed.
        lived = self._changed_ns > self._first_ns
        self.frozen = lived and sample.stamp_ns - self._changed_ns > self._gap_ns
        if self.frozen or (before and sample.stamp_ns - before.stamp_ns > self._gap_ns):
            self._imu.clear()
        self._imu.append(sample)

    def positions(self, source: Source) -> list[PositionSample]:
        """Return a source's positions with a good fix, by stamp; none if its newest has none."""
        least = FixStatus.FLOAT if source is Source.RTK_POSITION else FixStatus.SINGLE
        found = self._reached(PositionSample, source)
        if not found or found[-1].status < least:
            return []
        return [s for s in found if s.status >= least]

    def rtk_status(self, stamp_ns: int) -> FixStatus | None:
        """Return the fix status of the newest RTK position up to a stamp."""
        found = self._reached(PositionSample, Source.RTK_POSITION)
        told = [s.status for s in found if s.stamp_ns <= stamp_ns]
        return told[-1] if told else None

    def velocities(self, source: Source) -> list[VelocitySample]:
        """Return the velocities of a source, by stamp."""
        return self._reached(VelocitySample, source)

    def headings(self, first_ns: int, last_ns: int, settled_s: float) -> list[HeadingSample]:
        """Return the headings between two stamps that were measured while RTK was fixed, by stamp.

        The RTK positions within ``settled_s`` before a heading and the first one not before it
        must be fixed: the samples of one instant arrive in any order.
        """
        fixes = self._reached(PositionSample, Source.RTK_POSITION)

        def fixed_around(stamp_ns: int) -> bool:
            begin_ns = stamp_ns - round(settled_s * 1e9)
            before = [s for s in fixes if begin_ns <= s.stamp_ns < stamp_ns]
            after = [s for s in fixes if s.stamp_ns >= stamp_ns][:1]
            return bool(after) and all(s.status is FixStatus.FIXED for s in (*before, *after))

        headings = self._reached(HeadingSample, Source.RTK_HEADING)
        inside = [s for s in headings if first_ns <= s.stamp_ns <= last_ns]
        return [s for s in inside if fixed_around(s.stamp_ns)]

    def set_headings(self) -> list[SetHeading]:
        """Return the headings that a person has set, by stamp."""
        return self._reached(SetHeading, Source.SET_HEADING)

    def imu_over(self, first_ns: int, last_ns: int) -> list[ImuSample]:
        """Return the IMU samples of an interval, with one before and one after if available."""
        imu, stamp_of = list(self._imu), operator.attrgetter("stamp_ns")
        begin = max(bisect.bisect_right(imu, first_ns, key=stamp_of) - 1, 0)
        return imu[begin : bisect.bisect_left(imu, last_ns, key=stamp_of) + 1]

    def rest(self, stamp_ns: int) -> tuple[tuple[ImuSample, ...], tuple[NavigationInput, ...]]:
        """Return the newest IMU sample up to a stamp and all later; and the later measurements."""
        before = [s for s in self._imu if s.stamp_ns <= stamp_ns][-1:]
        after = [s for s in self._imu if s.stamp_ns > stamp_ns]
        return (*before, *after), tuple(s for s in self._aiding if s.stamp_ns > stamp_ns)

    def _reached(self, kind: type[_T], source: Source) -> list[_T]:
        """Return the measurements of a source within the IMU record, by stamp."""
        oldest, newest = self._imu[0].stamp_ns, self._imu[-1].stamp_ns
        found = [s for s in self._aiding if isinstance(s, kind) and s.source is source]
        single = {s.stamp_ns: s for s in found if oldest <= s.stamp_ns <= newest}
        return [single[stamp_ns] for stamp_ns in sorted(single)]


def span(
    samples: Sequence[PositionSample | VelocitySample], length_ns: int
) -> tuple[int, int] | None:
    """Return the first and last stamp of three or more samples over ``length_ns``, or None."""
    stamps = [s.stamp_ns for s in samples]
    if not stamps:
        return None
    first = max((t for t in stamps if t <= stamps[-1] - length_ns), default=None)
    enough = first is not None and sum(t >= first for t in stamps) >= _LEAST_INSTANTS
    return (first, stamps[-1]) if first is not None and enough else None
