"""What is refused of a sample by itself, with its reason, and what is not."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.frames.rotations import quat_from_rotvec
from tirgeo_ros.core.streams.sanity_checks import (
    fault_of,
    joints_fault,
    place_fault,
    pose_fault,
    usable_attitude,
)
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)

IMU = ImuSample(1, np.array([0.1, 0.2, -9.8]), np.array([0.01, 0.02, 0.03]))
POSITION = PositionSample(
    1, Source.RTK_POSITION, FixStatus.FIXED, 0.7, 2.0, 30.0, np.diag([1e-4, 1e-4, 4e-4])
)
VELOCITY = VelocitySample(1, Source.RTK_VELOCITY, np.array([3.0, -1.0, 0.1]), 1e-4 * np.eye(3))
HEADING = HeadingSample(1, 1.0, 1e-4)
BAD = pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])


def put(array, index, value):
    changed = np.array(array)
    changed[index] = value
    return changed


@pytest.mark.parametrize("sample", [IMU, POSITION, VELOCITY, HEADING])
def test_good_samples_have_no_fault(sample):
    assert fault_of(sample) == ""


@BAD
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("name", ["specific_force_b", "angular_rate_b"])
def test_imu_reading_that_is_not_finite(name, axis, bad):
    broken = dataclasses.replace(IMU, **{name: put(getattr(IMU, name), axis, bad)})
    assert fault_of(broken) == "force or rate is not finite"


@pytest.mark.parametrize(
    ("name", "largest"), [("specific_force_b", 400.0), ("angular_rate_b", 70.0)]
)
@pytest.mark.parametrize("sign", [-1, 1])
def test_imu_reading_that_no_sensor_gives(name, largest, sign):
    for value, fault in ((largest, ""), (1.001 * largest, "force or rate is out of range")):
        changed = put(getattr(IMU, name), 1, sign * value)
        assert fault_of(dataclasses.replace(IMU, **{name: changed})) == fault


def test_attitude_of_the_autopilot_is_not_the_filter_s_concern():
    broken = dataclasses.replace(IMU, autopilot_q_nb=np.full(4, math.nan))
    assert fault_of(broken) == ""


@BAD
@pytest.mark.parametrize("name", ["latitude_rad", "longitude_rad", "height_m"])
def test_position_that_is_not_finite(name, bad):
    assert fault_of(dataclasses.replace(POSITION, **{name: bad})) == "position is not finite"


@pytest.mark.parametrize(
    ("values", "fault"),
    [
        ({"latitude_rad": math.pi / 2}, ""),
        ({"latitude_rad": -math.pi / 2}, ""),
        ({"latitude_rad": 1.58}, "latitude or longitude is out of range"),
        ({"latitude_rad": 39.8}, "latitude or longitude is out of range"),  # degrees
        ({"longitude_rad": -math.pi}, ""),
        ({"longitude_rad": 1.9 * math.pi}, ""),  # 0 to 360 degrees is somebody's convention
        ({"longitude_rad": 116.0}, "latitude or longitude is out of range"),
        ({"latitude_rad": 0.0}, ""),
        ({"longitude_rad": 0.0}, ""),
        (
            {"latitude_rad": 0.0, "longitude_rad": 0.0},
            "position is 0, 0: receivers say so when they have none",
        ),
        ({"height_m": -430.0}, ""),
        ({"height_m": 9000.0}, ""),
        ({"height_m": 5e4}, "height is out of range"),
        ({"height_m": -5e4}, "height is out of range"),
    ],
)
def test_place_of_a_position(values, fault):
    assert fault_of(dataclasses.replace(POSITION, **values)) == fault


@BAD
@pytest.mark.parametrize("sample", [POSITION, VELOCITY])
@pytest.mark.parametrize("index", [(0, 0), (0, 1), (2, 2)])
def test_covariance_that_is_not_finite(sample, index, bad):
    broken = dataclasses.replace(sample, covariance_n=put(sample.covariance_n, index, bad))
    assert fault_of(broken) == "covariance is not finite"


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
def test_covariance_that_cannot_be(sample, covariance, fault):
    assert fault_of(dataclasses.replace(sample, covariance_n=covariance)) == fault


@given(st.integers(0, 2**32 - 1), st.floats(1e-8, 1e8))
def test_no_real_covariance_is_refused(seed, scale):
    """Of any rank, sent in single precision."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, rng.integers(1, 5)))
    covariance = (scale * root @ root.T).astype(np.float32).astype(float)
    assert fault_of(dataclasses.replace(POSITION, covariance_n=covariance)) == ""


@BAD
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_velocity_that_is_not_finite(axis, bad):
    broken = dataclasses.replace(VELOCITY, velocity_n=put(VELOCITY.velocity_n, axis, bad))
    assert fault_of(broken) == "velocity is not finite"


def test_velocity_of_no_aircraft():
    fast = dataclasses.replace(VELOCITY, velocity_n=np.array([0, -1000.1, 0]))
    assert fault_of(fast) == "velocity is out of range"


@BAD
@pytest.mark.parametrize("name", ["heading_rad", "variance_rad2"])
def test_heading_that_is_not_finite(name, bad):
    assert fault_of(dataclasses.replace(HEADING, **{name: bad})) == "heading is not finite"


def test_heading_of_unknown_variance_passes():
    assert fault_of(HeadingSample(1, -7.0, -1.0)) == ""


# Attitudes


@given(st.lists(st.floats(-4, 4), min_size=3, max_size=3).map(np.array), st.sampled_from([-1, 1]))
def test_rotations_are_usable(rotvec, sign):
    assert usable_attitude(sign * quat_from_rotvec(rotvec))


@pytest.mark.parametrize(
    ("q", "usable"),
    [
        (None, False),
        (np.zeros(4), False),
        (np.full(4, math.nan), False),
        (np.array([1.0, math.nan, 0, 0]), False),
        (np.array([math.inf, 0, 0, 1.0]), False),
        (np.array([1e200, 0, 0, 0]), False),
        (np.array([1.009, 0, 0, 0]), True),
        (np.array([1.02, 0, 0, 0]), False),
        (np.array([0.98, 0, 0, 0]), False),
        (np.ones(4), False),
    ],
)
def test_what_is_an_attitude(q, usable):
    assert usable_attitude(q) is usable


LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("value", "fault"),
    [
        (0.0, ""),
        (1.28e7, ""),  # the other end of the earth
        (1.29e7, "position is not finite, or not on this earth"),
        (-1e200, "position is not finite, or not on this earth"),
        (math.inf, "position is not finite, or not on this earth"),
        (math.nan, "position is not finite, or not on this earth"),
    ],
)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_pose_is_on_this_earth(axis, value, fault):
    assert pose_fault(put(np.zeros(3), axis, value), LEVEL, np.eye(6)) == fault


@pytest.mark.parametrize(
    ("value", "fault"),
    [
        (1e30, ""),  # not known
        (0.0, ""),
        (1e200, "covariance is not finite"),
        (math.nan, "covariance is not finite"),
        (-1.0, "covariance is not positive"),
    ],
)
@pytest.mark.parametrize("axis", [0, 5])
def test_a_pose_has_a_covariance(axis, value, fault):
    covariance = put(np.eye(6), (axis, axis), value)
    assert pose_fault(np.zeros(3), LEVEL, covariance) == fault


@pytest.mark.parametrize("q", [np.zeros(4), 1.01 * LEVEL, put(LEVEL, 3, math.nan), 1e200 * LEVEL])
def test_a_pose_is_turned_by_a_unit_quaternion(q):
    with np.errstate(over="ignore"):
        assert pose_fault(np.zeros(3), q, np.eye(6)) == "attitude is no unit quaternion"


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e7, -1e200])
def test_a_joint_has_an_angle(bad):
    assert joints_fault((0.0, -math.pi, 100.0)) == ""
    assert joints_fault((0.0, 0.0, bad)) == "angle is not finite or no angle"


@pytest.mark.parametrize(
    ("place", "fault"),
    [
        ((0.0, 0.0, 0.0), ""),  # of a plane; of a receiver it means that there is none
        ((0.5, 3.0, 60_000.0), "height is out of range"),
        ((0.5, 3.0, math.inf), "position is not finite"),
        ((60.0, 3.0, 10.0), "latitude or longitude is out of range"),
    ],
)
def test_an_origin_is_a_place(place, fault):
    assert place_fault(*place) == fault


@pytest.mark.parametrize("variance", [math.inf, math.nan, 1e200])
def test_a_heading_has_a_variance(variance):
    broken = dataclasses.replace(HEADING, variance_rad2=variance)
    assert fault_of(broken) == "heading is not finite"
