"""Detect an IMU at its full scale: readings that pile up at one extreme value.

A sensor that is shaken beyond its range repeats the end of the range. The end is not known
beforehand but shows as a pile: readings that jump to the largest value so far, and stop there more
often than just below it. Quantised readings, a long turn, a frozen sensor and one at rest make no
such pile, nor does a single shock.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from tirgeo_ros.core.types.measurements import ImuSample

CHANNELS = tuple(f"{sensor} {axis}" for sensor in ("accelerometer", "gyroscope") for axis in "xyz")
_UNITS = ("m/s2",) * 3 + ("rad/s",) * 3
#: No IMU has a range below 2 g and 125 deg/s (19.6, 2.18); smaller readings are not examined.
_LEAST_M_S2, _LEAST_RAD_S = 18.0, 2.0
_LEAST_M_S2_2, _LEAST_RAD_S_2 = _LEAST_M_S2**2, _LEAST_RAD_S**2
#: Readings within this fraction of the extreme value count as equal to it.
_EQUAL_SHARE = 1e-4
#: Readings within this fraction below the extreme are just short of it. A reading that comes from
#: further below has jumped.
_SHORT_SHARE = 0.05
#: Hits within the window that make a pile. Of coarse readings (0.08 m/s2) under strong vibration
#: three are equal by chance in a flight of some minutes.
_PILE = 5
_WINDOW_NS = 1_000_000_000
#: An extreme that was not reached again for this long was an ordinary reading.
_FORGET_NS = 10_000_000_000
#: How long a warning stays: longer than the time between two diagnostics messages.
_WARN_NS = 5_000_000_000


@dataclass(slots=True)
class _End:
    """Track one end of one channel's range, as far as it was seen; values are magnitudes."""

    level: float
    met_ns: int
    least: float  # smaller readings are not examined
    known: bool = False  # whether a pile was seen here
    jumped_ns: int | None = None  # newest hit that jumped from below
    hits_ns: deque[int] = field(default_factory=deque)  # within the window
    short_ns: deque[int] = field(default_factory=deque)

    def outgrown(self, value: float, stamp_ns: int) -> bool:
        """Return whether ``value`` exceeds the known end, or the end is too old to keep."""
        return value > self.level * (1 + _EQUAL_SHARE) or abs(stamp_ns - self.met_ns) > _FORGET_NS

    def add(self, value: float, stamp_ns: int, before: float) -> int:
        """Return how many samples are found clipped with this one: 0, 1, or all of a new pile."""
        short = self.level * (1 - _SHORT_SHARE)
        if value < self.level * (1 - _EQUAL_SHARE):
            if value > short:
                self.short_ns.append(stamp_ns)
            return 0
        self.met_ns, self.level = stamp_ns, max(value, self.level)
        self.hits_ns.append(stamp_ns)
        short = self.level * (1 - _SHORT_SHARE)
        if before < short:
            self.jumped_ns = stamp_ns
        if self.known:
            return 1
        _forget(self.short_ns, stamp_ns)
        number = self.number()
        jumped = self.jumped_ns is not None and abs(stamp_ns - self.jumped_ns) <= _WINDOW_NS
        piled = jumped and number >= max(_PILE, len(self.short_ns))
        self.known = piled and short >= self.least  # else those just short were not examined
        return number if self.known else 0

    def number(self) -> int:
        """Return the samples at the end within the second up to the newest of them."""
        _forget(self.hits_ns, self.met_ns)
        return len(self.hits_ns)


class Clipping:
    """Track the IMU's readings at full scale; a sample in the middle of the range costs 0.5 us."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}  # channel -> samples at full scale
        self.since_ns: int | None = None  # when the newest spell began; None before the first
        self.newest_ns: int | None = None
        self._ends: dict[tuple[int, bool], _End] = {}  # key: channel, whether positive
        self._before: ImuSample | None = None

    def add(self, sample: ImuSample) -> None:
        """Take the next sample to arrive; its numbers must be finite."""
        before, self._before = self._before, sample
        x, y, z = sample.specific_force_b.tolist()
        p, q, r = sample.angular_rate_b.tolist()
        if x * x + y * y + z * z < _LEAST_M_S2_2 and p * p + q * q + r * r < _LEAST_RAD_S_2:
            return  # nearly always
        if before is not None:
            self._look(sample.stamp_ns, [x, y, z], before.specific_force_b.tolist(), 0)
            self._look(sample.stamp_ns, [p, q, r], before.angular_rate_b.tolist(), 3)

    def active(self, now_ns: int) -> bool:
        """Return whether the IMU was at full scale within the last second."""
        return self.newest_ns is not None and abs(now_ns - self.newest_ns) <= _WINDOW_NS

    def warnings(self, now_ns: int) -> tuple[str, ...]:
        """Return which channels were clipped lately, at which value and how often."""
        lately = (
            (channel, end)
            for (channel, _), end in sorted(self._ends.items(), key=lambda item: item[0])
            if end.known and abs(now_ns - end.met_ns) <= _WARN_NS
        )
        return tuple(
            f"imu/data: {CHANNELS[channel]} clipped at {end.level:.3g} {_UNITS[channel]} "
            f"({end.number()} samples in 1 s): vibration beyond its range"
            for channel, end in dict(lately).items()  # one end of each
        )

    def _look(self, stamp_ns: int, values: list[float], earlier: list[float], first: int) -> None:
        """Check the readings (3,) of a sensor, of which ``first`` is the first channel's index."""
        if values == earlier:
            return  # no new reading: frozen, or slower than the topic
        least = _LEAST_RAD_S if first else _LEAST_M_S2
        for channel, (value, last) in enumerate(zip(values, earlier, strict=True), first):
            size = abs(value)
            if size < least:
                continue
            place = channel, value > 0
            end = self._ends.get(place)
            if end is None or end.outgrown(size, stamp_ns):
                end = self._ends[place] = _End(size, stamp_ns, least)
            found = end.add(size, stamp_ns, last if value > 0 else -last)
            if found:
                name = CHANNELS[channel]
                self.counts[name] = self.counts.get(name, 0) + found
                if not self.active(stamp_ns):
                    self.since_ns = stamp_ns
                self.newest_ns = stamp_ns


def _forget(stamps_ns: deque[int], now_ns: int) -> None:
    """Drop the stamps outside the window."""
    while stamps_ns and abs(now_ns - stamps_ns[0]) > _WINDOW_NS:
        stamps_ns.popleft()
