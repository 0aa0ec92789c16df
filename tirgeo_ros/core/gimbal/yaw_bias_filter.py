"""Estimate the bias of the gimbal's north relative to the autopilot's, with its uncertainty.

A gimbal keeps its own north. When the autopilot's north changes (RTK switched on, a new home
point), the gimbal's does not follow. They then differ by some degrees, which the composition
``paper`` would take for a turn of the camera. The two states are

``b``
    the bias: reported camera heading, minus the autopilot's heading, minus the camera's true
    angle from the nose; a random walk.
``c``
    the angle from the nose at which the camera of a centred gimbal looks; a constant.

A centred gimbal measures b + c; encoders together with the reported attitude measure b alone.
Measurements of a centred gimbal cannot separate c from b; the prior sigma of c is configured.
Without the state c, many such measurements would make b look as well known as their mean.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import NorthConfig
from tirgeo_ros.core.frames.heading import wrapped
from tirgeo_ros.core.types.verdicts import Outcome

#: Variance of an unknown heading: uniform over the circle.
_UNKNOWN_RAD2 = math.pi**2 / 3
#: A longer step means that a clock was set, not that a flight went on.
_LONGEST_STEP_S = 3600.0
#: Consecutive refused measurements needed before the filter is reset to them.
_LEAST_REFUSED = 3


class YawBiasFilter:
    """Estimate the bias with a Kalman filter; angle differences are taken modulo a full turn."""

    def __init__(self, config: NorthConfig) -> None:
        self.updates = 0
        self.refused = 0
        self.resets = 0
        self._stamp_ns: int | None = None
        self._begun: tuple[float, ...] = ()
        self.configure(config)

    def configure(self, config: NorthConfig) -> None:
        """Take the parameters, also others in flight; begin again where those of the start change.

        These are the bias and the two standard deviations.
        """
        self._walk_rad2_s = math.radians(config.walk_deg) ** 2
        self._gate_sigma = config.gate_sigma
        self._reset_after_ns = round(config.reset_after_s * 1e9)
        begun = config.bias_deg, config.sigma_deg, config.centred_sigma_deg
        if begun != self._begun:
            self._begun = begun
            bias, *sigmas = np.radians(begun)
            self._state, self._covariance = np.array([bias, 0.0]), np.diag(np.square(sigmas))
            self._refusals: list[tuple[int, float]] = []  # (stamp, reading), all consistent
            self._suspect_rad2 = 0.0

    @property
    def bias_rad(self) -> float:
        """Return the estimate of b."""
        return float(self._state[0])

    @property
    def variance(self) -> float:
        """Return the variance of b, rad2, at the newest instant.

        While the newest measurement is refused, the bias may have stepped to it, so the square of
        its innovation is added to the variance.
        """
        return min(float(self._covariance[0, 0]) + self._suspect_rad2, _UNKNOWN_RAD2)

    def advance(self, stamp_ns: int) -> None:
        """Propagate the bias to an instant; a stamp that goes back only sets the filter's time."""
        if self._stamp_ns is not None:
            elapsed_s = min(max(1e-9 * (stamp_ns - self._stamp_ns), 0.0), _LONGEST_STEP_S)
            walked = float(self._covariance[0, 0]) + self._walk_rad2_s * elapsed_s
            self._covariance[0, 0] = min(walked, max(_UNKNOWN_RAD2, self._covariance[0, 0]))
        self._stamp_ns = stamp_ns

    def take(
        self, stamp_ns: int, reading_rad: float, variance: float, *, centred: bool
    ) -> Outcome:
        """Update with a measurement of b + c (``centred``) or of b; ``variance`` is in rad2.

        Return USED, GATED, RESET (the last of consistent refused measurements), or INVALID.
        """
        if not (math.isfinite(reading_rad) and 0 < variance < math.inf):
            return Outcome.INVALID
        self.advance(stamp_ns)
        design = np.array([1.0, 1.0 if centred else 0.0])
        innovation = wrapped(reading_rad - float(design @ self._state))
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
        self._state[0] = wrapped(self._state[0])

    def _refuse(
        self, stamp_ns: int, reading: float, variance: float, innovation: float, *, centred: bool
    ) -> Outcome:
        self.refused += 1
        self._suspect_rad2 = innovation**2
        if self._refusals and not self._is_consistent(stamp_ns, reading, variance):
            self._refusals.clear()
        self._refusals.append((stamp_ns, reading))
        del self._refusals[1:-_LEAST_REFUSED]  # the first is kept for its stamp
        lasted_ns = stamp_ns - self._refusals[0][0]
        if len(self._refusals) < _LEAST_REFUSED or lasted_ns < self._reset_after_ns:
            return Outcome.GATED
        self._start_again(reading, variance, centred=centred)
        return Outcome.RESET

    def _is_consistent(self, stamp_ns: int, reading: float, variance: float) -> bool:
        """Return whether a measurement is consistent with the same bias as the previous one."""
        before_ns, before = self._refusals[-1]
        if stamp_ns <= before_ns:
            return False
        spread = 2 * variance + self._walk_rad2_s * 1e-9 * (stamp_ns - before_ns)
        return wrapped(reading - before) ** 2 <= self._gate_sigma**2 * spread

    def _start_again(self, reading: float, variance: float, *, centred: bool) -> None:
        """Reset b to the measurement, as if nothing had been known of it; keep c."""
        offset, spread = (self._state[1], self._covariance[1, 1]) if centred else (0.0, 0.0)
        self._state[0] = reading - offset
        self._covariance[0] = variance + spread, -spread
        self._covariance[1, 0] = -spread
        self.resets += 1
        self._accept()
