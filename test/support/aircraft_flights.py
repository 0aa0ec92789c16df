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
"""Simulated flights whose antennas and delays are not what the parameters say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dev.flight_errors import navigation_samples
from tirgeo_ros.core.calibration.aircraft_parameters import DELAYS
from tirgeo_ros.core.calibration.aircraft_run import Recorded
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

#: Legs there and back at 8 m/s with brisk turns.
TURNS = {
    "route.legs": 100,
    "route.speed_m_s": 8.0,
    "route.acceleration_m_s2": 3.0,
    "route.turn_radius_m": 5.0,
}
ANTENNA_M = (-0.10, 0.32, 0.38)
DELAYS_S = (0.12, 0.07, -0.05)  # of positions, velocities, headings
AZIMUTH_DEG = 25.0  # of the baseline; parameters without a second antenna say 0


def truth(azimuth_deg=AZIMUTH_DEG, delays_s=DELAYS_S):
    """(7,) in the order of PARAMETERS."""
    return np.array([*ANTENNA_M, math.radians(azimuth_deg), *delays_s])


def aircraft_samples(seed, duration_s=180.0, azimuth_deg=AZIMUTH_DEG, delays_s=DELAYS_S, **values):
    """Samples in order of arrival, stamps late by the delays; headings are plain azimuths."""
    angle = math.radians(azimuth_deg)
    forward, left, up = ANTENNA_M
    second_m = (forward + math.cos(angle), left - math.sin(angle), up)
    given = {"rtk.lever_arm_m": ANTENNA_M, "rtk.second_antenna_m": second_m}
    scenario = scenario_from({"duration_s": duration_s, **given, **(values or TURNS)})
    late_ns = {source: round(s * 1e9) for source, s in zip(DELAYS, delays_s, strict=True)}
    result = []
    for sample in navigation_samples(fly(scenario, seed)):
        source = None if isinstance(sample, ImuSample) else sample.source
        late = replace(sample, stamp_ns=sample.stamp_ns + late_ns.get(source, 0))
        if isinstance(late, HeadingSample):
            late = replace(late, heading_rad=(late.heading_rad + angle) % math.tau)
        result.append(late)
    return result


def recorded(samples):
    """The flight in memory, as a bag is read."""
    imu = [sample for sample in samples if isinstance(sample, ImuSample)]
    aids = [s for s in samples if not isinstance(s, ImuSample) and s.source in DELAYS]
    return Recorded(imu, aids)
