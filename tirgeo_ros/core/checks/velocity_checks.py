"""Check that a receiver's velocity is the derivative of its positions: axes, signs, unit.

Mean velocities over some seconds, by positions and by velocities, are compared under each
exchange of axes that drivers make. Sums of products give the residual of every exchange.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import VelocitySample

_STEP_NS, _LONGEST_NS = 1_000_000_000, 4_000_000_000
_KEPT = 1 - 1 / 60
#: Least rms speed, well above that of position errors of some decimetres, and number of intervals.
_LEAST_M_S, _LEAST_NUMBER = 1.0, 4
#: Share of the squares that remains under a wrong and under a right explanation.
_WRONG, _RIGHT = 0.5, 0.15
_SCALES = {3.6: "km/h", 1.94384: "knots", 100.0: "cm/s", 3.28084: "ft/s"}
_SCALE_ERROR = 0.15


class _Exchange(NamedTuple):
    name: str
    matrix: Array  # (2, 2): from the message's north and east to the true ones
    mend: str


_NED = "send ENU: x east, y north, z up"
_EXCHANGES = tuple(
    _Exchange(name, np.array(matrix, float), mend)
    for name, matrix, mend in (
        ("as they are", ((1, 0), (0, 1)), ""),
        ("with north and east exchanged", ((0, 1), (1, 0)), f"NED for ENU: {_NED}"),
        ("reversed", ((-1, 0), (0, -1)), f"both horizontal signs are wrong: {_NED}"),
        ("with east reversed", ((1, 0), (0, -1)), f"west for east: {_NED}"),
        ("with north reversed", ((-1, 0), (0, 1)), f"south for north: {_NED}"),
        ("turned by +90 deg", ((0, -1), (1, 0)), f"the axes are turned by 90 deg: {_NED}"),
        ("turned by -90 deg", ((0, 1), (-1, 0)), f"the axes are turned by 90 deg: {_NED}"),
    )
)


class VelocityChecks:
    """Compare one receiver's velocities with its positions (NED m of any plane)."""

    def __init__(self, topic: str, positions: str) -> None:
        self.topic, self.positions = topic, positions
        self._begin: tuple[int, Array] | None = None  # stamp and position of the interval's start
        self._velocities: list[tuple[int, Array]] = []  # since then
        self._number = 0.0
        self._across = np.zeros((2, 2))  # sums of products [position, velocity], (m/s)2
        self._squares = np.zeros(2)  # horizontal sums of squares: positions, velocities
        self._vertical = np.zeros(3)  # squares of positions, of velocities, and products

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
            mean = np.mean(inside, axis=0)
            self._compare((position_n - begin_n) / ((stamp_ns - begin_ns) * 1e-9), mean)
        self._restart(stamp_ns, position_n)

    def _restart(self, stamp_ns: int, position_n: Array) -> None:
        self._begin = stamp_ns, position_n
        self._velocities = [one for one in self._velocities if one[0] >= stamp_ns][-20:]

    def _compare(self, way: Array, velocity: Array) -> None:
        self._number = _KEPT * self._number + 1
        self._across = _KEPT * self._across + np.outer(way[:2], velocity[:2])
        squares = np.array((way[:2] @ way[:2], velocity[:2] @ velocity[:2]))
        self._squares = _KEPT * self._squares + squares
        a, b = float(way[2]), float(velocity[2])
        self._vertical = _KEPT * self._vertical + (a * a, b * b, a * b)

    def findings(self) -> list[Finding]:
        """Return the fault of the horizontal axes combined with that of the vertical one."""
        if self._number < _LEAST_NUMBER:
            return []
        found = self._horizontal()
        upside = self._upside_down()
        if found is None:
            return [upside] if upside else []
        if upside:
            evidence = f"{found.evidence}; up and down are reversed too"
            found = Finding(found.check, found.severity, evidence, found.parameter, found.mend)
        return [found]

    def _name(self, what: str) -> str:
        return f"{self.topic.replace('/', '_')}_{what}"

    def _horizontal(self) -> Finding | None:
        way, own = self._squares.tolist()
        if max(way, own) < _LEAST_M_S**2 * self._number or min(way, own) <= 0:
            return None
        likeness = [
            float(np.sum(self._across * e.matrix)) / math.sqrt(way * own) for e in _EXCHANGES
        ]
        # With the best scale, the share 1 - likeness^2 of the squares remains.
        left = [1 - max(one, 0.0) ** 2 for one in likeness]
        best = int(np.argmin(left))
        speeds = [math.sqrt(one / self._number) for one in (way, own)]
        speeds_text = (
            f"{self.topic} says {speeds[1]:.1f} m/s, {self.positions} moves at {speeds[0]:.1f}"
        )
        if left[0] > _WRONG and left[best] < _RIGHT:
            correlations = f"correlation {likeness[best]:.2f}, else {likeness[0]:+.2f}"
            evidence = (
                f"{self.topic} agrees with the changes of {self.positions} "
                f"{_EXCHANGES[best].name} ({correlations})"
            )
            mend = _EXCHANGES[best].mend
            return Finding(self._name("axes"), Severity.STOP, evidence, self.topic, mend)
        ratio = math.sqrt(own / way)
        if left[0] < _RIGHT and not 1 / 1.5 < ratio < 1.5:
            unit = [name for s, name in _SCALES.items() if abs(ratio / s - 1) < _SCALE_ERROR]
            mend = f"it is in {unit[0]}: send m/s" if unit else "send m/s"
            return Finding(self._name("unit"), Severity.STOP, speeds_text, self.topic, mend)
        if left[best] > _WRONG:
            mend = "does it come of this receiver, of now, in ENU?"
            return Finding(self._name("value"), Severity.STOP, speeds_text, self.topic, mend)
        return None

    def _upside_down(self) -> Finding | None:
        way, own, both = self._vertical.tolist()
        least = (0.4 * _LEAST_M_S) ** 2 * self._number
        if min(way, own) < least or both > -math.sqrt((1 - _RIGHT) * way * own):
            return None
        evidence = (
            f"{self.topic} climbs where {self.positions} sinks "
            f"(correlation {both / math.sqrt(way * own):+.2f})"
        )
        mend = "z is up: reverse its sign"
        return Finding(self._name("up"), Severity.STOP, evidence, self.topic, mend)
