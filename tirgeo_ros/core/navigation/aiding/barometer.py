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
"""Aid the filter with a barometer's height while that is more certain than the state's height.

Pressure gives a height in the standard atmosphere; weather, temperature and the air's flow around
the aircraft make it differ from the true height by metres. This offset is measured while a
satellite position holds the state's height. Without such a position, pressure less the offset
gives the height. The error of a barometer lasts: averaging many readings does not remove it. So a
reading never makes the height's variance smaller than twice that of this lasting error.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.navigation.aiding.aid import Aid, AidMeasurement, Modelled, StateEstimate
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack
from tirgeo_ros.core.navigation.ins.error_states import POSITION
from tirgeo_ros.core.navigation.ins.kalman import Measurement, chi_square_limit
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.types.measurements import PressureSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: The standard atmosphere at sea level, and up to 11 km (ISO 2533:1975; ICAO Doc 7488, 3rd ed.).
_PRESSURE_PA, _TEMPERATURE_K, _LAPSE_K_M = 101_325.0, 288.15, 0.0065
_GAS_J_KG_K, _GRAVITY_M_S2 = 287.05287, 9.80665
_EXPONENT = _GAS_J_KG_K * _LAPSE_K_M / _GRAVITY_M_S2
_DOWN = POSITION.stop - 1
_POSITIONS = (Source.RTK_POSITION, Source.GPS_POSITION)
#: Readings that follow the last examined one sooner are skipped: they have the same error.
_LEAST_STEP_NS = 90_000_000


def standard_height_m(pressure_pa: float) -> float:
    """Return the geopotential height in the standard atmosphere's lowest layer, m.

    ``h = T0 / L (1 - (p / p0)^(R L / g0))``: the barometric equation of ISO 2533, solved for h.
    """
    ratio = (pressure_pa / _PRESSURE_PA) ** _EXPONENT
    return float(_TEMPERATURE_K / _LAPSE_K_M * (1.0 - ratio))


def standard_pressure_pa(height_m: float) -> float:
    """Return the pressure, Pa: the inverse of ``standard_height_m``."""
    ratio = 1.0 - _LAPSE_K_M / _TEMPERATURE_K * height_m
    return float(_PRESSURE_PA * ratio ** (1 / _EXPONENT))


def metres_per_pa(pressure_pa: float) -> float:
    """Return the gain of height per pascal of lower pressure, m/Pa: ``R T / (g0 p)``."""
    temperature_k = _TEMPERATURE_K * (pressure_pa / _PRESSURE_PA) ** _EXPONENT
    return float(_GAS_J_KG_K * temperature_k / (_GRAVITY_M_S2 * pressure_pa))


class Reference(NamedTuple):
    """Hold the newest measured offset of the standard height from the state's height."""

    stamp_ns: int
    height_m: float  # standard height at that time
    offset_m: float  # standard height less the state's
    variance_m2: float  # of the offset
    taken_ns: int  # stamp of the newest reading examined


class BarometerAid(Aid):
    """Use the height by pressure once the state's height is less certain."""

    source = Source.BAROMETER
    delay = "barometer.delay_s"
    look_at = "barometer.sigma_m, barometer.noise_m"
    moved = "offset of baro/pressure changed by"

    def spare(self, sample: PressureSample, aids: AidStatus) -> bool:
        """Return whether another reading was examined less than 0.09 s before."""
        own = aids.track(self.source).own
        return own is not None and 0 <= sample.stamp_ns - own.taken_ns < _LEAST_STEP_NS

    def measured(
        self, sample: PressureSample, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement; STANDBY while the state is better and sets the reference."""
        aids, stamp_ns = estimate.aids, sample.stamp_ns
        has_position = any(aids.track(s).recent(stamp_ns, self._timeout_ns) for s in _POSITIONS)
        height_m = standard_height_m(sample.pressure_pa)
        reported_m2 = sample.variance_pa2 * metres_per_pa(sample.pressure_pa) ** 2
        noise_m2 = max(reported_m2, self._config.barometer.noise_m**2)
        own_m2 = float(estimate.covariance[_DOWN, _DOWN])
        before = aids.track(self.source)
        if before.own is None and not has_position:
            reason = "no satellite position to take the height from"
            return Verdict(self.source, Outcome.STANDBY, reason), estimate
        if before.own is None:
            offset_m = height_m - estimate.state.height_m
            first = Reference(stamp_ns, height_m, offset_m, noise_m2 + own_m2, stamp_ns)
            verdict = Verdict(self.source, Outcome.STANDBY, "takes its reference height")
            return verdict, _with_reference(estimate, first)
        reference: Reference = before.own._replace(taken_ns=stamp_ns)
        lasting_m2 = self._offset_m2(reference, stamp_ns, height_m)
        off_m = estimate.state.height_m - (height_m - reference.offset_m)
        aid = self._measurement(stamp_ns, estimate, off_m, (lasting_m2, noise_m2))
        nis = off_m * off_m / (own_m2 + lasting_m2 + noise_m2)
        ratio = nis / chi_square_limit(self._config.barometer.gate_sigma, 1)
        if own_m2 > 2 * lasting_m2 or ratio > 1:
            return aid, _with_reference(estimate, reference, before)
        if has_position and own_m2 < lasting_m2:
            gain = lasting_m2 / (lasting_m2 + noise_m2 + own_m2)
            offset_m = reference.offset_m - gain * off_m
            left_m2 = max((1 - gain) * lasting_m2, own_m2)
            reference = Reference(stamp_ns, height_m, offset_m, left_m2, stamp_ns)
        reason = "the filter's height is more precise"
        verdict = Verdict(self.source, Outcome.STANDBY, reason, ratio, (off_m,), nis)
        return verdict, _with_reference(estimate, reference)

    def patience_s(self, _aid: AidMeasurement, _estimate: StateEstimate) -> float:
        """Return how long a run of refusals must last."""
        return self._config.barometer.reset_after_s

    def reset(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate:
        """Take a new reference, since the pressure has stepped; the state stays."""
        off_m = float(aid.measurement.innovation[0])
        offset_m = estimate.aids.track(self.source).own.offset_m - off_m
        noise_m = self._config.barometer.noise_m
        variance_m2 = float(estimate.covariance[_DOWN, _DOWN]) + noise_m**2
        height_m = estimate.state.height_m + offset_m
        reference = Reference(aid.stamp_ns, height_m, offset_m, variance_m2, aid.stamp_ns)
        aids = self.with_reset(estimate.aids, aid.stamp_ns, abs(off_m))
        return _with_reference(estimate._replace(aids=aids), reference)

    def _measurement(
        self,
        stamp_ns: int,
        estimate: StateEstimate,
        off_m: float,
        variances_m2: tuple[float, float],
    ) -> AidMeasurement:
        """Return the measurement of the position down, with lasting and white variances (m2).

        The correction leaves the height with at least twice the lasting variance. So many readings
        weigh as much as one, and the variance also covers the error of the inertial height.
        """
        lasting_m2, noise_m2 = variances_m2
        own_m2, plain_m2 = float(estimate.covariance[_DOWN, _DOWN]), lasting_m2 + noise_m2
        design = np.zeros((1, self._states))
        design[0, _DOWN] = 1.0
        ease = 0.0
        if own_m2 > 2 * lasting_m2:
            weak_m2 = own_m2 * 2 * lasting_m2 / (own_m2 - 2 * lasting_m2)
            ease = max(weak_m2 - plain_m2, 0.0) / own_m2
        innovation, noise = np.array((off_m,)), np.array(((plain_m2,),))
        gate_sigma, sigma_m = self._config.barometer.gate_sigma, self._config.barometer.sigma_m
        measurement = Measurement(innovation, design, noise, gate_sigma, ease)
        moved_m = estimate.state.correction_n[2]
        slack_m = 1.5 * gate_sigma * math.sqrt(noise_m2 + sigma_m**2)
        return AidMeasurement(
            self.source, stamp_ns, measurement, (off_m + moved_m,), (moved_m,), slack_m
        )

    def _offset_m2(self, reference: Reference, stamp_ns: int, height_m: float) -> float:
        """Return the offset's variance at a stamp, m2: weather, slow error, air temperature."""
        config, passed_s = self._config.barometer, abs(stamp_ns - reference.stamp_ns) * 1e-9
        walked_m2 = config.drift**2 * passed_s
        slow_m2 = 2 * config.sigma_m**2 * -math.expm1(-passed_s / config.time_s)
        scaled_m = config.scale_sigma * (height_m - reference.height_m)
        return reference.variance_m2 + walked_m2 + slow_m2 + scaled_m * scaled_m


def _with_reference(
    estimate: StateEstimate, reference: Reference, refused: AidTrack | None = None
) -> StateEstimate:
    """Return the estimate with a reference, and with ``refused`` as record of refusals if any."""
    aids = estimate.aids
    track = refused or AidTrack(aids.track(Source.BAROMETER).used_ns)
    aids = aids.with_track(Source.BAROMETER, track._replace(own=reference))
    return estimate._replace(aids=aids)
