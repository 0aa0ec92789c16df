"""Noticing a measurement that a driver sends again at its polling rate under new stamps."""

from __future__ import annotations

from collections import deque
from enum import Enum
from itertools import pairwise

from tirgeo_ros.core.aiding.belief import Aiding, source_of
from tirgeo_ros.core.samples import HeadingSample, PositionSample, Source, VelocitySample

#: A receiver that says the same for longer means it (a test bench, an aircraft at rest).
_LONGEST_INTERVAL_NS = 1_000_000_000
#: Of the receiver's interval: within it the same value is the same measurement.
_SHARE = 0.75


class Same(Enum):
    """What a measurement has in common with the one before of its source."""

    NOTHING = 0
    VALUE = 1  # a new measurement, unless the receiver is frozen
    MEASUREMENT = 2  # it is that one again


class Repeats:
    """Compares each measurement with the one before of its source.

    A heading in whole degrees says the same twice with good reason, a position hardly ever. How
    often a receiver measures is therefore learned from its positions' changes.
    """

    def __init__(self) -> None:
        self._newest: dict[Source, tuple[int, tuple[float, ...]]] = {}
        self._changes: dict[bool, deque[int]] = {True: deque(maxlen=8), False: deque(maxlen=8)}

    def compared(self, sample: Aiding) -> Same:
        """What a sample has in common with the one before."""
        source, value = source_of(sample), _value(sample)
        rtk = source not in {Source.GPS_POSITION, Source.GPS_VELOCITY}
        known = self._newest.get(source)
        same = Same.NOTHING
        if known is not None and known[1] == value:
            apart_ns = abs(sample.stamp_ns - known[0])
            if 0 < apart_ns < _SHARE * self._interval_ns(rtk=rtk):
                return Same.MEASUREMENT
            same = Same.VALUE
        elif isinstance(sample, PositionSample):
            self._changes[rtk].append(sample.stamp_ns)
        self._newest[source] = sample.stamp_ns, value
        return same

    def _interval_ns(self, *, rtk: bool) -> int:
        """The shortest time between the newest changes of a receiver's position."""
        stamps = sorted(self._changes[rtk])
        steps = [b - a for a, b in pairwise(stamps) if b > a]
        return min([*steps, _LONGEST_INTERVAL_NS])


def _value(sample: Aiding) -> tuple[float, ...]:
    if isinstance(sample, HeadingSample):
        return (sample.heading_rad,)
    if isinstance(sample, VelocitySample):
        return tuple(sample.velocity_n.tolist())
    return sample.latitude_rad, sample.longitude_rad, sample.height_m
