"""Check that a receiver's velocity is the derivative of its positions: axes, signs, unit.

Mean velocities over a second or more, by positions and by velocities, are compared under each
exchange of axes and signs.
"""

from __future__ import annotations

import itertools
import math
from collections import deque

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import VelocitySample

_STEP_NS, _LONGEST_NS = 1_000_000_000, 4_000_000_000
_KEPT, _LEAST_NUMBER = 60, 4  # intervals
#: Least rms speed, well above that of position errors of some decimetres.
_LEAST_M_S, _LEAST_CLIMB_M_S = 1.0, 0.4
_SURE = 0.92  # correlation of climbs with a wrong sign
#: Share of the squares that remains under a wrong and under a right explanation.
_WRONG, _RIGHT = 0.5, 0.15
#: What speeds in another unit than m/s are multiplied by; beside it, so much (8 %) as noise that
#: leaves the share _RIGHT can make of it.
_UNITS = {"km/h": 3.6, "knots": 1.944, "mph": 2.237, "ft/s": 3.281, "cm/s": 100.0, "mm/s": 1000.0}
_BESIDE = -0.5 * math.log(1 - _RIGHT)
#: Matrices from the message's north and east to the true ones; the first one is the identity.
_EXCHANGES = [
    np.array((first, second)) @ axes
    for axes in (np.eye(2), np.eye(2)[::-1])
    for first, second in itertools.product(((1, 0), (-1, 0)), ((0, 1), (0, -1)))
]


class VelocityChecks:
    """Compare one receiver's velocities with its positions (NED m of any plane)."""

    def __init__(self, topic: str, positions: str) -> None:
        self._topic, self._positions = topic, positions
        self._begin: tuple[int, Array] | None = None  # stamp and position of the interval's start
        self._velocities: deque[tuple[int, Array]] = deque(maxlen=400)
        # of each interval: its mean velocity by the positions and by the velocities
        self._pairs: deque[tuple[Array, Array]] = deque(maxlen=_KEPT)

    def velocity(self, sample: VelocitySample) -> None:
        """Take a velocity as it arrived."""
        self._velocities.append((sample.stamp_ns, sample.velocity_n))

    def position(self, stamp_ns: int, position_n: Array) -> None:
        """Take a position (3,), NED, m."""
        begin_ns, begin_n = self._begin or (stamp_ns, position_n)
        if 0 <= stamp_ns - begin_ns < _STEP_NS and self._begin:
            return
        self._begin = stamp_ns, position_n
        inside = [v for t, v in self._velocities if begin_ns <= t <= stamp_ns]
        if len(inside) >= 2 and 0 < stamp_ns - begin_ns < _LONGEST_NS:
            way_n = (position_n - begin_n) / ((stamp_ns - begin_ns) * 1e-9)
            self._pairs.append((way_n, np.mean(inside, axis=0)))

    def findings(self) -> list[Finding]:
        """Return the fault of the horizontal axes, of the unit, or of the sign of climbs."""
        if len(self._pairs) < _LEAST_NUMBER:
            return []
        ways, own = map(np.array, zip(*self._pairs, strict=True))
        found = self._horizontal(ways[:, :2], own[:, :2]) or self._vertical(ways[:, 2], own[:, 2])
        return [found] if found else []

    def _vertical(self, ways: Array, own: Array) -> Finding | None:
        """Check mean velocities (N,), m/s, down, by positions and by velocities."""
        moves, says = (math.sqrt((one**2).mean()) for one in (ways, own))
        if (
            min(moves, says) < _LEAST_CLIMB_M_S
            or float((ways * own).mean()) > -_SURE * moves * says
        ):
            return None
        evidence = f"{self._topic} climbs where {self._positions} sinks"
        return self._stop("up", evidence, "z is up: reverse its sign")

    def _horizontal(self, ways: Array, own: Array) -> Finding | None:
        """Check mean velocities (N, 2), m/s, north and east, by positions and by velocities."""
        moves, says = (math.sqrt((one**2).sum(axis=1).mean()) for one in (ways, own))
        if max(moves, says) < _LEAST_M_S or moves <= 0:
            return None
        if says <= 0:
            evidence = f"{self._topic} is always 0, {self._positions} moves at {moves:.1f} m/s"
            mend = "send this receiver's velocity, or no such topic"
            return self._stop("zero", evidence, mend)
        across = ways.T @ own / (len(ways) * moves * says)
        likeness = np.array([np.sum(across * matrix) for matrix in _EXCHANGES])
        left = 1 - np.maximum(likeness, 0) ** 2  # share of the squares, with the best scale
        best = int(np.argmin(left))
        if left[0] > _WRONG and left[best] < _RIGHT:
            north, east = (
                f"{'-' if min(row) < 0 else ''}{('north', 'east')[int(np.argmax(np.abs(row)))]}"
                for row in _EXCHANGES[best]
            )
            evidence = (
                f"{self._topic} agrees with the changes of {self._positions} if its north, east "
                f"are {north}, {east} (correlation {likeness[best]:.2f}, else {likeness[0]:+.2f})"
            )
            mend = "NED for ENU? Send x east, y north, z up"
            return self._stop("axes", evidence, mend)
        # Noise changes speeds as it changes directions; other axes do not.
        apart = np.linalg.norm(ways, axis=1) - np.linalg.norm(own, axis=1)
        if left[best] > _WRONG and float(np.mean(apart**2)) < _RIGHT * moves * says:
            evidence = f"{self._topic} has the speeds of {self._positions} in other directions"
            mend = "send the velocity of this receiver, in ENU, not in axes of the body"
            return self._stop("axes", evidence, mend)
        return self._of_unit(moves, says) if left[best] < _RIGHT else None

    def _of_unit(self, moves: float, says: float) -> Finding | None:
        """Check speeds (m/s) of one motion by positions and by velocities."""
        off = abs(math.log(says / moves))
        unit, factor = min(_UNITS.items(), key=lambda one: abs(off - math.log(one[1])))
        if not abs(off - math.log(factor)) < _BESIDE:
            return None
        evidence = f"{self._topic} says {says:.1f} m/s, {self._positions} moves at {moves:.1f}"
        mend = f"send m/s: {factor:.3g} times as much, or as little, is {unit}"
        return self._stop("unit", evidence, mend)

    def _stop(self, what: str, evidence: str, mend: str) -> Finding:
        check = f"{self._topic.replace('/', '_')}_{what}"
        return Finding(check, Severity.STOP, evidence, self._topic, mend)
