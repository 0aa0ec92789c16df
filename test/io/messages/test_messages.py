"""Samples to messages and back: axes, signs, marks of absence; nothing is judged here."""

from __future__ import annotations

import dataclasses
import math

import message_samples as given
import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import strategies as st
from message_round_trips import EXACT, assert_same_rotation, cdr, made, through_cdr
from numpy.testing import assert_allclose, assert_array_equal

from tirgeo_ros.core.frames import axes as frames
from tirgeo_ros.core.frames.rotations import (
    matrix_from_euler,
    quat_from_euler,
)
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    SetHeading,
    Source,
)
from tirgeo_ros.io import messages
from tirgeo_ros.io.messages import SENSED_SAMPLES, sensed
from tirgeo_ros.io.messages.encode import UNKNOWN_VARIANCE

unit = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(
    lambda q: np.linalg.norm(q) > 1e-3
)


@pytest.mark.parametrize("name", given.EVERY_MESSAGE)
def test_every_message_survives_cdr(name):
    typename, make = given.EVERY_MESSAGE[name]
    message = make(made)
    data = cdr.serialize(message, typename)
    assert cdr.serialize(cdr.deserialize(data, typename), typename) == data


#: Sample, how it becomes a message, its frame, and how the message is read.
ROUND_TRIPS = {
    "imu": (given.IMU, made.imu, "base_link", messages.imu_sample),
    "position": (
        given.POSITION,
        lambda sample: made.nav_sat_fix(sample, "rtk"),
        "rtk",
        lambda message: messages.position_sample(message, Source.RTK_POSITION),
    ),
    "camera attitude": (
        given.CAMERA_ATTITUDE,
        made.camera_attitude,
        "map",
        messages.camera_attitude,
    ),
    "camera pose": (given.CAMERA_POSE, made.camera_pose, "map", messages.camera_pose),
    "origin": (given.PLANE, lambda p: made.origin(p, 7), "map", messages.tangent_plane),
    "odometry": (
        dataclasses.replace(given.BODY, stamp_ns=given.SOLUTION.stamp_ns),
        lambda pose: made.odometry(given.SOLUTION, pose),
        "map",
        messages.body_pose,
    ),
}


@pytest.mark.parametrize("name", ROUND_TRIPS)
def test_round_trips(name):
    sample, encode, frame, decode = ROUND_TRIPS[name]
    message = through_cdr(encode(sample))
    assert message.header.frame_id == frame
    found = decode(message)
    for key in (field.name for field in dataclasses.fields(sample) if field.init):
        got, wanted = getattr(found, key), getattr(sample, key)
        if "q_" in key:
            assert_same_rotation(got, wanted)
        elif isinstance(wanted, float | np.ndarray):  # radians to degrees and back: roundings
            assert_allclose(got, wanted, rtol=1e-15)
        else:
            assert got == wanted


def test_imu_at_rest_reads_up():
    message = made.imu(ImuSample(0, np.array([0.0, 0.0, -9.8]), np.zeros(3)))
    assert message.linear_acceleration.z == pytest.approx(9.8)
    assert message.header.frame_id == "base_link"


def test_imu_without_attitude():
    message = made.imu(ImuSample(0, np.zeros(3), np.zeros(3)))
    assert message.orientation_covariance[0] == -1
    assert messages.imu_sample(message).autopilot_q_nb is None


@pytest.mark.parametrize("number", [0.0, math.nan])
def test_bad_quaternion_goes_through_for_the_core_to_judge(number):
    message = made.imu(given.IMU)
    for axis in "wxyz":
        setattr(message.orientation, axis, number)
    assert_array_equal(messages.imu_sample(message).autopilot_q_nb, np.full(4, number))


def test_unknown_covariance_becomes_zero():
    message = made.nav_sat_fix(given.POSITION, "rtk")
    message.position_covariance_type = 0
    assert not messages.position_sample(message, Source.RTK_POSITION).covariance_n.any()
    message.position_covariance_type = 3
    message.position_covariance[0] = -1
    assert not messages.position_sample(message, Source.RTK_POSITION).covariance_n.any()


@pytest.mark.parametrize(
    ("number", "status"),
    [(-2, "NONE"), (-1, "NONE"), (0, "SINGLE"), (1, "FLOAT"), (2, "FIXED"), (7, "NONE")],
)
def test_fix_status(number, status):
    message = made.nav_sat_fix(given.POSITION, "rtk")
    message.status.status = number
    assert messages.position_sample(message, Source.GPS_POSITION).status is FixStatus[status]


def test_velocity_round_trip():
    message = through_cdr(made.velocity(given.VELOCITY, "rtk"))
    assert (message.twist.twist.linear.x, message.twist.twist.linear.z) == (2.0, 0.5)
    assert message.twist.covariance[21] == UNKNOWN_VARIANCE
    sample = messages.velocity_sample(message, Source.RTK_VELOCITY)
    assert_array_equal(sample.velocity_n, given.VELOCITY.velocity_n)
    assert_array_equal(sample.covariance_n, given.VELOCITY.covariance_n)


@drawn(st.floats(0, 2 * math.pi, exclude_max=True))
def test_heading_round_trip(heading_rad):
    sample = messages.heading_sample(made.heading(HeadingSample(5, heading_rad, 0.01)))
    turn = sample.heading_rad - heading_rad
    assert 0 <= sample.heading_rad <= 2 * math.pi
    # Near 180 deg of yaw the half angle keeps all digits; a few roundings of numbers up to 2 pi.
    assert math.cos(turn) == pytest.approx(1, abs=EXACT)
    assert math.sin(turn) == pytest.approx(0, abs=EXACT)
    assert (sample.stamp_ns, sample.variance_rad2) == (5, 0.01)


def test_heading_marks_the_rest_as_absent():
    message = made.heading(HeadingSample(0, 0.0, 0.25))
    assert message.orientation_covariance[8] == 0.25
    assert message.angular_velocity_covariance[0] == -1
    assert message.linear_acceleration_covariance[0] == -1


def test_heading_of_a_tilted_or_scaled_quaternion():
    message = made.imu(ImuSample(0, np.zeros(3), np.zeros(3), quat_from_euler(0.1, 0.2, 1.0)))
    for axis in "wxyz":
        setattr(message.orientation, axis, 3 * getattr(message.orientation, axis))
    assert messages.heading_sample(message).heading_rad == pytest.approx(1.0, abs=EXACT)


@pytest.mark.parametrize("number", [0.0, math.nan])
def test_heading_of_no_quaternion_is_nan(number):
    message = made.heading(given.HEADING)
    for axis in "wxyz":
        setattr(message.orientation, axis, number)
    assert math.isnan(messages.heading_sample(message).heading_rad)


def test_joints_turn_the_camera_as_their_flu_chain_does():
    message = through_cdr(made.joints(given.JOINTS))
    angle = dict(zip(message.name, message.position, strict=True))
    flu = (
        matrix_from_euler(0, 0, angle["gimbal_yaw_joint"])
        @ matrix_from_euler(angle["gimbal_roll_joint"], 0, 0)
        @ matrix_from_euler(0, angle["gimbal_pitch_joint"], 0)
    )
    frd = (
        matrix_from_euler(0, 0, given.JOINTS.yaw_rad)
        @ matrix_from_euler(given.JOINTS.roll_rad, 0, 0)
        @ matrix_from_euler(0, given.JOINTS.pitch_rad, 0)
    )
    assert_allclose(frames.FLU_FRD @ flu @ frames.FLU_FRD, frd, atol=EXACT)
    assert messages.joint_sample(message) == given.JOINTS


@pytest.mark.parametrize("computed", [False, True])
def test_joints_say_whether_they_are_computed(computed):
    sample = dataclasses.replace(given.JOINTS, computed=computed)
    message = through_cdr(made.joints(sample))
    assert message.header.frame_id == ("gimbal/attitude" if computed else "base_link")
    assert messages.joint_sample(message) == sample


def test_joints_are_found_by_name():
    message = made.joints(given.JOINTS)
    message.name = ["propeller", *reversed(message.name)]
    message.position = np.array([99.0, *message.position[::-1]])
    assert messages.joint_sample(message) == given.JOINTS


@pytest.mark.parametrize("joint", ["gimbal_yaw_joint", "gimbal_roll_joint", "gimbal_pitch_joint"])
def test_a_missing_joint_is_named(joint):
    message = made.joints(JointSample(0, 0.1, 0.2, 0.3))
    message.name = [name.replace(joint, "other") for name in message.name]
    with pytest.raises(MessageError, match=f"gimbal/joint_states: no position of {joint}"):
        messages.joint_sample(message)


def test_names_without_positions():
    message = made.joints(given.JOINTS)
    message.position = message.position[:2]
    with pytest.raises(MessageError, match="no position of gimbal_pitch_joint"):
        messages.joint_sample(message)


@pytest.mark.parametrize("heading_rad", [0.0, 1.2, 3.5, 6.2])
def test_a_heading_that_is_set_is_a_yaw_in_map(heading_rad):
    sample = SetHeading(given.STAMP_NS, heading_rad, 0.01)
    topic, message = sensed(made, sample)
    assert topic == "ekf_node/set_heading"
    assert message.header.frame_id == "map"
    turned = message.pose.pose.orientation
    assert 2 * math.atan2(turned.z, turned.w) == pytest.approx(0.5 * math.pi - heading_rad)
    back = SENSED_SAMPLES[topic](through_cdr(message))
    assert (back.stamp_ns, back.variance_rad2) == (sample.stamp_ns, sample.variance_rad2)
    assert back.heading_rad == pytest.approx(heading_rad, abs=1e-12)
    turned.z = turned.w = 0.0
    assert "not finite" in fault_of(SENSED_SAMPLES[topic](message))
