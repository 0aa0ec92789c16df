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
"""Positions on the aircraft, set once: from which point they are measured, and the IMU's axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dev.flight_errors import fitting_config, navigation_samples, solutions
from tirgeo_ros.core.config import (
    NODE_CONFIGS,
    RENAMED,
    AircraftConfig,
    DjiConfig,
    EkfConfig,
    GimbalConfig,
)
from tirgeo_ros.core.config.schema import config_from, parameters_of
from tirgeo_ros.core.frames.rotations import matrix_from_euler
from tirgeo_ros.core.navigation.timeline.imu_checks import in_body_axes
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

PLACES = AircraftConfig(
    rtk_antenna_m=(1, 2, 3),
    second_antenna_m=(1, -2, 3.5),
    gps_antenna_m=(4, 5, 6),
    gimbal_pivot_m=(7, 8, 9),
    camera_from_pivot_m=(0.1, 0.2, 0.3),
)


def test_places_are_written_forward_left_up_and_used_forward_right_down():
    np.testing.assert_array_equal(PLACES.rtk_lever_b, [1, -2, -3])
    np.testing.assert_array_equal(PLACES.gps_lever_b, [4, -5, -6])
    np.testing.assert_array_equal(PLACES.pivot_lever_b, [7, -8, -9])
    np.testing.assert_array_equal(PLACES.camera_from_pivot_g, [0.1, -0.2, -0.3])
    np.testing.assert_array_equal(PLACES.baseline_b, [0, 4, -0.5])
    assert PLACES.baseline_deg == 90.0
    for source in Source:
        gps = source in {Source.GPS_POSITION, Source.GPS_VELOCITY}
        expected = PLACES.gps_lever_b if gps else PLACES.rtk_lever_b
        np.testing.assert_array_equal(PLACES.antenna_b(source), expected)


def test_all_may_be_measured_from_any_one_point():
    """The camera is measured from the pivot and moves with it; all else moves with the point."""
    off = np.array([0.25, -0.5, 0.125])  # exact in binary
    names = ("imu_m", "rtk_antenna_m", "second_antenna_m", "gps_antenna_m", "gimbal_pivot_m")
    moved = {name: tuple((np.array(getattr(PLACES, name)) + off).tolist()) for name in names}
    other = replace(PLACES, **moved)
    for name in ("rtk_lever_b", "gps_lever_b", "pivot_lever_b", "baseline_b"):
        np.testing.assert_array_equal(getattr(other, name), getattr(PLACES, name))


@pytest.mark.parametrize("second_m", [(1, 2, 9.0), (1.04, 2, 3), (1.03, 1.97, 3), (1, 2.2, 4)])
def test_antennas_that_give_no_heading_are_refused_with_both_names(second_m):
    bad = replace(PLACES, second_antenna_m=second_m)
    message = r"aircraft\.rtk_antenna_m \[1, 2, 3\] and aircraft\.second_antenna_m \[.*too little"
    with pytest.raises(ConfigError, match=message):
        _ = bad.baseline_deg
    near = replace(PLACES, second_antenna_m=(1, 1.949, 3))
    assert near.baseline_deg == pytest.approx(90.0)


@pytest.mark.parametrize(
    ("kind", "name", "instead"),
    [
        (EkfConfig, "rtk.lever_arm_m", "is now aircraft.rtk_antenna_m, set once for all nodes"),
        (EkfConfig, "gps.lever_arm_m", "is now aircraft.gps_antenna_m, set once for all nodes"),
        (EkfConfig, "heading.offset_deg", "is now the direction from aircraft.rtk_antenna_m to"),
        (EkfConfig, "heading.baseline_m", "is now the direction from aircraft.rtk_antenna_m to"),
        (GimbalConfig, "lever_arm_m", "is now aircraft.gimbal_pivot_m, set once for all nodes"),
        (GimbalConfig, "camera_offset_m", "is now aircraft.camera_from_pivot_m, set once"),
        (DjiConfig, "heading.baseline_offset_deg", "to aircraft.second_antenna_m, set once for"),
        (NODE_CONFIGS["bag_player"], "aircraft.pushes", "is now simulated_aircraft.pushes"),
    ],
)
def test_an_old_name_is_refused_with_the_new_one(kind, name, instead):
    with pytest.raises(ConfigError, match=rf"^a.yaml: parameter {name} .*{instead}"):
        config_from(kind, {name: [0.0, 0.0, 0.0]}, "a.yaml")


def test_no_old_name_is_in_use_and_every_node_knows_them():
    in_use = {p.name for kind in NODE_CONFIGS.values() for p in parameters_of(kind)}
    assert not in_use & set(RENAMED)
    for kind in NODE_CONFIGS.values():
        with pytest.raises(ConfigError, match=r"rtk\.lever_arm_m is now aircraft\.rtk_antenna_m"):
            config_from(kind, {"rtk.lever_arm_m": [0.0, 0.0, 0.0]})


def test_an_imu_turned_by_its_angles_feels_the_bodys_axes():
    """Yawed a quarter to the left, its forward axis is the body's left (FLU), minus y in FRD."""
    left = AircraftConfig(imu_rpy_deg=(0.0, 0.0, 90.0))
    q_nb = np.array([1.0, 0.0, 0.0, 0.0])
    felt = ImuSample(5, np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]), q_nb)
    in_body = in_body_axes(felt, left.rotation_bi)
    np.testing.assert_allclose(in_body.specific_force_b, [2.0, -1.0, 3.0], atol=1e-15)
    np.testing.assert_allclose(in_body.angular_rate_b, [0.2, -0.1, 0.3], atol=1e-16)
    assert (in_body.stamp_ns, in_body.autopilot_q_nb) == (5, q_nb)


@pytest.mark.parametrize("method", ["ekf_heading", "raw"])
def test_a_turned_imu_flies_as_a_straight_one(method):
    """Only rounding differs: 1e-15 of 10 m/s2 over some seconds and a closed loop."""
    flight = fly(scenario_from({"duration_s": 12.0}), 3)
    rpy_deg = (2.0, -3.0, 120.0)
    roll, pitch, yaw = np.radians(rpy_deg) * (1, -1, -1)
    rotation_ib = matrix_from_euler(roll, pitch, yaw).T
    turned = [
        replace(
            s,
            specific_force_b=rotation_ib @ s.specific_force_b,
            angular_rate_b=rotation_ib @ s.angular_rate_b,
        )
        if isinstance(s, ImuSample)
        else s
        for s in navigation_samples(flight)
    ]
    straight = solutions(flight, fitting_config(flight, method=method))
    config = fitting_config(flight, method=method, aircraft__imu_rpy_deg=rpy_deg)
    result = solutions(flight, config, turned)
    assert len(result) == len(straight) > 100
    for name in ("velocity_n", "q_nb", "angular_rate_b"):
        item, other = (np.array([getattr(s, name) for s in of]) for of in (result, straight))
        np.testing.assert_allclose(item, other, atol=1e-9)
