# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
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

A centred gimbal follows the nose and lags behind while the nose turns, so the camera's heading
equals the nose's only after the nose has kept still. Encoders measure the camera's angle from the
nose at any time. But while the camera turns, time stamp errors of milliseconds would appear as
bias, so these measurements also need a still nose, though without the settling time.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import NorthConfig
from tirgeo_ros.core.frames.rotations import (
    azimuth,
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    wrapped,
)
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.verdicts import Outcome

# The filter.
#: Variance of an unknown heading: uniform over the circle.
_UNKNOWN_RAD2 = math.pi**2 / 3
#: A longer step between two stamps means that a clock was set: this much is propagated at most.
_LONGEST_STEP_S = 3600.0
#: Consecutive refused measurements needed before the filter is reset to them.
_LEAST_REFUSED = 3
# The measurements.
#: The nose is still while its heading stays within this range. A steady turn by this angle during
#: the settling time, which is six time constants, makes the camera lag by a sixth of it.
_STILL_RAD = math.radians(2.0)
#: A measurement is the mean over this time. The noise of two means is taken as independent.
_MEAN_S = 1.0
_LONGEST_GAP_S = 1.5
#: An axis with a smaller horizontal component is too steep for a useful azimuth.
_LEAST_HORIZONTAL = 0.5


class YawBiasFilter:
    """Estimate the bias with a Kalman filter; angle differences are taken modulo a full turn."""

    def __init__(self, config: NorthConfig) -> None:
        self.updates = 0
        self.refused = 0
        self.resets = 0
        self._stamp_ns: int | None = None
        self._initial: tuple[float, ...] = ()
        self.configure(config)

    def configure(self, config: NorthConfig) -> None:
        """Set the parameters, at start or in flight.

        If the initial bias or one of the two standard deviations changes, the filter restarts.
        """
        self._walk_rad2_s = math.radians(config.walk_deg) ** 2
        self._gate_sigma = config.gate_sigma
        self._reset_after_ns = round(config.reset_after_s * 1e9)
        initial = config.bias_deg, config.sigma_deg, config.centred_sigma_deg
        if initial != self._initial:
            self._initial = initial
            bias, *sigmas = np.radians(initial)
            self._state, self._covariance = np.array([bias, 0.0]), np.diag(np.square(sigmas))
            self._refusals: list[tuple[int, float]] = []  # (stamp, reading), all consistent
            self._suspect_rad2 = 0.0

    @property
    def bias_rad(self) -> float:
        """Return the estimate of b."""
        return float(self._state[0])

    @property
    def variance(self) -> float:
        """Return the variance of b, rad2, at the newest stamp.

        While the newest measurement is refused, the bias may have stepped to it, so the square of
        its innovation is added to the variance.
        """
        return min(float(self._covariance[0, 0]) + self._suspect_rad2, _UNKNOWN_RAD2)

    def advance(self, stamp_ns: int) -> None:
        """Propagate the bias to a stamp; an earlier stamp only sets the filter's time back."""
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
            self.refused += 1
            self._suspect_rad2 = innovation**2
            if self._refusals and not self._is_consistent(stamp_ns, reading_rad, variance):
                self._refusals.clear()
            self._refusals.append((stamp_ns, reading_rad))
            del self._refusals[1:-_LEAST_REFUSED]  # the first is kept for its stamp
            lasted_ns = stamp_ns - self._refusals[0][0]
            if len(self._refusals) < _LEAST_REFUSED or lasted_ns < self._reset_after_ns:
                return Outcome.GATED
            # Reset b to the measurement, as if b had been unknown; keep c.
            c, c_variance = (self._state[1], self._covariance[1, 1]) if centred else (0.0, 0.0)
            self._state[0] = reading_rad - c
            self._covariance[0] = variance + c_variance, -c_variance
            self._covariance[1, 0] = -c_variance
            self.resets += 1
            self._accept()
            return Outcome.RESET
        self._state += cross * (innovation / spread)
        self._covariance -= np.outer(cross, cross) / spread
        self._accept()
        return Outcome.USED

    def _accept(self) -> None:
        self.updates += 1
        self._refusals.clear()
        self._suspect_rad2 = 0.0
        self._state[0] = wrapped(self._state[0])

    def _is_consistent(self, stamp_ns: int, reading: float, variance: float) -> bool:
        """Return whether a measurement is consistent with the same bias as the previous one."""
        before_ns, before = self._refusals[-1]
        if stamp_ns <= before_ns:
            return False
        spread = 2 * variance + self._walk_rad2_s * 1e-9 * (stamp_ns - before_ns)
        return wrapped(reading - before) ** 2 <= self._gate_sigma**2 * spread


class YawBiasMeasurements:
    """Convert pairs of reported camera attitude and autopilot attitude into measurements."""

    def __init__(self, config: NorthConfig, reported_roll_sigma_rad: float) -> None:
        self._centred = SteadyMean(config.settle_s) if config.centred else None
        self._joints = SteadyMean(0.0)
        self._noise_rad2 = math.radians(config.noise_deg) ** 2
        self._roll_rad2 = reported_roll_sigma_rad**2

    def read(
        self, north: YawBiasFilter, stamp_ns: int, q_ng: Array, q_nb: Array, q_bg: Array | None
    ) -> None:
        """Update ``north`` with the measurements that the attitudes (4,) at one stamp give.

        ``q_ng`` is the reported camera attitude, ``q_nb`` the autopilot's attitude, ``q_bg`` the
        rotation measured by the encoders, or None.
        """
        nose_n = matrix_from_quat(q_nb)[:, 0]
        if math.hypot(nose_n[0], nose_n[1]) < _LEAST_HORIZONTAL:
            return
        nose = azimuth(nose_n)
        if q_bg is not None:
            # The turn about the vertical from the joints' attitude to the reported one. Errors of
            # either about level axes do not change it to first order.
            w, _, _, z = quat_multiply(q_ng, quat_conjugate(quat_multiply(q_nb, q_bg))).tolist()
            mean = None
            if math.hypot(w, z) > _LEAST_HORIZONTAL:  # else the tilt between them is too large
                mean = self._joints.add(stamp_ns, nose, 2 * math.atan2(z, w))
            if mean is not None:
                # The reported roll's error is about the optical axis: in part about the vertical.
                down = float(matrix_from_quat(q_ng)[2, 0])
                variance = self._noise_rad2 + self._roll_rad2 * down * down
                north.take(stamp_ns, mean, variance, centred=False)
        # The heading comes from the camera's right axis: it is defined looking straight down too.
        right_n = matrix_from_quat(q_ng)[:, 1]
        if self._centred is not None and math.hypot(right_n[0], right_n[1]) >= _LEAST_HORIZONTAL:
            heading = azimuth(right_n) - math.pi / 2
            mean = self._centred.add(stamp_ns, nose, heading - nose)
            if mean is not None:
                north.take(stamp_ns, mean, self._noise_rad2, centred=True)


class SteadyMean:
    """Average an angle over one second at a time while the nose keeps still."""

    def __init__(self, settle_s: float) -> None:
        """Use values only after the nose has kept still for ``settle_s``."""
        self._settle_ns = round(settle_s * 1e9)
        self._since_ns: int | None = None
        self._newest_ns = 0
        self._nose = 0.0
        self._low = self._high = 0.0
        self._begun_ns: int | None = None
        self._offsets: list[float] = []
        self._first = 0.0

    def add(self, stamp_ns: int, nose_rad: float, angle_rad: float) -> float | None:
        """Add an angle and the nose's heading; return the mean if a second is full, else None."""
        still = False
        if self._since_ns is not None and 0 <= stamp_ns - self._newest_ns < _LONGEST_GAP_S * 1e9:
            turned = wrapped(nose_rad - self._nose)
            self._low, self._high = min(self._low, turned), max(self._high, turned)
            still = self._high - self._low <= _STILL_RAD
        if not still:
            self._since_ns, self._nose = stamp_ns, nose_rad
            self._low = self._high = 0.0
            self._begun_ns = None
        self._newest_ns = stamp_ns
        if self._since_ns is None or stamp_ns - self._since_ns < self._settle_ns:
            return None
        if self._begun_ns is None:
            self._begun_ns, self._first = stamp_ns, angle_rad
            self._offsets = []
        # Differences from the first, so that angles on both sides of 180 deg average correctly.
        self._offsets.append(wrapped(angle_rad - self._first))
        if stamp_ns - self._begun_ns < _MEAN_S * 1e9:
            return None
        self._begun_ns = None
        return wrapped(self._first + float(np.mean(self._offsets)))
