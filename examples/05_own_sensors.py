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
"""Write a bag of sensors of your own, process it, and read the result.

The sensors are those of an aircraft that flies a level circle: arrays that a driver, a simulator
or another format could have given. Run it in any folder: into ``examples_output`` there it writes
``own.mcap`` (the inputs) and ``own_poses.mcap`` (every topic that the node graph publishes of
poses).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

import tirgeo_ros

OUTPUT = Path("examples_output")  # in the folder where you run this
BAG, PARAMS, POSES = (OUTPUT / name for name in ("own.mcap", "own.yaml", "own_poses.mcap"))
PLANE = tirgeo_ros.TangentPlane(math.radians(47.0), math.radians(11.0), 600.0)
RADIUS_M, SPEED_M_S, GRAVITY_M_S2 = 40.0, 6.0, 9.8063  # gravity there, by WGS84's formula
TURN_RAD_S = SPEED_M_S / RADIUS_M
START_NS, SECONDS = 1_700_000_000_000_000_000, 30
FIX_M, FIX_M_S, HEADING_RAD = 0.01, 0.02, math.radians(0.2)  # sigmas of the receiver


def stamps(rate_hz: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the times (s) and stamps (ns) of a sensor."""
    steps = np.arange(SECONDS * rate_hz)
    return steps / rate_hz, START_NS + steps * (10**9 // rate_hz)


def imu(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return force and rate of the circle at 100 Hz: forward, right and down of the body."""
    times_s, stamp_ns = stamps(100)
    force = np.array([0.0, SPEED_M_S * TURN_RAD_S, -GRAVITY_M_S2])
    force = force + rng.normal(0, 0.1, (len(times_s), 3))
    rate = np.array([0.0, 0.0, TURN_RAD_S]) + rng.normal(0, 0.002, (len(times_s), 3))
    table = {"stamp_ns": stamp_ns}
    for number, axis in enumerate(("forward", "right", "down")):
        table[f"force_{axis}_m_s2"] = force[:, number]
        table[f"rate_{axis}_rad_s"] = rate[:, number]
    return table


def receiver(rng: np.random.Generator) -> dict[str, dict[str, np.ndarray]]:
    """Return position, velocity and heading of the circle at 5 Hz, by topic."""
    times_s, stamp_ns = stamps(5)
    angle, level = TURN_RAD_S * times_s, np.zeros_like(times_s)
    position_n = np.stack([RADIUS_M * np.sin(angle), -RADIUS_M * np.cos(angle), level - 30.0], 1)
    velocity_n = SPEED_M_S * np.stack([np.cos(angle), np.sin(angle), level], 1)
    position_n += rng.normal(0, FIX_M, position_n.shape)
    velocity_n += rng.normal(0, FIX_M_S, velocity_n.shape)
    latitude_rad, longitude_rad, height_m = PLANE.geodetic_from_ned(position_n)
    fix = {"stamp_ns": stamp_ns, "status": level + 2, "height_m": height_m}
    fix |= {"latitude_rad": latitude_rad, "longitude_rad": longitude_rad}
    velocity = {"stamp_ns": stamp_ns}
    for number, axis in enumerate(("north", "east", "down")):
        fix[f"sigma_{axis}_m"] = level + FIX_M
        velocity[f"velocity_{axis}_m_s"] = velocity_n[:, number]
        velocity[f"sigma_{axis}_m_s"] = level + FIX_M_S
    heading_rad = angle + rng.normal(0, HEADING_RAD, len(angle))
    heading = {"stamp_ns": stamp_ns, "heading_rad": heading_rad, "sigma_rad": level + HEADING_RAD}
    return {"rtk/fix": fix, "rtk/vel": velocity, "rtk/heading": heading}


def main() -> None:
    """Write, process, read, and compare with the circle."""
    rng = np.random.default_rng(1)
    OUTPUT.mkdir(exist_ok=True)
    tirgeo_ros.write_bag(BAG, {"imu/data": imu(rng), **receiver(rng)})
    antennas = "rtk_antenna_m: [0, 0, 0], second_antenna_m: [1, 0, 0]"
    PARAMS.write_text(f"/**: {{ros__parameters: {{aircraft: {{{antennas}}}}}}}\n")
    summary = tirgeo_ros.process(BAG, POSES, params=PARAMS, images=False)
    poses = tirgeo_ros.read_bag(POSES, ["tirgeo/odometry"])["tirgeo/odometry"]
    sigma_m = math.sqrt(poses["covariance_north_m_north_m"][-1])
    print(f"state {summary['state']}, {len(poses['stamp_ns'])} poses, sigma north {sigma_m:.3f} m")


if __name__ == "__main__":
    main()
