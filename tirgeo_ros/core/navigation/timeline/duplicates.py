"""Detect a measurement that a driver sends again, at its polling rate, under a new time stamp."""

from __future__ import annotations

import statistics
from collections import deque
from enum import Enum
from itertools import pairwise

from tirgeo_ros.core.navigation.aiding.state_estimate import Aiding
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)

#: A value repeated after longer than this is a new one (a test bench, an aircraft at rest).
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
        source, worse, longest_ns = sample.source, False, float(_LONGEST_NS)
        if isinstance(sample, PositionSample):
            value: tuple[float, ...] = sample.latitude_rad, sample.longitude_rad, sample.height_m
            worse = sample.status < self._status.get(source, sample.status)
            self._status[source] = sample.status
        elif isinstance(sample, VelocitySample):
            value = tuple(sample.velocity_n.tolist())
        elif isinstance(sample, HeadingSample):
            value, longest_ns = (sample.heading_rad,), self._interval_ns()
        else:
            return Same.NOTHING  # rounded readings of other sensors do repeat
        known, same = self._newest.get(source), Same.NOTHING
        if not worse and known is not None and known[1] == value:
            if 0 < abs(sample.stamp_ns - known[0]) < longest_ns:
                return Same.MEASUREMENT
            same = Same.VALUE
        elif source is Source.RTK_POSITION:
            self._changes_ns.append(sample.stamp_ns)
        self._newest[source] = sample.stamp_ns, value
        return same

    def _interval_ns(self) -> float:
        """Return the time within which an equal heading counts as the same measurement."""
        steps = [b - a for a, b in pairwise(sorted(self._changes_ns))]
        usual_ns = statistics.median_high(steps) if steps else _LONGEST_NS
        return min(_INTERVAL_SHARE * usual_ns, _LONGEST_NS)
