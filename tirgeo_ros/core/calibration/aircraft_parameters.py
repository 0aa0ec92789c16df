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
"""Define the parameters that a flight observes, and apply their values to the filter and samples.

A set of values is a vector (7,) in the order of PARAMETERS: m, rad and s. The antenna's place is
relative to the IMU, in the axes of ``base_link``; the baseline points ``azimuth`` clockwise from
the nose, at the elevation of the configured antennas; delays are relative to the IMU's own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config import AircraftConfig, EkfConfig
from tirgeo_ros.core.frames.rotations import flu_from_frd
from tirgeo_ros.core.navigation.aiding.aid import Aiding
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import Baseline
from tirgeo_ros.core.navigation.aiding.fusion import AIDS
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import HeadingSample, Source

# The texts of TABLE: where a value is set, and what to fly for it.
_ANTENNA, _RTK = "aircraft.rtk_antenna_m", "ekf_node rtk."
_TURNS = "turns of the nose through 180 deg or more, right and left"
_SPEED = "legs in several directions with brisk starts, stops and turns, at 5 m/s or more"
_LEANS = "starts and stops that tilt the aircraft by 10 deg or more, in several directions"
_SWINGS = "turns at 20 deg/s or more, right and left, with rests between"
_QUARTER_RAD = math.radians(90)
# Indices of the antenna, of the baseline's azimuth, and of each source's delay.
ANTENNA, AZIMUTH = slice(0, 3), 3
DELAYS = {Source.RTK_POSITION: 4, Source.RTK_VELOCITY: 5, Source.RTK_HEADING: 6}


class Parameter(NamedTuple):
    """Describe a parameter that a flight may determine."""

    unit: str  # in which the value is shown
    key: str  # node and name of the parameter that holds it
    limit: float  # largest standard deviation at which a flight has determined it; m, rad, s
    prior_sigma: float  # just tight enough to keep the value if it is not observed
    advice: str  # what to fly for it


TABLE = {
    "antenna_forward": Parameter("m", _ANTENNA, 0.05, 2.0, _TURNS),
    "antenna_left": Parameter("m", _ANTENNA, 0.05, 2.0, _TURNS),
    "antenna_up": Parameter("m", _ANTENNA, 0.05, 2.0, _LEANS),
    "baseline_azimuth": Parameter(
        "deg", "aircraft.second_antenna_m", math.radians(0.5), _QUARTER_RAD, _SPEED
    ),
    "position_delay": Parameter("ms", f"{_RTK}delay_s", 0.01, 0.5, _SPEED),
    "velocity_delay": Parameter("ms", f"{_RTK}velocity_delay_s", 0.01, 0.5, _SPEED),
    "heading_delay": Parameter("ms", "ekf_node heading.delay_s", 0.01, 0.5, _SWINGS),
}
PARAMETERS = tuple(TABLE)
LIMITS, PRIOR_SIGMA = np.array([(row.limit, row.prior_sigma) for row in TABLE.values()]).T


class Floors(NamedTuple):
    """Hold the smallest standard deviations that the filter assumes for measurements."""

    position_m: float = 0.0
    velocity_m_s: float = 0.0
    heading_rad: float = 0.0


def values_of_config(config: EkfConfig) -> Array:
    """Return the values (7,) of the configured parameters; the IMU's delay is subtracted."""
    x, y, _ = Baseline.from_config(config.aircraft).direction_b
    lever_m = flu_from_frd(config.aircraft.rtk_lever_b)
    delays_s = np.array([AIDS[source].delay_s(config) for source in DELAYS])
    return np.array([*lever_m, math.atan2(y, x), *(delays_s - config.imu.delay_s)])


def reported_direction_rad(config: EkfConfig) -> float:
    """Return the baseline's azimuth in the body that was subtracted from the bag's headings."""
    return -Baseline.from_config(config.aircraft).reported_less_azimuth_rad


def baseline_b(config: EkfConfig, azimuth_rad: float) -> Array:
    """Return the baseline's unit vector (3,), FRD, turned to an azimuth."""
    x, y, z = Baseline.from_config(config.aircraft).direction_b
    level = math.hypot(x, y)
    return np.array([level * math.cos(azimuth_rad), level * math.sin(azimuth_rad), z])


def configured(config: EkfConfig, values: Array, floors: Floors) -> EkfConfig:
    """Return the filter's parameters with the values applied, for ``restamped`` samples."""
    antenna_m = values[ANTENNA]
    second_m = antenna_m + flu_from_frd(baseline_b(config, float(values[AZIMUTH])))
    rtk, heading = config.rtk, config.heading
    imu = replace(config.imu, delay_sigma_s=0.0)  # the fit has a delay for each measurement
    return replace(
        config,
        position_update="fused",
        imu=imu,
        aircraft=AircraftConfig(
            rtk_antenna_m=tuple(antenna_m.tolist()),
            rtk_antenna_sigma_m=(0.0, 0.0, 0.0),
            second_antenna_m=tuple(second_m.tolist()),
        ),
        rtk=replace(
            rtk,
            median_window=1,
            delay_s=0.0,
            position_sigma_floor_m=max(rtk.position_sigma_floor_m, floors.position_m),
            velocity_sigma_floor_m_s=max(rtk.velocity_sigma_floor_m_s, floors.velocity_m_s),
        ),
        heading=replace(
            heading,
            sigma_floor_deg=max(heading.sigma_floor_deg, math.degrees(floors.heading_rad)),
        ),
    )


def restamped(aids: Sequence[Aiding], values: Array, reported_rad: float) -> list[Aiding]:
    """Return the measurements with their stamps corrected to the times of measurement.

    Headings become those that the receiver would have sent if the baseline azimuth of ``values``
    had been subtracted instead of ``reported_rad``.
    """
    delays_ns = {source: round(float(values[k]) * 1e9) for source, k in DELAYS.items()}
    turn_rad = reported_rad - float(values[AZIMUTH])
    restamped_aids: list[Aiding] = []
    for sample in aids:
        stamp_ns = sample.stamp_ns - delays_ns[sample.source]
        if isinstance(sample, HeadingSample):
            heading_rad = sample.heading_rad + turn_rad
            restamped_aids.append(replace(sample, stamp_ns=stamp_ns, heading_rad=heading_rad))
        else:
            restamped_aids.append(replace(sample, stamp_ns=stamp_ns))
    return restamped_aids
