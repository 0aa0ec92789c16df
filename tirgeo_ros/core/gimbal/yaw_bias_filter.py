"""How far the gimbal's north is off the autopilot's, with its uncertainty.

A gimbal keeps a north of its own. The autopilot's changes (RTK that is switched on, a new home
point) and the gimbal's does not follow: between them stand some degrees, which the composition
``paper`` would take for a turned camera. The two states are

``b``
    the bias: camera heading as reported, less the autopilot's heading, less the camera's true
    angle from the nose; a random walk.
``c``
    how far off the nose the camera of a centred gimbal looks; a constant.

A centred gimbal shows b + c, encoders beside the reported attitude show b alone. Without ``c``,
whose size is given and which centred readings cannot tell from b, many readings would seem to
make b as well known as their mean.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import NorthConfig
from tirgeo_ros.core.types.verdicts import Outcome

#: A heading of which nothing is known: uniform over the circle.
_UNKNOWN_RAD2 = math.pi**2 / 3
#: A longer step is a clock that was set, not a flight.
_LONGEST_STEP_S = 3600.0
#: Refused readings in a row that it takes to believe them.
_LEAST_REFUSED = 3


class GimbalNorth:
    """A Kalman filter of the bias, fed with readings of it; angles are taken modulo a turn."""

    def __init__(self, config: NorthConfig) -> None:
        self.updates = 0
        self.refused = 0
        self.resets = 0
        self._state = np.array([math.radians(config.bias_deg), 0.0])
        sigmas = np.radians([config.sigma_deg, config.centred_sigma_deg])
        self._covariance = np.diag(sigmas**2)
        self._walk_rad2_s = math.radians(config.walk_deg) ** 2
        self._gate_sigma = config.gate_sigma
        self._reset_after_ns = round(config.reset_after_s * 1e9)
        self._stamp_ns: int | None = None
        self._refusals: list[tuple[int, float]] = []  # stamp, reading: in a row, all alike
        self._suspect_rad2 = 0.0

    @property
    def bias_rad(self) -> float:
        """The estimate of b."""
        return float(self._state[0])

    @property
    def variance(self) -> float:
        """The variance of b, rad2, at the newest instant.

        While the newest reading stands refused, the bias may have stepped to it: its square is
        part of the variance.
        """
        return min(float(self._covariance[0, 0]) + self._suspect_rad2, _UNKNOWN_RAD2)

    def advance(self, stamp_ns: int) -> None:
        """Let the bias walk to an instant; a stamp that goes back moves the clock alone."""
        if self._stamp_ns is not None:
            elapsed_s = min(max(1e-9 * (stamp_ns - self._stamp_ns), 0.0), _LONGEST_STEP_S)
            walked = float(self._covariance[0, 0]) + self._walk_rad2_s * elapsed_s
            self._covariance[0, 0] = min(walked, max(_UNKNOWN_RAD2, self._covariance[0, 0]))
        self._stamp_ns = stamp_ns

    def take(
        self, stamp_ns: int, reading_rad: float, variance: float, *, centred: bool
    ) -> Outcome:
        """Take a reading of b + c (``centred``) or of b, its noise of ``variance`` (rad2).

        USED, GATED, RESET (the last of refused readings that agree), or INVALID.
        """
        if not (math.isfinite(reading_rad) and 0 < variance < math.inf):
            return Outcome.INVALID
        self.advance(stamp_ns)
        design = np.array([1.0, 1.0 if centred else 0.0])
        innovation = math.remainder(reading_rad - float(design @ self._state), math.tau)
        cross = self._covariance @ design
        spread = float(design @ cross) + variance
        if innovation**2 > self._gate_sigma**2 * spread:
            return self._refuse(stamp_ns, reading_rad, variance, innovation, centred=centred)
        self._state += cross * (innovation / spread)
        self._covariance -= np.outer(cross, cross) / spread
        self._accept()
        return Outcome.USED

    def _accept(self) -> None:
        self.updates += 1
        self._refusals.clear()
        self._suspect_rad2 = 0.0
        self._state[0] = math.remainder(self._state[0], math.tau)

    def _refuse(
        self, stamp_ns: int, reading: float, variance: float, innovation: float, *, centred: bool
    ) -> Outcome:
        self.refused += 1
        self._suspect_rad2 = innovation**2
        if self._refusals and not self._alike(stamp_ns, reading, variance):
            self._refusals.clear()
        self._refusals.append((stamp_ns, reading))
        del self._refusals[1:-_LEAST_REFUSED]  # the first tells since when
        lasted_ns = stamp_ns - self._refusals[0][0]
        if len(self._refusals) < _LEAST_REFUSED or lasted_ns < self._reset_after_ns:
            return Outcome.GATED
        self._start_again(reading, variance, centred=centred)
        return Outcome.RESET

    def _alike(self, stamp_ns: int, reading: float, variance: float) -> bool:
        """Whether a reading may show the same bias as the one before."""
        before_ns, before = self._refusals[-1]
        if stamp_ns <= before_ns:
            return False
        spread = 2 * variance + self._walk_rad2_s * 1e-9 * (stamp_ns - before_ns)
        return math.remainder(reading - before, math.tau) ** 2 <= self._gate_sigma**2 * spread

    def _start_again(self, reading: float, variance: float, *, centred: bool) -> None:
        """What the reading leaves if nothing was known of b, and c as before."""
        offset, spread = (self._state[1], self._covariance[1, 1]) if centred else (0.0, 0.0)
        self._state[0] = reading - offset
        self._covariance[0] = variance + spread, -spread
        self._covariance[1, 0] = -spread
        self.resets += 1
        self._accept()
