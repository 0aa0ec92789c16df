"""Noticing a measurement that a driver sends again at its polling rate under new stamps."""

from __future__ import annotations

from collections import deque
from enum import Enum
from itertools import pairwise

from tirgeo_ros.core.navigation.aiding.filter_state import Aiding, source_of
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)

#: A receiver that says the same for longer means it (a test bench, an aircraft at rest).
_LONGEST_NS = 900_000_000
#: Of the receiver's interval: within it the same heading is the same measurement.
_SHARE = 0.95


class Same(Enum):
    """What a measurement has in common with the one before of its source."""

    NOTHING = 0
    VALUE = 1  # a new measurement, unless the receiver is frozen
    MEASUREMENT = 2  # it is that one again


class Repeats:
    """Compares each measurement with the one before of its source.

    A position or velocity never says the same twice to all digits; a position again whose fix
    has become worse is news of the fix (one whose fix has become better was measured without
    it). A heading in whole degrees
    does: how often the receiver measures is therefore learned from its positions' changes.
    """

    def __init__(self) -> None:
        self._newest: dict[Source, tuple[int, tuple[float, ...]]] = {}
        self._status: dict[Source, FixStatus] = {}
        self._changes_ns: deque[int] = deque(maxlen=8)  # of RTK positions

    def compared(self, sample: Aiding) -> Same:
        """What a sample has in common with the one before."""
        source, value = source_of(sample), _value(sample)
        known = self._newest.get(source)
        same = Same.NOTHING
        if not self._fell(sample) and known is not None and known[1] == value:
            apart_ns = abs(sample.stamp_ns - known[0])
            heading = isinstance(sample, HeadingSample)
            if 0 < apart_ns < (self._interval_ns() if heading else _LONGEST_NS):
                return Same.MEASUREMENT
            same = Same.VALUE
        elif source is Source.RTK_POSITION:
            self._changes_ns.append(sample.stamp_ns)
        self._newest[source] = sample.stamp_ns, value
        return same

    def _fell(self, sample: Aiding) -> bool:
        """Whether a position's fix is worse than that of the one before."""
        if not isinstance(sample, PositionSample):
            return False
        before = self._status.get(sample.source, sample.status)
        self._status[sample.source] = sample.status
        return sample.status < before

    def _interval_ns(self) -> float:
        """Within this after a heading, the same heading is no new one."""
        stamps = sorted(self._changes_ns)
        steps = sorted(b - a for a, b in pairwise(stamps))
        usual_ns = steps[len(steps) // 2] if steps else _LONGEST_NS
        return min(_SHARE * usual_ns, _LONGEST_NS)


def _value(sample: Aiding) -> tuple[float, ...]:
    if isinstance(sample, HeadingSample):
        return (sample.heading_rad,)
    if isinstance(sample, VelocitySample):
        return tuple(sample.velocity_n.tolist())
    return sample.latitude_rad, sample.longitude_rad, sample.height_m
