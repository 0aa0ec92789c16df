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
"""Test whether the IMU's biases agree with the parameters, and enlarge their prior if not.

Under a true prior, the biases of a fit have the covariance ``P - P'`` (prior less posterior), so
their normalised square is chi-square over the directions that the window observes. A value far
beyond chance means that the IMU is of another class than ``imu.*_turn_on_bias``. Its errors may
then hide in the tilt as well. So the prior is enlarged, and the alignment waits for a motion that
separates tilt and accelerometer bias.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import quat_from_matrix, rotvec_from_quat
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases, WindowFit
from tirgeo_ros.core.navigation.alignment.window_estimate import (
    MOTION_STAGE,
    FittedWindow,
    Measured,
    NotAlignedError,
    Recurrence,
    checked,
    differences,
    fit_window,
    tilt_between,
)
from tirgeo_ros.core.types.arrays import Array

#: A direction counts if the window removes at least this share of its prior variance.
_LEAST_SHOWN = 0.1
#: Surprise above which a longer window must be fitted, and above which it is not chance.
_SUSPECT_SIGMA, _SURPRISE_SIGMA = 3.0, 4.0
#: Sigma of the gyroscope bias by the autopilot's attitudes over a second, and its growth
#: with the rate: the autopilot's axes and the IMU's are some degrees apart.
_HINT_GYRO_RAD_S, _HINT_GYRO_SHARE = 5e-3, 0.05
#: Prior sigmas that cover any IMU, 9 deg/s and 0.15 g, to find the size of the biases.
_ANY_GYRO_RAD_S, _ANY_ACCEL_M_S2 = 0.15, 1.5
#: Ratio of the enlarged sigma to the largest bias found: others may be larger.
_MARGIN = 2.0
#: Tilt error of an autopilot, beyond its configured sigma, per m/s2 of acceleration. The mean
#: over a long turn does not show the acceleration, so the tilt is not compared there.
_HINT_DEG_PER_M_S2, _LONG_TURN_RAD = 1.0, np.radians(60.0)
_LEAN_SIGMAS = 3.0
_LARGEST_LEAN_RAD = np.radians(10.0)  # 0.17 g: beyond it the autopilot's axes are wrong
_LARGEST_TILT_SIGMA_RAD = np.radians(1.0)
_GRAVITY_M_S2 = 9.81
#: Biases are accepted after this time; one wrong measurement leaves the second window earlier.
_SURE_S = 2.6
_LONG_WINDOW_S = 2.4  # the second window, less one sample


def surprise(biases: Array, covariance: Array, prior: Biases) -> float:
    """Return how far biases (6,) with their covariance (6, 6) are from their prior, in sigmas.

    The cube root of a chi-square over its degrees is nearly normal (Wilson and Hilferty, 1931).
    """
    root = np.linalg.inv(np.linalg.cholesky(prior.covariance))
    shown, axes = np.linalg.eigh(np.eye(6) - root @ covariance @ root.T)  # prior less posterior
    apart = axes.T @ root @ (biases - prior.vector)
    keep = shown > _LEAST_SHOWN
    if not keep.any():
        return 0.0
    spread = 2 / (9 * keep.sum())
    return float((np.cbrt(np.mean(apart[keep] ** 2 / shown[keep])) - 1 + spread) / np.sqrt(spread))


def _surprise_of(fitted: FittedWindow, prior: Biases) -> float:
    """Return the surprise of a fit, after an update with the autopilot's gyroscope bias."""
    biases, covariance = fitted.fit.biases, fitted.fit.covariance[9:, 9:]
    if fitted.gyro_bias_b is not None and _apart_rad(fitted) < _LARGEST_LEAN_RAD:
        rate_rad_s = np.sqrt(np.mean(np.sum(fitted.window.rate_b**2, axis=1)))
        sigma = _HINT_GYRO_RAD_S + _HINT_GYRO_SHARE * rate_rad_s
        gain = covariance[:, :3] @ np.linalg.inv(covariance[:3, :3] + np.eye(3) * sigma**2)
        biases = biases + gain @ (fitted.gyro_bias_b - biases[:3])
        covariance = covariance - gain @ covariance[:3]
    return surprise(biases, covariance, prior)


def _apart_rad(fitted: FittedWindow) -> float:
    """Return the angle between fitted and autopilot's vertical; pi without an autopilot."""
    return (
        np.pi if fitted.hint_nb is None else tilt_between(fitted.fit.rotation_nb, fitted.hint_nb)
    )


class TurnOnBiases:
    """Hold the prior of the IMU's biases; ``widened`` once it has proved far too narrow."""

    def __init__(self, config: EkfConfig, prior: Biases | None) -> None:
        self._config = config
        self._prior = prior or Biases.expected(config.imu.bias_b, config.imu.bias_variances)
        self._taken = self._prior.vector
        self.widened = False
        self._doubt = Recurrence()
        self._suspected_ns = NEVER_NS

    def fit(self, measured: Measured, now_ns: int) -> FittedWindow:
        """Fit a window with the prior or, if need be, a wider one; raises NotAlignedError."""
        if self.widened:
            return self._fitted_widely(measured)
        fitted = fit_window(measured, self._config, self._prior, self._taken)
        beyond = _surprise_of(fitted, self._prior) > _SURPRISE_SIGMA
        hint_nb, autopilot = fitted.hint_nb, self._config.autopilot
        # Where the heading contradicts the autopilot's, no bias is the cause.
        turned = hint_nb is not None and "heading" in differences(fitted.fit, hint_nb, autopilot)
        if turned or not (beyond or self._lean_rad(fitted) > 0):
            checked(fitted)
            if _surprise_of(fitted, self._prior) > _SUSPECT_SIGMA:
                self._suspected_ns = now_ns
            lately = now_ns - self._suspected_ns < _SURE_S * 1e9
            if lately and fitted.window.before_s[0] < _LONG_WINDOW_S:
                raise NotAlignedError("imu/data: alignment takes longer, to find the biases", 4)
            return fitted
        sigmas = np.repeat([_ANY_GYRO_RAD_S, _ANY_ACCEL_M_S2], 3)
        any_imu = Biases.expected(self._config.imu.bias_b, sigmas**2)
        try:
            loose = self._loosely(measured, any_imu)
        except NotAlignedError:  # biases are not the cause, or not the only one
            checked(fitted)
            raise NotAlignedError("imu/data does not fit the measured motion") from None
        if self._doubt.again_s(now_ns) < _SURE_S:  # a wrong measurement may look like biases
            checked(fitted)
            self._suspected_ns = now_ns
            raise NotAlignedError(self._reason(fitted, loose))
        self._widen(fitted, loose)
        return self._fitted_widely(measured)

    def _fitted_widely(self, measured: Measured) -> FittedWindow:
        fitted = self._loosely(measured, self._prior)
        self._taken = fitted.fit.biases
        if _tilt_sigma_rad(fitted.fit) > _LARGEST_TILT_SIGMA_RAD:
            raise NotAlignedError(self._motion_reason, MOTION_STAGE)
        return fitted

    def _loosely(self, measured: Measured, prior: Biases) -> FittedWindow:
        """Fit a window and the autopilot's turn; NotAlignedError if biases do not explain it."""
        return checked(fit_window(measured, self._config, prior, self._taken, gyros_unknown=True))

    def _widen(self, plain: FittedWindow, loose: FittedWindow) -> None:
        """Enlarge the prior to cover the biases of ``loose``, fitted with a prior for any IMU."""
        gyro, accel = self._sizes(plain, loose)
        sigma = np.sqrt(self._config.imu.bias_variances)
        ratio = max(1.0, *(gyro / sigma[:3]))
        larger = max(ratio, *(accel / sigma[3:]))
        scale = _MARGIN * np.repeat([ratio, larger], 3)
        self._prior = Biases.expected(self._config.imu.bias_b, (scale * sigma) ** 2)
        self._taken = loose.fit.biases
        self._motion_reason = (
            f"{self._reason(plain, loose)}: needs motion (turns) to find them, or larger turn-on "
            "sigmas"
        )
        self.widened = True

    def _reason(self, plain: FittedWindow, loose: FittedWindow) -> str:
        """Describe the biases that the parameters do not cover."""
        gyro, accel = self._sizes(plain, loose)
        return (
            f"imu/data: biases of {np.degrees(gyro):.1f} deg/s and {accel:.2g} m/s2 are far "
            "beyond imu.gyro_turn_on_bias, imu.accel_turn_on_bias"
        )

    def _sizes(self, plain: FittedWindow, loose: FittedWindow) -> tuple[float, float]:
        """Return the largest bias of the gyroscopes, rad/s, and of the accelerometers, m/s2."""
        gyro, accel = np.abs(loose.fit.biases.reshape(2, 3)).max(axis=1).tolist()
        return gyro, max(accel, _GRAVITY_M_S2 * self._lean_rad(plain))

    def _lean_rad(self, fitted: FittedWindow) -> float:
        """Return the angle of the tilt from the autopilot's tilt; 0 if it may be chance."""
        window, fit = fitted.window, fitted.fit
        turned = rotvec_from_quat(quat_from_matrix(window.to_end[0]))
        if fitted.hint_nb is None or np.linalg.norm(turned) > _LONG_TURN_RAD:
            return 0.0
        force_b = window.velocity[0] / window.before_s[0] - (fit.biases - window.taken)[3:]
        # The mean acceleration over the window.
        sped = np.linalg.norm(fit.rotation_nb @ force_b + np.array([0.0, 0.0, _GRAVITY_M_S2]))
        sigma_deg = max(self._config.autopilot.attitude_sigma_deg[:2])
        autopilot_rad = np.radians(sigma_deg + _HINT_DEG_PER_M_S2 * float(sped))
        limit = _LEAN_SIGMAS * float(np.hypot(autopilot_rad, _tilt_sigma_rad(fit)))
        apart = _apart_rad(fitted)
        return apart if limit < apart < _LARGEST_LEAN_RAD else 0.0


def _tilt_sigma_rad(fit: WindowFit) -> float:
    """Return the larger sigma of the two tilt angles, the biases' uncertainty included."""
    return float(np.sqrt(max(fit.covariance[0, 0], fit.covariance[1, 1])))
