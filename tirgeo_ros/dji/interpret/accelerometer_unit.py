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

#: The first mean is over this time and this many readings, each later one over _LATER_NS.
_FIRST_NS, _FIRST_NUMBER = 400_000_000, 20
_LATER_NS = 2_000_000_000
#: Fewer readings than this give no mean.
_LEAST_NUMBER = 5
#: Means in a row that overturn a decision. A fused acceleration may look like 1 g in m/s2 for the
#: seconds in which an aircraft gains speed, but not for this many means.
_OVERTURN = 3
#: Share of the readings that is trimmed at either end, against outliers. A median would reject
#: them as well, but fails for a vibration that has two values only.
_TRIMMED = 0.1
#: Full scale of any IMU on an aircraft, in either unit.
_LARGEST = 400.0
#: The mean of a flight stays between half and twice gravity for seconds.
_LEAST, _MOST = 0.5, 2.0

_NAMES = {None: "not known yet", 0.0: "fused, without gravity", 1.0: "m/s2", G_M_S2: "g"}
_FACTORS = {"g": G_M_S2, "m/s2": 1.0}


class StreamUnit:
    """Find the unit of one stream's accelerations.

    ``factor`` converts to m/s2; 0: no specific force; None: not known yet.
    """

    def __init__(self, configured: str) -> None:
        """Take ``configured``: auto, g or m/s2, as the parameter ``acceleration_unit``."""
        self.factor = _FACTORS.get(configured)
        self._how = "by its size" if self.factor is None else "acceleration_unit"
        self.changes = 0
        self._mean: Vector | None = None  # the newest, in the stream's unit
        self._against: list[float] = []  # factors by the newest means that contradict ``factor``
        self._span_ns, self._number = _FIRST_NS, _FIRST_NUMBER
        self._begun_ns: int | None = None
        self._newest_ns = 0
        self._readings: list[Vector] = []

    def add(self, stamp_ns: int, acceleration: Vector, unit: AccelerationUnit) -> None:
        """Take a reading (b) of any size, whose source may state the unit."""
        if unit is not AccelerationUnit.UNKNOWN:
            self.factor, self._how = _FACTORS[unit.value], "told"
        x, y, z = acceleration
        if not (abs(x) < _LARGEST and abs(y) < _LARGEST and abs(z) < _LARGEST):
            return
        begun_ns = self._begun_ns
        if begun_ns is None or not 0 <= stamp_ns - self._newest_ns <= _FIRST_NS:
            self._begun_ns = begun_ns = stamp_ns
            self._readings = []
        self._newest_ns = stamp_ns
        self._readings.append(acceleration)
        if stamp_ns - begun_ns >= self._span_ns and len(self._readings) >= self._number:
            self.settle()

    def settle(self) -> None:
        """Decide by the readings since the last mean, if they are enough."""
        if len(self._readings) < _LEAST_NUMBER:
            return
        x, y, z = map(_trimmed_mean, zip(*self._readings, strict=True))
        self._mean = (x, y, z)
        self._begun_ns, self._span_ns = None, _LATER_NS
        if self._how != "by its size":
            return
        size = math.hypot(x, y, z)
        fits = (f for f in (G_M_S2, 1.0) if _LEAST <= size * f / G_M_S2 <= _MOST)
        found = next(fits, 0.0)
        if self.factor is None:
            self.factor = found
        elif found == self.factor or (self._against and self._against[-1] != found):
            self._against = [found] if found != self.factor else []
        else:
            self._against.append(found)
        if len(self._against) >= _OVERTURN:
            self.factor, self._against = found, []
            self.changes += 1

    @property
    def warning(self) -> str:
        """Return what to set right, or an empty text; the graph checks size and sign."""
        if self._mean is None or self.factor != 0.0:
            return ""
        return (
            f"acceleration averages {math.hypot(*self._mean):.2f}, which is gravity neither in g "
            "nor in m/s2: no imu/data of it. Set raw acceleration data in DJI Assistant 2 (SDK), "
            "not fused"
        )

    @property
    def text(self) -> str:
        """Return the unit for people, and how it is known."""
        how = self._how
        if how == "by its size" and self._mean is not None:
            how = f"{how}, {math.hypot(*self._mean):.3f}"
        return _NAMES[self.factor] if self.factor is None else f"{_NAMES[self.factor]} ({how})"


def _trimmed_mean(values: tuple[float, ...]) -> float:
    """Return the mean without the smallest and the largest tenth."""
    out = int(_TRIMMED * len(values))
    kept = sorted(values)[out : len(values) - out]
    return sum(kept) / len(kept)
