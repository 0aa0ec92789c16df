"""Check that a receiver's velocity is the derivative of its positions: axes, signs, unit.

Mean velocities over some seconds, by positions and by velocities, are compared under each
exchange of axes that drivers make. Sums of products give the residual of every exchange.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tirgeo_ros.core.checks.gyro_checks import RunningProducts
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import VelocitySample

_STEP_NS, _LONGEST_NS = 1_000_000_000, 4_000_000_000
#: Least rms speed, well above that of position errors of some decimetres, and number of intervals.
_LEAST_M_S, _LEAST_NUMBER = 1.0, 4
#: Share of the squares that remains under a wrong and under a right explanation.
_WRONG, _RIGHT = 0.5, 0.15
_SCALES = {3.6: "km/h", 1.94384: "knots", 100.0: "cm/s", 3.28084: "ft/s"}
_SCALE_ERROR = 0.15


_NED = "send ENU: x east, y north, z up"
#: Each exchange's name, its matrix from the message's north and east to the true ones, the mend.
_EXCHANGES = (
    ("as they are", np.array(((1, 0), (0, 1))), ""),
    ("with north and east exchanged", np.array(((0, 1), (1, 0))), f"NED for ENU: {_NED}"),
    ("reversed", np.array(((-1, 0), (0, -1))), f"both horizontal signs are wrong: {_NED}"),
    ("with east reversed", np.array(((1, 0), (0, -1))), f"west for east: {_NED}"),
    ("with north reversed", np.array(((-1, 0), (0, 1))), f"south for north: {_NED}"),
    ("turned by +90 deg", np.array(((0, -1), (1, 0))), f"the axes are turned by 90 deg: {_NED}"),
    ("turned by -90 deg", np.array(((0, 1), (-1, 0))), f"the axes are turned by 90 deg: {_NED}"),
)


class VelocityChecks:
    """Compare one receiver's velocities with its positions (NED m of any plane)."""

    def __init__(self, topic: str, positions: str) -> None:
        self.topic, self.positions = topic, positions
        self._begin: tuple[int, Array] | None = None  # stamp and position of the interval's start
        self._velocities: list[tuple[int, Array]] = []  # since then
        self._sums = RunningProducts(1 - 1 / 60)  # of changes of position and velocities, (m/s)2

    def velocity(self, sample: VelocitySample) -> None:
        """Take a velocity as it arrived."""
        if len(self._velocities) < 400:
            self._velocities.append((sample.stamp_ns, sample.velocity_n))

    def position(self, stamp_ns: int, position_n: Array) -> None:
        """Take a position (3,), NED, m."""
        if self._begin is None or not 0 < stamp_ns - self._begin[0] < _LONGEST_NS:
            self._restart(stamp_ns, position_n)
            return
        begin_ns, begin_n = self._begin
        if stamp_ns - begin_ns < _STEP_NS:
            return
        inside = [v for t, v in self._velocities if begin_ns <= t <= stamp_ns]
        if len(inside) >= 2:
            way = (position_n - begin_n) / ((stamp_ns - begin_ns) * 1e-9)
            self._sums.add(way, np.mean(inside, axis=0))
        self._restart(stamp_ns, position_n)

    def _restart(self, stamp_ns: int, position_n: Array) -> None:
        self._begin = stamp_ns, position_n
        self._velocities = [one for one in self._velocities if one[0] >= stamp_ns][-20:]

    def findings(self) -> list[Finding]:
        """Return the fault of the horizontal axes combined with that of the vertical one."""
        if self._sums.number < _LEAST_NUMBER:
            return []
        found, upside = self._horizontal(), self._upside_down()
        if found and upside:
            found = replace(found, evidence=f"{found.evidence}; up and down are reversed too")
        return [one for one in (found or upside,) if one]

    def _stop(self, what: str, evidence: str, mend: str) -> Finding:
        check = f"{self.topic.replace('/', '_')}_{what}"
        return Finding(check, Severity.STOP, evidence, self.topic, mend)

    def _horizontal(self) -> Finding | None:
        sums = self._sums
        way, own = float(sums.first[:2].sum()), float(sums.second[:2].sum())
        if max(way, own) < _LEAST_M_S**2 * sums.number or min(way, own) <= 0:
            return None
        across = sums.both[:2, :2] / math.sqrt(way * own)
        likeness = [float(np.sum(across * matrix)) for _, matrix, _ in _EXCHANGES]
        # With the best scale, the share 1 - likeness^2 of the squares remains.
        left = [1 - max(one, 0.0) ** 2 for one in likeness]
        best = int(np.argmin(left))
        moves, says = (math.sqrt(one / sums.number) for one in (way, own))
        speeds = f"{self.topic} says {says:.1f} m/s, {self.positions} moves at {moves:.1f}"
        if left[0] > _WRONG and left[best] < _RIGHT:
            name, _, mend = _EXCHANGES[best]
            evidence = (
                f"{self.topic} agrees with the changes of {self.positions} {name} "
                f"(correlation {likeness[best]:.2f}, else {likeness[0]:+.2f})"
            )
            return self._stop("axes", evidence, mend)
        ratio = says / moves
        if left[0] < _RIGHT and not 1 / 1.5 < ratio < 1.5:
            unit = [name for s, name in _SCALES.items() if abs(ratio / s - 1) < _SCALE_ERROR]
            mend = f"it is in {unit[0]}: send m/s" if unit else "send m/s"
            return self._stop("unit", speeds, mend)
        if left[best] > _WRONG:
            return self._stop("value", speeds, "does it come of this receiver, of now, in ENU?")
        return None

    def _upside_down(self) -> Finding | None:
        sums = self._sums
        way, own, both = float(sums.first[2]), float(sums.second[2]), float(sums.both[2, 2])
        least = (0.4 * _LEAST_M_S) ** 2 * sums.number
        if min(way, own) < least or both > -math.sqrt((1 - _RIGHT) * way * own):
            return None
        evidence = (
            f"{self.topic} climbs where {self.positions} sinks "
            f"(correlation {both / math.sqrt(way * own):+.2f})"
        )
        return self._stop("up", evidence, "z is up: reverse its sign")
