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
"""Simulate a flight in memory, without pictures: the truth and the sensors' samples."""

from __future__ import annotations

from dataclasses import dataclass

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.scenario import Scenario
from tirgeo_ros.tools.simulate.sensors import (
    Arrival,
    Autopilot,
    Epochs,
    SimulatedGimbal,
    barometer_samples,
    gimbal_samples,
    gps_samples,
    imu_bias,
    imu_samples,
    rtk_samples,
)
from tirgeo_ros.tools.simulate.trajectory import Trajectory, geodetic_state


@dataclass(frozen=True)
class Truth:
    """Hold the true state at every IMU stamp; axes ``n`` are north, east, down at the aircraft."""

    stamp_ns: list[int]
    t_s: Array  # (N,) from the start of the flight
    latitude_rad: Array  # (N,)
    longitude_rad: Array  # (N,)
    height_m: Array  # (N,)
    velocity_n: Array  # (N, 3) m/s
    q_nb: Array  # (N, 4) wxyz
    specific_force_b: Array  # (N, 3) m/s2, output of a perfect IMU
    angular_rate_b: Array  # (N, 3) rad/s, output of a perfect IMU
    gyro_bias_b: Array  # (N, 3) rad/s
    accel_bias_b: Array  # (N, 3) m/s2
    position_p: Array  # (N, 3) m in the plane of the site


@dataclass(frozen=True)
class SimulatedFlight:
    """Hold a simulated flight."""

    scenario: Scenario
    seed: int
    trajectory: Trajectory
    gimbal: SimulatedGimbal
    truth: Truth
    samples: list[Arrival]  # (arrival_ns, sample), sorted by arrival

    @property
    def plane(self) -> TangentPlane:
        """Return the tangent plane of the site, in which the truth's poses are given."""
        return self.trajectory.plane


def fly(scenario: Scenario, seed: int | None = None) -> SimulatedFlight:
    """Fly a scenario with its own or another seed; the same seed gives the same flight."""
    seed = scenario.seed if seed is None else seed
    trajectory = Trajectory(scenario, seed)
    pilot = Autopilot(scenario, seed)
    gimbal = SimulatedGimbal(scenario, seed, trajectory)
    epochs = Epochs.at_rate(scenario, scenario.imu.rate_hz)
    bias = imu_bias(scenario.imu, seed, len(epochs.stamp_ns))
    samples = [
        *imu_samples(scenario, seed, trajectory, pilot, bias),
        *rtk_samples(scenario, seed, trajectory),
        *gps_samples(scenario, seed, trajectory),
        *barometer_samples(scenario, seed, trajectory),
        *gimbal_samples(scenario, seed, trajectory, pilot, gimbal),
    ]
    samples.sort(key=lambda arrival: arrival[0])  # stable: the IMU first if equal
    motion = trajectory.motion(epochs.t_s)
    place = motion.position_p, motion.velocity_p, motion.rotation_pb
    states = *geodetic_state(trajectory.plane, *place), *trajectory.inertial(motion)
    biases = bias.gyro_b, bias.accel_b
    truth = Truth(epochs.stamp_ns, epochs.t_s, *states, *biases, motion.position_p)
    return SimulatedFlight(scenario, seed, trajectory, gimbal, truth, samples)
