"""Determine the unit of accelerations by their size, and whether they are specific force at all.

The broadcast's acceleration is what DJI Assistant 2 is set to: raw (g) or fused, without gravity.
Vibration is as large as gravity, so single readings prove nothing. Over half a second vibration
averages out, and about 1 g remains, at rest and in any flight except for moments.
"""

from __future__ import annotations

import math

from tirgeo_ros.dji.sources.readings import AccelerationUnit, Vector

#: The unit g of DJI's accelerometer is standard gravity by definition, not the local gravity. The
#: 9.801 and 9.8 of DJI's wrappers are rounded, by 0.06 and 0.07 % too small.
G_M_S2 = 9.80665

#: The first decision takes this time and this many readings, each later look takes _LATER_NS.
_FIRST_NS, _FIRST_NUMBER = 400_000_000, 20
_LATER_NS = 2_000_000_000
#: Fewer readings than this give no mean.
_LEAST_NUMBER = 5
#: Looks in a row that overturn a decision. A fused acceleration may look like 1 g in m/s2 for the
#: seconds in which an aircraft gains speed, but not for this many looks.
_OVERTURN = 3
#: Share of the readings that is trimmed at either end, against outliers.
_TRIMMED = 0.1
#: Full scale of any IMU on an aircraft, in either unit.
_LARGEST = 400.0
#: The mean of a flight stays between half and twice gravity for seconds.
_LEAST, _MOST = 0.5, 2.0
#: In g, along down: a larger mean is a specific force that points down.
_UPSIDE = 0.5


def factor_of(unit: AccelerationUnit) -> float | None:
    """Return the factor to m/s2; None where the source does not state the unit."""
    if unit is AccelerationUnit.G:  # by identity: hashing an Enum's member takes longer
        return G_M_S2
    return 1.0 if unit is AccelerationUnit.M_S2 else None


class ApparentAcceleration:
    """Average vectors over a time each: first over 0.4 s, then over 2 s."""

    def __init__(self) -> None:
        self._begun_ns: int | None = None
        self._newest_ns = 0
        self._span_ns, self._number = _FIRST_NS, _FIRST_NUMBER
        self._axes: tuple[list[float], list[float], list[float]] = ([], [], [])

    def add(self, stamp_ns: int, vector: Vector) -> Vector | None:
        """Take a vector; return the mean when its time is full, else None."""
        x, y, z = vector
        if not (abs(x) < _LARGEST and abs(y) < _LARGEST and abs(z) < _LARGEST):
            return None
        begun_ns = self._begun_ns
        if begun_ns is None or not 0 <= stamp_ns - self._newest_ns <= _FIRST_NS:
            self._begin()
            self._begun_ns = begun_ns = stamp_ns
        self._newest_ns = stamp_ns
        xs, ys, zs = self._axes
        xs.append(x)
        ys.append(y)
        zs.append(z)
        if stamp_ns - begun_ns < self._span_ns or len(xs) < self._number:
            return None
        return self.mean()

    def mean(self) -> Vector | None:
        """Return the mean of the vectors so far, if they are enough, and begin the next one."""
        if len(self._axes[0]) < _LEAST_NUMBER:
            return None
        x, y, z = map(_trimmed_mean, self._axes)
        self._begin()
        self._span_ns = _LATER_NS
        return x, y, z

    def _begin(self) -> None:
        self._begun_ns = None
        self._axes = ([], [], [])


def _trimmed_mean(values: list[float]) -> float:
    """Return the mean without the smallest and the largest tenth.

    A median would reject outliers as well, but fails for a vibration that has two values only.
    """
    out = int(_TRIMMED * len(values))
    kept = sorted(values)[out : len(values) - out]
    return sum(kept) / len(kept)


class UnitBySize:
    """Determine the unit of readings whose source does not state it."""

    def __init__(self, configured: str) -> None:
        """Take ``configured``: auto, g or m/s2, as the parameter ``acceleration_unit``."""
        self.told = configured == "auto"
        self.changes = 0
        self.factor: float | None = None  # to m/s2; 0: no specific force; None: not known yet
        self.size: float | None = None  # of the newest mean
        self._looks = ApparentAcceleration()
        self._against: list[float] = []
        if not self.told:
            self.factor = G_M_S2 if configured == "g" else 1.0

    def add(self, stamp_ns: int, acceleration: Vector) -> None:
        """Take a reading of any size."""
        if self.told:
            self._decide(self._looks.add(stamp_ns, acceleration))

    def settle(self) -> None:
        """Decide by the readings so far, at the end of the data."""
        if self.told and self.factor is None:
            self._decide(self._looks.mean())

    def _decide(self, mean: Vector | None) -> None:
        if mean is None:
            return
        self.size = math.hypot(*mean)
        fits = (f for f in (G_M_S2, 1.0) if _LEAST <= self.size * f / G_M_S2 <= _MOST)
        found = next(fits, 0.0)
        if self.factor is None:
            self.factor = found
            return
        same = not self._against or self._against[-1] == found
        self._against = [*(self._against if same else []), found]
        if found == self.factor:
            self._against = []
        elif len(self._against) >= _OVERTURN:
            self.factor, self._against = found, []
            self.changes += 1

    @property
    def warning(self) -> str:
        """Return what to set right, or an empty text."""
        if self.factor != 0.0:
            return ""
        return (
            f"acceleration averages {self.size:.2f}, which is gravity neither in g nor in m/s2: "
            "no imu/data of it. Set raw acceleration data in DJI Assistant 2 (SDK), not fused"
        )

    @property
    def text(self) -> str:
        """Return the unit for people, and how it is known."""
        names = {None: "not known yet", 0.0: "fused, without gravity", 1.0: "m/s2", G_M_S2: "g"}
        name = names[self.factor]
        if not self.told:
            return f"{name} (acceleration_unit)"
        return name if self.size is None else f"{name} (by its size, {self.size:.3f})"


class ForceCheck:
    """Check the size and the direction of the specific force that is published."""

    def __init__(self) -> None:
        self._looks = ApparentAcceleration()
        self._off = 0
        self._mean: Vector | None = None

    def add(self, stamp_ns: int, force_b: Vector) -> None:
        """Take a specific force (b, m/s2)."""
        mean = self._looks.add(stamp_ns, force_b)
        if mean is not None:
            self._mean = mean
            right = _LEAST <= math.hypot(*mean) / G_M_S2 <= _MOST
            self._off = 0 if right else self._off + 1

    @property
    def warning(self) -> str:
        """Return what to set right, or an empty text."""
        if self._mean is None:
            return ""
        if self._off:
            return (
                f"acceleration averages {math.hypot(*self._mean):.2f} m/s2 where gravity has 9.8: "
                "acceleration_unit is not that of the aircraft, or its data is not raw (DJI "
                "Assistant 2, SDK)"
            )
        if self._mean[2] > _UPSIDE * G_M_S2:
            return (
                f"specific force averages {self._mean[2]:+.1f} m/s2 along down where it has -9.8 "
                "at rest: the aircraft is upside down, or its acceleration has its z axis up (set "
                "raw data in DJI Assistant 2, SDK)"
            )
        return ""
