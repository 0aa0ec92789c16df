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
"""Which samples are refused for their own values, and with which reason."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from message_samples import HEADING, IMU, POSITION, VELOCITY

from tirgeo_ros.core.streams.sanity_checks import (
    fault_of,
    joints_fault,
    pose_fault,
    usable_attitude,
)

NAN, INF = math.nan, math.inf
REST = np.array([1.0, 0.0, 0.0, 0.0])


def put(array, index, value):
    changed = np.array(array)
    changed[index] = value
    return changed


@pytest.mark.parametrize("bad", [NAN, INF, -INF])
@pytest.mark.parametrize(
    ("sample", "name", "what"),
    [
        (IMU, "specific_force_b", "force or rate"),
        (IMU, "angular_rate_b", "force or rate"),
        (POSITION, "latitude_rad", "position"),
        (POSITION, "longitude_rad", "position"),
        (POSITION, "height_m", "position"),
        (POSITION, "covariance_n", "covariance"),
        (VELOCITY, "velocity_n", "velocity"),
        (VELOCITY, "covariance_n", "covariance"),
        (HEADING, "heading_rad", "heading"),
        (HEADING, "variance_rad2", "heading"),
    ],
)
def test_a_value_that_is_not_finite_is_named(sample, name, what, bad):
    value = getattr(sample, name)
    broken = [put(value, index, bad) for index in np.ndindex(np.shape(value))] or [bad]
    for changed in broken:
        assert fault_of(dataclasses.replace(sample, **{name: changed})) == f"{what} is not finite"


OUT_OF_RANGE = "latitude or longitude is out of range"


@pytest.mark.parametrize(
    ("sample", "values", "fault"),
    [
        *((sample, {}, "") for sample in (IMU, POSITION, VELOCITY, HEADING)),
        (IMU, {"specific_force_b": np.array([0.0, -400.0, 0.0])}, ""),
        (IMU, {"specific_force_b": np.array([0.0, 400.4, 0.0])}, "force or rate is out of range"),
        (IMU, {"angular_rate_b": np.array([0.0, 70.0, 0.0])}, ""),
        (IMU, {"angular_rate_b": np.array([0.0, -70.1, 0.0])}, "force or rate is out of range"),
        (IMU, {"autopilot_q_nb": np.full(4, NAN)}, ""),  # not the filter's concern
        (POSITION, {"latitude_rad": math.pi / 2}, ""),
        (POSITION, {"latitude_rad": -1.58}, OUT_OF_RANGE),
        (POSITION, {"latitude_rad": 39.8}, OUT_OF_RANGE),  # degrees
        (POSITION, {"longitude_rad": 1.9 * math.pi}, ""),  # 0 to 360 degrees is a convention
        (POSITION, {"longitude_rad": 116.0}, OUT_OF_RANGE),
        (POSITION, {"latitude_rad": 0.0}, ""),
        (POSITION, {"longitude_rad": 0.0}, ""),
        (
            POSITION,
            {"latitude_rad": 0.0, "longitude_rad": 0.0},
            "position is 0, 0, which receivers send when they have none",
        ),
        (POSITION, {"height_m": -430.0}, ""),
        (POSITION, {"height_m": 9000.0}, ""),
        (POSITION, {"height_m": 5e4}, "height is out of range"),
        (POSITION, {"height_m": -5e4}, "height is out of range"),
        (VELOCITY, {"velocity_n": np.array([0, -1000.1, 0])}, "velocity is out of range"),
        (HEADING, {"heading_rad": -7.0, "variance_rad2": -1.0}, ""),  # unknown variance
        (HEADING, {"variance_rad2": 1e200}, "heading is not finite"),
    ],
)
def test_bounds(sample, values, fault):
    assert fault_of(dataclasses.replace(sample, **values)) == fault


@pytest.mark.parametrize("sample", [POSITION, VELOCITY])
@pytest.mark.parametrize(
    ("covariance", "fault"),
    [
        (np.zeros((3, 3)), ""),  # not known
        (-np.eye(3), ""),  # ROS's way to say the same
        (np.diag([-1.0, 1.0, 1.0]), ""),
        (np.ones((3, 3)), ""),  # fully correlated, but possible
        (np.full((3, 3), np.float32(0.1), float), ""),
        (np.eye(3) + 2 * np.eye(3)[::-1], "covariance is not positive"),
        (np.array([[1, 2, 0], [2, 1, 0], [0, 0, 1.0]]), "covariance is not positive"),
        (np.diag([1.0, 1.0, 1e12]), ""),  # a receiver without a height
        (np.diag([1.0, 1.0, 1e300]), "covariance is not finite"),
    ],
)
def test_an_impossible_covariance_is_refused(sample, covariance, fault):
    assert fault_of(dataclasses.replace(sample, covariance_n=covariance)) == fault


@given(st.integers(0, 2**32 - 1), st.floats(1e-8, 1e8))
def test_no_real_covariance_is_refused(seed, scale):
    """Of any rank, sent in single precision."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, rng.integers(1, 5)))
    covariance = (scale * root @ root.T).astype(np.float32).astype(float)
    assert fault_of(dataclasses.replace(POSITION, covariance_n=covariance)) == ""


@pytest.mark.parametrize(
    ("q", "usable"),
    [
        (None, False),
        (np.zeros(4), False),
        (np.array([1.0, NAN, 0, 0]), False),
        (np.array([INF, 0, 0, 1.0]), False),
        (np.array([1e200, 0, 0, 0]), False),
        (1.009 * REST, True),
        (1.02 * REST, False),
        (0.98 * REST, False),
    ],
)
def test_which_quaternions_are_attitudes(q, usable):
    assert usable_attitude(q) is usable


NOWHERE = "position is not finite, or not on the Earth"
NO_ATTITUDE = "attitude is not a unit quaternion"


@pytest.mark.parametrize(
    ("x_m", "q", "variance", "fault"),
    [
        (0.0, REST, 1.0, ""),
        (1.28e7, REST, 1.0, ""),  # the other end of the earth
        (1.29e7, REST, 1.0, NOWHERE),
        (-1e200, REST, 1.0, NOWHERE),
        (INF, REST, 1.0, NOWHERE),
        (NAN, REST, 1.0, NOWHERE),
        (0.0, REST, 1e30, ""),  # not known
        (0.0, REST, 0.0, ""),
        (0.0, REST, 1e200, "covariance is not finite"),
        (0.0, REST, NAN, "covariance is not finite"),
        (0.0, REST, -1.0, "covariance is not positive"),
        (0.0, np.zeros(4), 1.0, NO_ATTITUDE),
        (0.0, 1.01 * REST, 1.0, NO_ATTITUDE),
        (0.0, put(REST, 3, NAN), 1.0, NO_ATTITUDE),
        (0.0, 1e200 * REST, 1.0, NO_ATTITUDE),
    ],
)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_pose(axis, x_m, q, variance, fault):
    covariance = put(np.eye(6), (axis, axis), variance)
    with np.errstate(over="ignore"):
        assert pose_fault(put(np.zeros(3), axis, x_m), q, covariance) == fault


@pytest.mark.parametrize("bad", [NAN, INF, 1e7, -1e200])
def test_a_joint_has_an_angle(bad):
    assert joints_fault((0.0, -math.pi, 100.0)) == ""
    assert joints_fault((0.0, 0.0, bad)) == "angle is not finite or out of range"
