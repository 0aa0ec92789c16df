"""Whether the IMU is at its full scale: readings pinned at one extreme value.

A sensor that is shaken beyond its range gives the end of the range again and again. The end is
not known beforehand; the pile tells it: readings that come from afar and stop at the largest
value there was oftener than just short of it. Quantised readings, a long turn, a frozen sensor
and one at rest make no such pile. A single shock makes none either.
"""

from __future__ import annotations

from collections import deque

from tirgeo_ros.core.types.measurements import ImuSample

CHANNELS = tuple(f"{sensor} {axis}" for sensor in ("accelerometer", "gyroscope") for axis in "xyz")
_UNITS = ("m/s2",) * 3 + ("rad/s",) * 3
#: No IMU has a smaller range than 2 g and 125 deg/s (19.6, 2.18); from here on it is looked at.
_LEAST_M_S2, _LEAST_RAD_S = 18.0, 2.0
_LEAST_M_S2_2, _LEAST_RAD_S_2 = _LEAST_M_S2**2, _LEAST_RAD_S**2
#: Readings so near to the extreme, as a part of it, are the extreme.
_SAME = 1e-4
#: From here on a reading is just short of it; what comes from below has jumped.
_SHORT = 0.05
#: So many within the window are a pile. Of coarse readings (0.08 m/s2) under strong vibration
#: three are alike by chance in a flight of some minutes.
_PILE = 5
_WINDOW_NS = 1_000_000_000
#: An extreme that was not met again for so long was a reading like others.
_FORGET_NS = 10_000_000_000
#: How long a warning stays: longer than the time between two diagnostics.
_WARN_NS = 5_000_000_000


class _End:
    """One end of one channel's range, as far as it was seen; magnitudes."""

    def __init__(self, level: float, stamp_ns: int, least: float) -> None:
        self.level, self.met_ns = level, stamp_ns
        self._least = least  # readings below it are not told
        self.known = False  # a pile was seen here
        self._hits_ns: deque[int] = deque()  # within the window
        self._short_ns: deque[int] = deque()
        self._jumped_ns: int | None = None  # newest hit that came from afar

    def outgrown(self, value: float, stamp_ns: int) -> bool:
        """Whether the range has another end than was thought."""
        return value > self.level * (1 + _SAME) or abs(stamp_ns - self.met_ns) > _FORGET_NS

    def add(self, value: float, stamp_ns: int, before: float) -> int:
        """How many samples are found clipped with this one: 0, 1, or all of a new pile."""
        if value < self.level * (1 - _SAME):
            if value > self.level * (1 - _SHORT):
                self._short_ns.append(stamp_ns)
            return 0
        self.met_ns, self.level = stamp_ns, max(value, self.level)
        self._hits_ns.append(stamp_ns)
        if before < self.level * (1 - _SHORT):
            self._jumped_ns = stamp_ns
        return 1 if self.known else self._piled(stamp_ns)

    def number(self) -> int:
        """Samples at the end within the second up to the newest of them."""
        _forget(self._hits_ns, self.met_ns)
        return len(self._hits_ns)

    def _piled(self, now_ns: int) -> int:
        _forget(self._short_ns, now_ns)
        number = self.number()
        jumped = self._jumped_ns is not None and abs(now_ns - self._jumped_ns) <= _WINDOW_NS
        all_told = self.level * (1 - _SHORT) >= self._least
        self.known = jumped and all_told and number >= max(_PILE, len(self._short_ns))
        return number if self.known else 0


class Clipping:
    """Follows the readings of the IMU; a sample in the middle of the range costs 0.5 us."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}  # channel -> samples at full scale
        self.since_ns: int | None = None  # when the newest spell began; None before the first
        self.newest_ns: int | None = None
        self._ends: dict[tuple[int, bool], _End] = {}  # by channel, and whether positive
        self._before: ImuSample | None = None

    def add(self, sample: ImuSample) -> None:
        """Take the next sample to come; its numbers must be finite."""
        before, self._before = self._before, sample
        x, y, z = sample.specific_force_b.tolist()
        p, q, r = sample.angular_rate_b.tolist()
        if x * x + y * y + z * z < _LEAST_M_S2_2 and p * p + q * q + r * r < _LEAST_RAD_S_2:
            return  # nearly always
        if before is not None:
            self._look(sample.stamp_ns, (x, y, z), before.specific_force_b.tolist(), 0)
            self._look(sample.stamp_ns, (p, q, r), before.angular_rate_b.tolist(), 3)

    def active(self, now_ns: int) -> bool:
        """Whether the IMU was at full scale within the last second."""
        return self.newest_ns is not None and abs(now_ns - self.newest_ns) <= _WINDOW_NS

    def warnings(self, now_ns: int) -> tuple[str, ...]:
        """Which channels, where and how often: for some seconds after."""
        if self.newest_ns is None or abs(now_ns - self.newest_ns) > _WARN_NS:
            return ()
        told = {
            channel: _told(channel, end)
            for (channel, _), end in sorted(self._ends.items(), key=lambda item: item[0])
            if end.known and abs(now_ns - end.met_ns) <= _WARN_NS
        }
        return tuple(told.values())

    def _look(
        self, stamp_ns: int, values: tuple[float, ...], earlier: list[float], first: int
    ) -> None:
        """The readings of one sensor (3,), one of which may be at an end."""
        if list(values) == earlier:
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
                self._note(CHANNELS[channel], stamp_ns, found)

    def _note(self, name: str, stamp_ns: int, found: int) -> None:
        self.counts[name] = self.counts.get(name, 0) + found
        if not self.active(stamp_ns):
            self.since_ns = stamp_ns
        self.newest_ns = stamp_ns


def _told(channel: int, end: _End) -> str:
    return (
        f"imu/data: {CHANNELS[channel]} clipped at {end.level:.3g} {_UNITS[channel]} "
        f"({end.number()} samples in 1 s): vibration beyond its range"
    )


def _forget(stamps_ns: deque[int], now_ns: int) -> None:
    """Drop what lies outside the window."""
    while stamps_ns and abs(now_ns - stamps_ns[0]) > _WINDOW_NS:
        stamps_ns.popleft()
