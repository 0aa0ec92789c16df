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
"""Make flights to measure with: one without end, a round for the soak, and those of a fleet."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dev.flight_errors import NAVIGATION_SAMPLES, fitting_config
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.core.types.measurements import NavigationInput
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, sensed
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.graph_outputs import read_outputs
from tirgeo_ros.tools.simulate import simulate
from tirgeo_ros.tools.simulate.files import parameters_text
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import Scenario, scenario_from

_MINUTE_S = 60.0
#: A whole number of turns of the hover; later the spline no longer depends on the start.
_HOVER_FIRST_S = 12.0
_NO_ERROR = (0.0, 0.0, 0.0)

SOAK_SCENARIO = "config/scenarios/soak_flight.yaml"
#: From rest to rest: the trajectory's spline has forgotten its begin, and the eight is flown.
SOAK_START_S, SOAK_PERIOD_S = 6.0, 50.0

#: From one aircraft of a fleet to the next (deg of latitude), 200 m: far more than any error.
_APART_DEG = 0.0018
#: The golden angle: no two of a fleet head the same way.
_TURNED_DEG = 137.5


class LoopedFlight:
    """Yield the same samples for the filter each minute, with new stamps.

    The aircraft turns a quarter right and a quarter left every 12 seconds, in still air, with an
    IMU of constant bias and GPS without slow errors. Its state after a minute is that at the
    start, so the same samples can follow again.
    """

    def __init__(self, imu_rate_hz: float = 100.0) -> None:
        """Simulate the minute."""
        # A quarter turn in 2 s and 4 s of rest, to and fro: 12 s.
        hover = {
            "duration_s": _HOVER_FIRST_S + _MINUTE_S + 1.0,
            "route.shape": "hover",
            "route.yaw_rate_deg_s": 45.0,
            "route.hover_s": 4.0,
            "route.hold_error_m": 0.0,
            "wind.gust_m_s": 0.0,
            "imu.rate_hz": imu_rate_hz,
            "imu.noise.gyro_bias_instability": _NO_ERROR,
            "imu.noise.accel_bias_instability": _NO_ERROR,
            "gps.position_rms_m": _NO_ERROR,
            "autopilot.heading_rms_deg": 0.0,
            "autopilot.tilt_rms_deg": (0.0, 0.0),
        }
        flight = fly(scenario_from(hover))
        first_ns = flight.scenario.start_ns + round(_HOVER_FIRST_S * 1e9)
        end_ns = first_ns + round(_MINUTE_S * 1e9)
        self.scenario = flight.scenario
        self.config: EkfConfig = fitting_config(flight)
        self._samples: list[NavigationInput] = [
            sample
            for arrival_ns, sample in flight.samples
            if first_ns <= arrival_ns < end_ns and isinstance(sample, NAVIGATION_SAMPLES)
        ]

    def minutes(self) -> Iterator[list[NavigationInput]]:
        """Yield one minute of samples after another, without end, in order of arrival."""
        shift_ns = 0
        while True:
            yield [
                dataclasses.replace(sample, stamp_ns=sample.stamp_ns + shift_ns)
                for sample in self._samples
            ]
            shift_ns += round(_MINUTE_S * 1e9)


@dataclass(frozen=True)
class SoakFlight:
    """Hold the soak's figure eight, whose end meets its start, and its true camera poses."""

    folder: Path  # as ``tirgeo simulate`` leaves it
    start_ns: int
    cameras: dict[int, CameraPose]  # by time (ns) since the start of the round

    @property
    def bag(self) -> Path:
        """Return what the aircraft says in one round."""
        return self.folder / "flight.mcap"

    @property
    def period_ns(self) -> int:
        """Return the time of one round."""
        return round(SOAK_PERIOD_S * 1e9)

    def write_rounds(self, path: Path, duration_s: float) -> Path:
        """Write a bag of rounds, one after the other, for so long at least; return its path."""
        end_ns = self.start_ns + self.period_ns
        round_ = [item for item in BagReader(self.bag).messages() if item.log_time_ns < end_ns]
        with BagWriter(path) as bag:
            for shift_ns in range(0, round(duration_s * 1e9), self.period_ns):
                for item in round_:
                    data = stamped(item.data, header_stamp_ns(item.data) + shift_ns)
                    bag.write(item.topic, item.typename, data, item.log_time_ns + shift_ns)
        return path


def make_soak_flight(
    folder: Path, progress: Report = silent, scenario: Path | None = None
) -> SoakFlight:
    """Simulate the soak's flight into a folder, or another scenario that ends where it begins.

    Raises ScenarioError where it is not installed.
    """
    scenario = scenario or find_resource(SOAK_SCENARIO)
    if scenario is None:
        raise ScenarioError(f"{SOAK_SCENARIO} is not installed")
    simulate(scenario, folder, start_s=SOAK_START_S, duration_s=SOAK_PERIOD_S, progress=progress)
    start_ns = BagReader(folder / "flight.mcap").span_ns[0]
    poses = read_outputs(folder / "truth.mcap").cameras
    return SoakFlight(folder, start_ns, {pose.stamp_ns - start_ns: pose for pose in poses})


def stamped(data: bytes | bytearray, stamp_ns: int) -> bytes:
    """Return CDR bytes of a message that begins with a header, under another stamp."""
    changed = bytearray(data)
    struct.pack_into("<iI" if data[1] else ">iI", changed, 4, *divmod(stamp_ns, 1_000_000_000))
    return bytes(changed)


@dataclass(frozen=True)
class FleetFlight:
    """Hold the flight and truth of one aircraft of a fleet, N IMU samples long."""

    number: int  # from 1
    bag: Path
    params: Path
    stamp_ns: list[int]  # (N,)
    place_e: Array  # (N, 3) true position of base_link, earth-fixed, m

    @property
    def name(self) -> str:
        """Return the aircraft's namespace, without the slash."""
        return f"uav{self.number}"


def make_fleet(
    folder: Path, aircraft: int, seconds: float, progress: Report = silent
) -> list[FleetFlight]:
    """Simulate a fleet's flights: one route for all, each with its own place and heading.

    Each is written as ``uavN.mcap`` with its parameters ``uavN.yaml``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    fleet, default, messages = [], Scenario(), Messages()
    for number in range(1, aircraft + 1):
        own = {
            "seed": default.seed + number,
            "duration_s": seconds,
            "site.latitude_deg": default.site.latitude_deg + _APART_DEG * number,
            "route.heading_deg": (_TURNED_DEG * number) % 360.0,
        }
        flight = fly(scenario_from(own))
        bag, params = folder / f"uav{number}.mcap", folder / f"uav{number}.yaml"
        with BagWriter(bag) as writer:
            for arrival_ns, sample in flight.samples:
                topic, message = sensed(messages, sample)
                writer.write(f"/{topic}", TOPIC_TYPES[topic], message, arrival_ns)
        params.write_text(parameters_text(flight.scenario))
        truth = flight.truth
        place_e = ecef_from_geodetic(truth.latitude_rad, truth.longitude_rad, truth.height_m)
        fleet.append(FleetFlight(number, bag, params, truth.stamp_ns, np.asarray(place_e)))
        progress(number, aircraft)
    return fleet
