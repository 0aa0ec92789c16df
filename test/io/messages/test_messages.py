"""Samples to messages and back: axes, signs, marks of absence; nothing is judged here."""

from __future__ import annotations

import dataclasses
import math

import message_samples as given
import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from tirgeo_ros.core.frames import axes as frames
from tirgeo_ros.core.frames.rotations import (
    canonical,
    matrix_from_euler,
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_euler,
)
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    Source,
)
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.io import messages
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.io.messages.encode import UNKNOWN_VARIANCE

# The only arithmetic between a sample and its twin is a rotation by 180 deg: a few roundings.
EXACT = 1e-14

cdr = Cdr()
made = Messages(cdr.types)

unit = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(
    lambda q: np.linalg.norm(q) > 1e-3
)


def through_cdr(message):
    typename = message.__msgtype__
    return cdr.deserialize(cdr.serialize(message, typename), typename)


def assert_same_rotation(p, q, tolerance=EXACT):
    p, q = canonical(p), canonical(q)
    # Of a half turn both signs are canonical.
    assert_allclose(p * np.sign(p @ q), q, rtol=0, atol=tolerance)


@pytest.mark.parametrize("name", given.EVERY_MESSAGE)
def test_every_message_survives_cdr(name):
    typename, make = given.EVERY_MESSAGE[name]
    message = make(made)
    data = cdr.serialize(message, typename)
    assert cdr.serialize(cdr.deserialize(data, typename), typename) == data


# imu/data


def test_imu_at_rest_reads_up():
    message = made.imu(ImuSample(0, np.array([0.0, 0.0, -9.8]), np.zeros(3)))
    assert message.linear_acceleration.z == pytest.approx(9.8)
    assert message.header.frame_id == "base_link"


def test_imu_round_trip():
    sample = messages.imu_sample(through_cdr(made.imu(given.IMU)))
    assert sample.stamp_ns == given.IMU.stamp_ns
    assert_array_equal(sample.specific_force_b, given.IMU.specific_force_b)
    assert_array_equal(sample.angular_rate_b, given.IMU.angular_rate_b)
    assert_same_rotation(sample.autopilot_q_nb, given.IMU.autopilot_q_nb)


def test_imu_without_attitude():
    message = made.imu(ImuSample(0, np.zeros(3), np.zeros(3)))
    assert message.orientation_covariance[0] == -1
    assert messages.imu_sample(message).autopilot_q_nb is None


@drawn(unit)
def test_both_signs_of_a_quaternion_are_one_attitude(q):
    q = canonical(np.array(q))
    for sign in (1, -1):
        message = made.imu(ImuSample(0, np.zeros(3), np.zeros(3), sign * q))
        assert message.orientation.w >= 0
        assert_same_rotation(messages.imu_sample(message).autopilot_q_nb, q)


@pytest.mark.parametrize("number", [0.0, math.nan])
def test_bad_quaternion_goes_through_for_the_core_to_judge(number):
    message = made.imu(given.IMU)
    for axis in "wxyz":
        setattr(message.orientation, axis, number)
    assert_array_equal(messages.imu_sample(message).autopilot_q_nb, np.full(4, number))


# fixes and velocities


def test_position_round_trip():
    sample = messages.position_sample(
        through_cdr(made.nav_sat_fix(given.POSITION, "rtk")), Source.RTK_POSITION
    )
    assert sample.status is FixStatus.FIXED
    assert sample.source is Source.RTK_POSITION
    # Radians to degrees and back: two roundings.
    assert sample.latitude_rad == pytest.approx(given.POSITION.latitude_rad, rel=1e-15)
    assert sample.longitude_rad == pytest.approx(given.POSITION.longitude_rad, rel=1e-15)
    assert sample.height_m == given.POSITION.height_m
    assert_array_equal(sample.covariance_n, given.POSITION.covariance_n)


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


def test_unknown_velocity_covariance_becomes_zero():
    message = made.velocity(given.VELOCITY, "rtk")
    message.twist.covariance[0] = -1
    assert not messages.velocity_sample(message, Source.RTK_VELOCITY).covariance_n.any()


# rtk/heading


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


def test_absent_heading_is_nan():
    message = made.heading(given.HEADING)
    message.orientation_covariance[0] = -1
    assert math.isnan(messages.heading_sample(message).heading_rad)


# gimbal


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


def test_camera_attitude_round_trip():
    sample = messages.camera_attitude(through_cdr(made.camera_attitude(given.CAMERA_ATTITUDE)))
    assert_same_rotation(sample.q_ng, given.CAMERA_ATTITUDE.q_ng)
    assert sample.stamp_ns == given.CAMERA_ATTITUDE.stamp_ns


# tirgeo/odometry, tirgeo/camera_pose, tirgeo/origin, tirgeo/fix


def test_odometry_frames_and_pose():
    message = through_cdr(made.odometry(given.SOLUTION, given.BODY))
    assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")
    pose = messages.body_pose(message)
    assert_array_equal(pose.position_n, given.BODY.position_n)
    assert_same_rotation(pose.q_nb, given.BODY.q_nb)
    assert_array_equal(pose.covariance, given.BODY.covariance)


def test_twist_is_in_the_body():
    message = made.odometry(given.SOLUTION, given.BODY)
    forward_right_down = matrix_from_quat(given.SOLUTION.q_nb).T @ given.SOLUTION.velocity_n
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    wanted = forward_right_down * [1, -1, -1]
    assert_allclose([linear.x, linear.y, linear.z], wanted, rtol=1e-13)
    assert_array_equal(
        [angular.x, angular.y, angular.z], given.SOLUTION.angular_rate_b * [1, -1, -1]
    )


def body_velocity_flu(error, solution=given.SOLUTION):
    """Body velocity of a state that is off by (attitude phi_n, velocity) of (6,)."""
    rotation = matrix_from_rotvec(error[:3]) @ matrix_from_quat(solution.q_nb)
    return frames.FLU_FRD @ rotation.T @ (solution.velocity_n + error[3:])


def test_twist_covariance_is_that_of_the_solution_in_the_body():
    step = 1e-6
    partials = np.column_stack(
        [
            (body_velocity_flu(step * axis) - body_velocity_flu(-step * axis)) / (2 * step)
            for axis in np.eye(6)
        ]
    )
    wanted = partials @ given.SOLUTION.covariance[3:, 3:] @ partials.T
    message = made.odometry(given.SOLUTION, given.BODY)
    covariance = message.twist.covariance.reshape(6, 6)
    # Central differences with steps of 1e-6: rounding 1e-16 / 1e-6 times entries of order 10.
    assert_allclose(covariance[:3, :3], wanted, rtol=1e-8, atol=1e-8)
    assert_array_equal(covariance[3:, 3:], np.diag(given.SOLUTION.rate_variance_b))
    assert not covariance[:3, 3:].any()


def test_camera_pose_round_trip():
    message = through_cdr(made.camera_pose(given.CAMERA_POSE))
    assert message.header.frame_id == "map"
    pose = messages.camera_pose(message)
    assert_array_equal(pose.position_n, given.CAMERA_POSE.position_n)
    assert_same_rotation(pose.q_nc, given.CAMERA_POSE.q_nc)
    assert_array_equal(pose.covariance, given.CAMERA_POSE.covariance)


def test_origin_round_trip():
    plane = messages.tangent_plane(through_cdr(made.origin(given.PLANE, 7)))
    assert plane.latitude_rad == pytest.approx(given.PLANE.latitude_rad, rel=1e-15)
    assert plane.longitude_rad == pytest.approx(given.PLANE.longitude_rad, rel=1e-15)
    assert plane.height_m == given.PLANE.height_m


@pytest.mark.parametrize("height_m", [math.inf, math.nan, 1e200])
def test_an_origin_that_is_no_place_is_refused(height_m):
    message = made.origin(dataclasses.replace(given.PLANE, height_m=height_m), 7)
    with pytest.raises(MessageError, match=r"^tirgeo/origin: .*(not finite|out of range)"):
        messages.tangent_plane(message)


def test_fix_of_the_solution():
    sample = messages.position_sample(made.fix(given.SOLUTION), Source.RTK_POSITION)
    assert_array_equal(sample.covariance_n, given.SOLUTION.covariance[:3, :3])
    assert sample.height_m == given.SOLUTION.height_m


# diagnostics


def test_navigation_status_round_trip():
    item = made.navigation_diagnostic("ekf_node: state", given.STATUS)
    (message,) = through_cdr(made.diagnostics(0, [item])).status
    status = messages.navigation_status(message)
    assert status.heading_sigma_rad == pytest.approx(given.STATUS.heading_sigma_rad, rel=1e-15)
    given_sigma = dataclasses.replace(status, heading_sigma_rad=given.STATUS.heading_sigma_rad)
    assert given_sigma == given.STATUS
    assert (message.level, message.message) == (1, "aligning: too slow")


def test_running_is_ok_and_an_unknown_sigma_survives():
    status = NavigationStatus("raw", FilterState.RUNNING, "", FixStatus.NONE, math.nan, {}, {})
    item = made.navigation_diagnostic("n", status)
    assert (item.level, item.message) == (0, "running")
    (message,) = made.diagnostics(0, [item]).status
    assert math.isnan(messages.navigation_status(message).heading_sigma_rad)


def test_a_warning_while_running_is_the_message():
    status = dataclasses.replace(given.STATUS, state=FilterState.RUNNING, reason="")
    item = made.navigation_diagnostic("n", status)
    assert item.level == 1
    assert item.message == "running: imu/data: accelerometer x clipped; another"
    assert item.values["clipped.accelerometer x"] == "12"
    lost = dataclasses.replace(status, state=FilterState.LOST, reason="far off")
    assert made.navigation_diagnostic("n", lost).level == 2
    assert made.navigation_diagnostic("n", lost).message == "lost: far off"


@pytest.mark.parametrize(
    ("state", "level"),
    [
        (FilterState.RUNNING, 0),
        (FilterState.WAITING, 1),
        (FilterState.ALIGNING, 1),
        (FilterState.DEGRADED, 1),
        (FilterState.DEAD_RECKONING, 1),
        (FilterState.LOST, 2),
    ],
)
def test_every_state_has_its_level_and_comes_back(state, level):
    given_status = dataclasses.replace(given.STATUS, state=state, reason="", warnings=())
    item = made.navigation_diagnostic("n", given_status)
    assert (item.level, item.message) == (level, state.value)
    (message,) = through_cdr(made.diagnostics(0, [item])).status
    assert messages.navigation_status(message).state is state


def test_a_recording_without_time_and_resets_is_read():
    item = made.navigation_diagnostic("n", given.STATUS)
    new = {"state_time_s", "last_reset", "reset.rtk_position", "reset.rtk_heading"}
    new |= {"clipped.accelerometer x", "warnings"}
    assert new <= item.values.keys()
    old = {key: value for key, value in item.values.items() if key not in new}
    (message,) = made.diagnostics(0, [messages.DiagnosticItem("n", 1, "", old)]).status
    status = messages.navigation_status(message)
    assert (status.state_s, status.resets, status.last_reset) == (0.0, {}, "")
    assert (status.clipped, status.warnings) == ({}, ())
    assert status.counts == given.STATUS.counts


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("state", "dreaming"),
        ("heading_sigma_deg", "wide"),
        ("method", None),
        ("state_time_s", "long"),
    ],
)
def test_other_diagnostics_are_no_navigation_status(key, value):
    item = made.navigation_diagnostic("other", given.STATUS)
    values = {k: (value if k == key else v) for k, v in item.values.items()}
    values = {k: v for k, v in values.items() if v is not None}
    changed = messages.DiagnosticItem("other", 0, "", values)
    (message,) = made.diagnostics(0, [changed]).status
    with pytest.raises(MessageError, match="'other' is no navigation status"):
        messages.navigation_status(message)
