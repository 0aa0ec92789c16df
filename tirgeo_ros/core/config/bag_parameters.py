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
"""Define the parameters of bag_player and recorder."""

from __future__ import annotations

from dataclasses import dataclass

from tirgeo_ros.core.config.aircraft_parameters import AircraftConfig
from tirgeo_ros.core.config.schema import group, param
from tirgeo_ros.core.types.measurements import JOINT_ORDERS, USUAL_ORDER


@dataclass(frozen=True, slots=True)
class SimulatedAircraftConfig:
    """The aircraft that is simulated on ``serial_port`` from the recorded flight."""

    geoid_undulation_m: float = param(
        0.0,
        "height of the geoid above the ellipsoid, subtracted from the recorded heights",
        ("m", -120, 100),
    )
    gimbal: str = param(
        "joints",
        "source of the gimbal's angles: joints (attitude and recorded encoder angles) or reported",
        choices=("joints", "reported"),
    )
    joint_order: str = param(
        USUAL_ORDER, "order of the joints, from the aircraft to the camera", choices=JOINT_ORDERS
    )
    clock_start_ms: int = param(
        60_000, "reading of the aircraft's clock at the start", ("ms", 0, 2**32 - 1)
    )
    clock_drift_ppm: float = param(
        0.0, "rate error of the aircraft's clock; positive = fast", ("ppm", -1e4, 1e4)
    )
    pushes: bool = param(False, "send the usual subscription packages too")


@dataclass(frozen=True, slots=True)
class BagPlayerConfig:
    """Parameters of bag_player."""

    bag: str = param(
        "", "bag to play: a file (.mcap, .db3), or a folder as ros2 bag record leaves it"
    )
    rate: float = param(1.0, "speed of playing, as a multiple of real time", ("", 0.01, 100))
    loop: bool = param(False, "begin again at the end")
    wait_timeout_s: float = param(
        30.0, "longest wait for subscribers before the start", ("s", 0, 3600)
    )
    wait_for: str = param(
        "", "topics, separated by commas, that must have a subscriber; empty = any"
    )
    topics: str = param(
        "", "topics to play, separated by commas; empty = all that no node of tirgeo computes"
    )
    live: bool = param(False, "shift all stamps so that the bag begins now, and publish no /clock")
    serial_port: str = param(
        "",
        "with live: play the aircraft's topics as DJI's serial protocol, on a pseudo-terminal "
        "at this path; empty = as topics",
    )
    simulated_aircraft: SimulatedAircraftConfig = group(SimulatedAircraftConfig)
    aircraft: AircraftConfig = group(AircraftConfig)


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """Parameters of recorder."""

    output: str = param("", "MCAP file to write")
    topics: str = param("", "topics to record, separated by commas")
