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
"""Recordings for calibrations: an IMU at rest, and a checkerboard on a wall."""

from __future__ import annotations

import numpy as np
import pytest

from dev.checkerboards import YAW_STD_DEG, camera_angles
from dev.static_imu import write_static
from tirgeo_ros.core.frames.rotations import flu_from_frd
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.simulate.scenario import scenario_from
from tirgeo_ros.tools.simulate.sensors import imu_bias, imu_white


def test_an_imu_at_rest_has_gravity_and_the_errors_of_the_flights(tmp_path):
    scenario, seed = scenario_from({"imu.rate_hz": 400.0}), 3
    path, cdr = tmp_path / "static.mcap", Cdr()
    count = write_static(path, 0.01, scenario, seed)
    read = [(m, cdr.deserialize(m.data, m.typename)) for m in BagReader(path).messages()]
    assert len(read) == count == 14400
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in read])
    assert stamps[0] == scenario.start_ns
    np.testing.assert_array_equal(np.diff(stamps), 2_500_000)
    np.testing.assert_array_equal(stamps, [raw.log_time_ns for raw, _ in read])
    assert {(raw.topic, m.header.frame_id) for raw, m in read} == {("/imu/data", "base_link")}
    rate, force = (
        flu_from_frd(np.array([(v.x, v.y, v.z) for v in (getattr(m, name) for _, m in read)]))
        for name in ("angular_velocity", "linear_acceleration")
    )
    bias, white = imu_bias(scenario.imu, seed, count), imu_white(scenario.imu, seed, count)
    gravity = gravity_down(np.radians(scenario.site.latitude_deg), scenario.site.ground_height_m)
    np.testing.assert_allclose(rate, bias.gyro_b + white[0], rtol=1e-12, atol=1e-15)
    wanted = bias.accel_b + white[1] - [0, 0, gravity]
    np.testing.assert_allclose(force, wanted, rtol=1e-12, atol=1e-12)


def test_the_angles_at_the_wall_are_table_8_s():
    roll, pitch, yaw = np.degrees(camera_angles(np.arange(300) / 10, 30.0, 1)).T
    # A sine over whole periods; its samples end a tenth of a second before the last one does.
    assert yaw.std() == pytest.approx(YAW_STD_DEG, rel=0.01)
    # Scaled at other instants, 50 ms apart.
    assert np.sqrt(np.mean(roll**2)) == pytest.approx(0.2704, rel=0.02)
    assert np.sqrt(np.mean(pitch**2)) == pytest.approx(0.4839, rel=0.02)
