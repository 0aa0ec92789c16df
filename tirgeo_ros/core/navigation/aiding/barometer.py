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
"""Aid the filter with a barometer's height, with its offset as a state.

Pressure gives a height in the standard atmosphere; weather, temperature and the air's flow around
the aircraft make it differ from the true height by metres. This offset is an error state, a random
walk that the first reading sets. Positions teach it, beside fixed RTK with one reading a second,
and readings carry the height between poor positions and where there are none.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.navigation.aiding.aid import Aid, AidMeasurement, Modelled, StateEstimate
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus
from tirgeo_ros.core.navigation.ins.error_states import BAROMETER_OFFSET, POSITION
from tirgeo_ros.core.navigation.ins.kalman import Measurement
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.types.measurements import PressureSample, Source

#: The standard atmosphere at sea level, and up to 11 km (ISO 2533:1975; ICAO Doc 7488, 3rd ed.).
_PRESSURE_PA, _TEMPERATURE_K, _LAPSE_K_M = 101_325.0, 288.15, 0.0065
_GAS_J_KG_K, _GRAVITY_M_S2 = 287.05287, 9.80665
_EXPONENT = _GAS_J_KG_K * _LAPSE_K_M / _GRAVITY_M_S2
_DOWN = POSITION.stop - 1
#: Sigma of an offset that no reading has shown yet: weather, geoid and a cheap sensor.
UNKNOWN_M = 300.0
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


class BarometerAid(Aid):
    """Use the height by pressure less the offset."""

    source = Source.BAROMETER
    delay = "barometer.delay_s"
    look_at = "barometer.sigma_m, barometer.noise_m"
    moved = "offset of baro/pressure changed by"

    def spare(self, sample: PressureSample, aids: AidStatus) -> bool:
        """Return whether the offset was learned beside RTK, or a reading judged just before."""
        since_ns = sample.stamp_ns - aids.track(self.source).judged_ns
        too_soon = 0 <= since_ns < _LEAST_STEP_NS
        return too_soon or self.learned(sample, aids)

    def measured(
        self, sample: PressureSample, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement of the position down less the offset, and the estimate."""
        config, state = self._config.barometer, estimate.state
        height_m = standard_height_m(sample.pressure_pa)
        off_m = state.height_m + estimate.aids.receivers.barometer_offset_m - height_m
        reported_m = math.sqrt(sample.variance_pa2) * metres_per_pa(sample.pressure_pa)
        noise_m = max(reported_m, config.noise_m)
        design = np.zeros((1, self._states))
        design[0, _DOWN], design[0, BAROMETER_OFFSET] = 1.0, -1.0
        noise = np.array(((noise_m**2,),))
        measurement = Measurement(np.array((off_m,)), design, noise, config.gate_sigma)
        moved_m = state.correction_n[2]
        slack_m = 1.5 * config.gate_sigma * math.hypot(noise_m, config.sigma_m)
        return AidMeasurement(
            self.source, sample.stamp_ns, measurement, (off_m + moved_m,), (moved_m,), slack_m
        ), estimate

    def patience_s(self, _aid: AidMeasurement, _estimate: StateEstimate) -> float:
        """Return how long a run of refusals must last."""
        return self._config.barometer.reset_after_s

    def reset(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate:
        """Take a new offset, since the pressure has stepped; the state stays."""
        return self.blamed(aid, estimate, BAROMETER_OFFSET, slice(_DOWN, _DOWN + 1), -1.0)
