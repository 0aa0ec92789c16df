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
"""Define the parameters of dji_node and of ``tirgeo import``."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tirgeo_ros.core.config.aircraft_parameters import AircraftConfig, FramesConfig
from tirgeo_ros.core.config.schema import group, param

_DELAY = ("s", -2, 2)


@dataclass(frozen=True, slots=True)
class DjiHeadingConfig:
    """The accuracy that is assumed for the heading of the two RTK antennas."""

    sigma_deg: float = param(
        0.6, "sigma of a heading, which DJI sends in whole degrees", ("deg", 1e-3, 180)
    )


@dataclass(frozen=True, slots=True)
class DjiRtkConfig:
    """The accuracy that is assumed for an RTK fix, because DJI sends none, and the fix's age."""

    fixed_sigma_m: tuple[float, ...] = param(
        (0.01, 0.02), "sigma of a fixed position: horizontal, vertical", ("m", 1e-4, 100)
    )
    velocity_sigma_m_s: float = param(
        0.03, "standard deviation of a velocity, per axis", ("m/s", 1e-4, 100)
    )
    delay_s: float = param(0.0, "age of an RTK value when sent, subtracted from its stamp", _DELAY)


@dataclass(frozen=True, slots=True)
class DjiDelayConfig:
    """The age of other values when they are sent, used as ``rtk.delay_s``."""

    imu_s: float = param(0.0, "age of acceleration, angular rate and attitude", _DELAY)
    gps_s: float = param(0.0, "age of a position or velocity of the ordinary GPS", _DELAY)
    gimbal_s: float = param(0.0, "age of the gimbal's angles", _DELAY)


@dataclass(frozen=True, slots=True)
class DjiClockConfig:
    """The fit from the aircraft's clock to this computer's."""

    window_s: float = param(
        20.0, "window of the fit of the aircraft's clock to this computer's", ("s", 0.5, 3600)
    )
    max_drift_ppm: float = param(
        100.0, "largest drift between the two clocks that the fit allows", ("ppm", 0, 1e4)
    )


@dataclass(frozen=True, slots=True)
class DjiConfig(FramesConfig):
    """Parameters of dji_node."""

    source: str = param(
        "serial",
        "where the aircraft's data come from: serial (the UART of an A3, N3 or M600) or psdk "
        "(the topics of psdk_ros2, for an M300 or M350)",
        choices=("serial", "psdk"),
    )
    port: str = param("/dev/ttyUSB0", "serial port")
    baud: int = param(
        921600, "speed of the serial port, as set in DJI Assistant 2", ("", 1200, 4000000)
    )
    key: str = param(
        "", "application key that decrypts the frames, 64 hexadecimal digits; empty = none"
    )
    packages: str = param(
        "", "YAML file of the subscription packages' contents; empty = the usual five"
    )
    psdk_prefix: str = param("psdk_ros2", "prefix of the names of psdk_ros2's topics")
    geoid_undulation_m: float = param(
        math.nan,
        "height of the geoid (sea level) above the WGS84 ellipsoid in the area of flight, added "
        "to DJI's heights; unset = 0, with a warning",
        ("m", -120, 100),
    )
    acceleration_unit: str = param(
        "auto",
        "unit of the broadcast acceleration: g, m/s2, or auto (judged by its magnitude)",
        choices=("auto", "g", "m/s2"),
    )
    gimbal_reference: str = param(
        "north",
        "zero of the gimbal's yaw: north (Zenmuse) or body (Ronin-MX)",
        choices=("north", "body"),
    )
    heading: DjiHeadingConfig = group(DjiHeadingConfig, live=True)
    rtk: DjiRtkConfig = group(DjiRtkConfig, live=True)
    delay: DjiDelayConfig = group(DjiDelayConfig, live=True)
    clock: DjiClockConfig = group(DjiClockConfig)
    aircraft: AircraftConfig = group(AircraftConfig)
