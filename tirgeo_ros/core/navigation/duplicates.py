"""Detect a measurement that a driver sends again, at its polling rate, under a new time stamp."""

from __future__ import annotations

from collections import deque
from enum import Enum
from itertools import pairwise

from tirgeo_ros.core.navigation.aiding.state_estimate import Aiding, source_of
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)

#: A value repeated after longer than this is a new measurement (a test bench, an aircraft at
#: rest).
_LONGEST_NS = 900_000_000
#: Within this share of the receiver's interval the same heading is the same measurement.
_INTERVAL_SHARE = 0.95


class Same(Enum):
    """Describe what a measurement has in common with the one before of its source."""

    NOTHING = 0
    VALUE = 1  # the value repeats in a new measurement, unless the receiver is frozen
    MEASUREMENT = 2  # the same measurement, sent again


class DuplicateDetector:
    """Compare each measurement with the one before of its source.

    Two measured positions or velocities never agree in all digits. A position that repeats with a
    worse fix status is new, for its status is news; with a better status it is the same
    measurement. Headings in whole degrees do repeat. The receiver's interval is therefore learned
    from the changes of its positions.
    """

    def __init__(self) -> None:
        self._newest: dict[Source, tuple[int, tuple[float, ...]]] = {}
        self._status: dict[Source, FixStatus] = {}
        self._changes_ns: deque[int] = deque(maxlen=8)  # of RTK positions

    def compared(self, sample: Aiding) -> Same:
        """Return what a sample has in common with the one before of its source."""
        if not isinstance(sample, PositionSample | VelocitySample | HeadingSample):
            return Same.NOTHING  # rounded readings of other sensors do repeat
        source, value = source_of(sample), _value(sample)
        known = self._newest.get(source)
        same = Same.NOTHING
        if not self._status_worsened(sample) and known is not None and known[1] == value:
            apart_ns = abs(sample.stamp_ns - known[0])
            heading = isinstance(sample, HeadingSample)
            if 0 < apart_ns < (self._interval_ns() if heading else _LONGEST_NS):
                return Same.MEASUREMENT
            same = Same.VALUE
        elif source is Source.RTK_POSITION:
            self._changes_ns.append(sample.stamp_ns)
        self._newest[source] = sample.stamp_ns, value
        return same

    def _status_worsened(self, sample: Aiding) -> bool:
        """Return whether a position's fix status is worse than that of the one before."""
        if not isinstance(sample, PositionSample):
            return False
        before = self._status.get(sample.source, sample.status)
        self._status[sample.source] = sample.status
        return sample.status < before

    def _interval_ns(self) -> float:
        """Return the time within which an equal heading counts as the same measurement."""
        stamps = sorted(self._changes_ns)
        steps = sorted(b - a for a, b in pairwise(stamps))
        usual_ns = steps[len(steps) // 2] if steps else _LONGEST_NS
        return min(_INTERVAL_SHARE * usual_ns, _LONGEST_NS)


def _value(sample: PositionSample | VelocitySample | HeadingSample) -> tuple[float, ...]:
    if isinstance(sample, HeadingSample):
        return (sample.heading_rad,)
    if isinstance(sample, VelocitySample):
        return tuple(sample.velocity_n.tolist())
    return sample.latitude_rad, sample.longitude_rad, sample.height_m
