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
"""Samples, poses, located points and diagnostics to messages and back; nothing is judged here."""

from __future__ import annotations

import dataclasses
import math

import message_samples as samples
import numpy as np
import pytest
from hypothesis import given, strategies as st
from message_samples import EXACT, assert_same_rotation, builder, through_cdr
from numpy.testing import assert_allclose, assert_array_equal

from tirgeo_ros.core.frames import rotations as frames
from tirgeo_ros.core.frames.rotations import (
    matrix_from_euler,
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_euler,
    quat_from_rotvec,
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
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.io import messages
from tirgeo_ros.io.messages import SENSED_SAMPLES, sensed
from tirgeo_ros.io.messages.message_parts import (
    UNKNOWN_VARIANCE,
    covariance_turned_world,
    quat_turned_world,
)
from tirgeo_ros.io.messages.sensor_messages import heading_sample, position_sample, velocity_sample

unit = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(
    lambda q: np.linalg.norm(q) > 1e-3
)


#: Sample, how it becomes a message, its frame, and how the message is read.
ROUND_TRIPS = {
    "imu": (samples.IMU, builder.imu, "base_link", messages.imu_sample),
    "position": (
        samples.POSITION,
        lambda sample: builder.nav_sat_fix(sample, "rtk"),
        "rtk",
        lambda message: position_sample(message, Source.RTK_POSITION),
    ),
    "camera attitude": (
        samples.CAMERA_ATTITUDE,
        builder.camera_attitude,
        "map",
        messages.camera_attitude,
    ),
    "camera pose": (samples.CAMERA_POSE, builder.camera_pose, "map", messages.camera_pose),
    "origin": (samples.PLANE, lambda p: builder.origin(p, 7), "map", messages.tangent_plane),
    "odometry": (
        dataclasses.replace(samples.BODY, stamp_ns=samples.SOLUTION.stamp_ns),
        lambda pose: builder.odometry(samples.SOLUTION, pose),
        "map",
        messages.body_pose,
    ),
}


@pytest.mark.parametrize("name", ROUND_TRIPS)
def test_round_trips(name):
    sample, encode, frame, decode = ROUND_TRIPS[name]
    message = through_cdr(encode(sample))
    assert message.header.frame_id == frame
    result = decode(message)
    for key in (field.name for field in dataclasses.fields(sample) if field.init):
        got, wanted = getattr(result, key), getattr(sample, key)
        if "q_" in key:
            assert_same_rotation(got, wanted)
        elif isinstance(wanted, float | np.ndarray):  # radians to degrees and back: roundings
            assert_allclose(got, wanted, rtol=1e-15)
        else:
            assert got == wanted


def test_imu_at_rest_reads_up_also_without_attitude():
    message = builder.imu(ImuSample(0, np.array([0.0, 0.0, -9.8]), np.zeros(3)))
    assert message.linear_acceleration.z == pytest.approx(9.8)
    assert message.orientation_covariance[0] == -1
    assert messages.imu_sample(message).autopilot_q_nb is None


@pytest.mark.parametrize("number", [0.0, math.nan])
def test_bad_quaternion_goes_through_for_the_core_to_judge(number):
    message = builder.imu(samples.IMU)
    for axis in "wxyz":
        setattr(message.orientation, axis, number)
    assert_array_equal(messages.imu_sample(message).autopilot_q_nb, np.full(4, number))
    assert math.isnan(heading_sample(message).heading_rad)


def test_unknown_covariance_becomes_zero():
    message = builder.nav_sat_fix(samples.POSITION, "rtk")
    message.position_covariance_type = 0
    assert not position_sample(message, Source.RTK_POSITION).covariance_n.any()
    message.position_covariance_type = 3
    message.position_covariance[0] = -1
    assert not position_sample(message, Source.RTK_POSITION).covariance_n.any()


@pytest.mark.parametrize(
    ("number", "status"),
    [(-2, "NONE"), (-1, "NONE"), (0, "SINGLE"), (1, "FLOAT"), (2, "FIXED"), (7, "NONE")],
)
def test_fix_status(number, status):
    message = builder.nav_sat_fix(samples.POSITION, "rtk")
    message.status.status = number
    assert position_sample(message, Source.GPS_POSITION).status is FixStatus[status]


def test_velocity_round_trip():
    message = through_cdr(builder.velocity(samples.VELOCITY, "rtk"))
    assert (message.twist.twist.linear.x, message.twist.twist.linear.z) == (2.0, 0.5)
    assert message.twist.covariance[21] == UNKNOWN_VARIANCE
    sample = velocity_sample(message, Source.RTK_VELOCITY)
    assert_array_equal(sample.velocity_n, samples.VELOCITY.velocity_n)
    assert_array_equal(sample.covariance_n, samples.VELOCITY.covariance_n)


@given(st.floats(0, 2 * math.pi, exclude_max=True))
def test_heading_round_trip(heading_rad):
    message = builder.heading(HeadingSample(5, heading_rad, 0.01))
    assert message.angular_velocity_covariance[0] == -1  # absent
    assert message.linear_acceleration_covariance[0] == -1
    sample = heading_sample(message)
    turn = sample.heading_rad - heading_rad
    assert 0 <= sample.heading_rad <= 2 * math.pi
    # Near 180 deg of yaw the half angle keeps all digits; a few roundings of numbers up to 2 pi.
    assert math.cos(turn) == pytest.approx(1, abs=EXACT)
    assert math.sin(turn) == pytest.approx(0, abs=EXACT)
    assert (sample.stamp_ns, sample.variance_rad2) == (5, 0.01)


def test_heading_of_a_tilted_or_scaled_quaternion():
    message = builder.imu(ImuSample(0, np.zeros(3), np.zeros(3), quat_from_euler(0.1, 0.2, 1.0)))
    for axis in "wxyz":
        setattr(message.orientation, axis, 3 * getattr(message.orientation, axis))
    assert heading_sample(message).heading_rad == pytest.approx(1.0, abs=EXACT)


def test_joints_turn_the_camera_as_their_flu_chain_does():
    message = through_cdr(builder.joints(samples.JOINTS))
    angle = dict(zip(message.name, message.position, strict=True))
    flu = (
        matrix_from_euler(0, 0, angle["gimbal_yaw_joint"])
        @ matrix_from_euler(angle["gimbal_roll_joint"], 0, 0)
        @ matrix_from_euler(0, angle["gimbal_pitch_joint"], 0)
    )
    frd = (
        matrix_from_euler(0, 0, samples.JOINTS.yaw_rad)
        @ matrix_from_euler(samples.JOINTS.roll_rad, 0, 0)
        @ matrix_from_euler(0, samples.JOINTS.pitch_rad, 0)
    )
    assert_allclose(frames.FLU_FRD @ flu @ frames.FLU_FRD, frd, atol=EXACT)
    computed = dataclasses.replace(samples.JOINTS, computed=True)
    for sample, frame in ((samples.JOINTS, "base_link"), (computed, "gimbal/attitude")):
        message = through_cdr(builder.joints(sample))
        assert message.header.frame_id == frame
        assert messages.joint_sample(message) == sample


def test_joints_are_found_by_name():
    message = builder.joints(samples.JOINTS)
    message.name = ["propeller", *reversed(message.name)]
    message.position = np.array([99.0, *message.position[::-1]])
    assert messages.joint_sample(message) == samples.JOINTS


@pytest.mark.parametrize("joint", ["gimbal_yaw_joint", "gimbal_roll_joint", "gimbal_pitch_joint"])
def test_a_missing_joint_is_named(joint):
    message = builder.joints(JointSample(0, 0.1, 0.2, 0.3))
    message.name = [name.replace(joint, "other") for name in message.name]
    with pytest.raises(MessageError, match=f"gimbal/joint_states: no position of {joint}"):
        messages.joint_sample(message)


@pytest.mark.parametrize("heading_rad", [0.0, 1.2, 3.5, 6.2])
def test_a_heading_that_is_set_is_a_yaw_in_map(heading_rad):
    sample = SetHeading(samples.STAMP_NS, heading_rad, 0.01)
    topic, message = sensed(builder, sample)
    assert topic == "ekf_node/set_heading"
    assert message.header.frame_id == "map"
    turned = message.pose.pose.orientation
    assert 2 * math.atan2(turned.z, turned.w) == pytest.approx(0.5 * math.pi - heading_rad)
    back = SENSED_SAMPLES[topic](through_cdr(message))
    assert (back.stamp_ns, back.variance_rad2) == (sample.stamp_ns, sample.variance_rad2)
    assert back.heading_rad == pytest.approx(heading_rad, abs=1e-12)
    turned.z = turned.w = 0.0
    assert "not finite" in fault_of(SENSED_SAMPLES[topic](message))


def test_twist_is_in_the_body():
    message = builder.odometry(samples.SOLUTION, samples.BODY)
    forward_right_down = matrix_from_quat(samples.SOLUTION.q_nb).T @ samples.SOLUTION.velocity_n
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    wanted = forward_right_down * [1, -1, -1]
    assert_allclose([linear.x, linear.y, linear.z], wanted, rtol=1e-13)
    assert_array_equal(
        [angular.x, angular.y, angular.z], samples.SOLUTION.angular_rate_b * [1, -1, -1]
    )


def body_velocity_flu(error, solution=samples.SOLUTION):
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
    wanted = partials @ samples.SOLUTION.covariance[3:, 3:] @ partials.T
    message = builder.odometry(samples.SOLUTION, samples.BODY)
    covariance = message.twist.covariance.reshape(6, 6)
    # Central differences with steps of 1e-6: rounding 1e-16 / 1e-6 times entries of order 10.
    assert_allclose(covariance[:3, :3], wanted, rtol=1e-8, atol=1e-8)
    assert_array_equal(covariance[3:, 3:], np.diag(samples.SOLUTION.rate_variance_b))
    assert not covariance[:3, 3:].any()


@pytest.mark.parametrize("height_m", [math.inf, math.nan, 1e200])
def test_an_origin_that_is_no_place_is_refused(height_m):
    message = builder.origin(dataclasses.replace(samples.PLANE, height_m=height_m), 7)
    with pytest.raises(MessageError, match=r"^tirgeo/origin: .*(not finite|out of range)"):
        messages.tangent_plane(message)


@pytest.mark.parametrize(("space", "aircraft"), [("/", "aircraft"), ("/a/uav1/", "a/uav1")])
def test_a_diagnostic_names_its_aircraft(space, aircraft):
    items = [messages.DiagnosticItem(f"{space}ekf_node: a/b: c", 0, "")]
    assert builder.diagnostics(0, items).status[0].hardware_id == aircraft


def test_a_diagnostic_has_all_of_the_filters_status():
    status = dataclasses.replace(samples.STATUS, nis={"imu": 1.5}, vibration=(0.25, math.nan))
    item = messages.navigation_item("ekf_node: state", status)
    (message,) = through_cdr(builder.diagnostics(0, [item])).status
    assert (message.level, message.message) == (1, "aligning: too slow")
    assert {pair.key: pair.value for pair in message.values} == {
        "method": "ekf_heading",
        "state": "aligning",
        "state_time_s": "3.75",
        "reason": "too slow",
        "began_again": "gap",
        "rtk_status": "float",
        "heading_sigma_deg": repr(math.degrees(0.0123)),
        "last_reset": "position by 3.21 m",
        "count.rtk_position.used": "12",
        "count.rtk_heading.gated": "3",
        "test_ratio.rtk_position": "0.25",
        "test_ratio.rtk_heading": "1.75",
        "reset.rtk_position": "2",
        "reset.rtk_heading": "1",
        "nis.imu": "1.5",
        "imu_delay_ms": "4.5",
        "imu_delay_sigma_ms": "1.5",
        "process_noise": "",
        "vibration": "0.25 nan",
        "clipped.accelerometer x": "12",
        "warnings": "imu/data: accelerometer x clipped; another",
    }


def test_a_warning_while_running_is_the_message():
    calm = dataclasses.replace(samples.STATUS, state=FilterState.RUNNING, reason="", warnings=())
    assert messages.navigation_item("n", calm).level == 0
    status = dataclasses.replace(samples.STATUS, state=FilterState.RUNNING, reason="")
    item = messages.navigation_item("n", status)
    assert item.level == 1
    assert item.message == "running: imu/data: accelerometer x clipped; another"
    assert item.values["clipped.accelerometer x"] == "12"
    lost = dataclasses.replace(status, state=FilterState.LOST, reason="far off")
    assert messages.navigation_item("n", lost).level == 2
    assert messages.navigation_item("n", lost).message == "lost: far off"


# tirgeo/locate


def test_the_fix_is_the_place_with_its_covariance_in_enu():
    fix, sent = through_cdr(builder.located_fix(samples.LOCATED)), samples.LOCATED.covariance_n
    assert messages.stamp_ns(fix) == samples.STAMP_NS
    assert fix.header.frame_id == "map"
    assert_allclose(
        [fix.latitude, fix.longitude, fix.altitude],
        [math.degrees(0.55), math.degrees(-2.1), 99.5],
    )
    covariance = fix.position_covariance.reshape(3, 3)
    assert fix.position_covariance_type == 3
    assert (covariance[0, 0], covariance[1, 1]) == (sent[1, 1], sent[0, 0])
    assert covariance[0, 2] == -sent[1, 2]
    back = position_sample(fix, Source.RTK_POSITION)
    assert_array_equal(back.covariance_n, sent)


def test_the_point_is_in_the_map_and_has_no_attitude():
    point = through_cdr(builder.located_point(samples.LOCATED))
    assert point.header.frame_id == "map"
    position = point.pose.pose.position
    assert (position.x, position.y, position.z) == (2.0, 1.0, -3.0)
    q = point.pose.pose.orientation
    assert (q.w, q.x, q.y, q.z) == (1.0, 0.0, 0.0, 0.0)
    covariance = point.pose.covariance.reshape(6, 6)
    assert covariance.diagonal()[3:].tolist() == [UNKNOWN_VARIANCE] * 3
    pose = messages.camera_pose(point)
    assert pose.stamp_ns == samples.STAMP_NS
    assert_array_equal(pose.position_n, samples.LOCATED.point_n)
    assert_array_equal(pose.covariance[:3, :3], samples.LOCATED.covariance_n)


def test_a_clicked_pixel_comes_back():
    clicked = (samples.STAMP_NS, 12.5, 7.25)
    assert messages.pixel(through_cdr(builder.pixel(*clicked))) == clicked


# axes


rotvecs = st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array)


@given(rotvecs)
def test_attitude_is_the_same_in_both_worlds(rotvec):
    q_nb = quat_from_rotvec(rotvec)
    converted = frames.quat_turned_both(*q_nb)
    expected = frames.ENU_NED @ matrix_from_quat(q_nb) @ frames.FLU_FRD
    assert_allclose(matrix_from_quat(converted), expected, atol=EXACT)
    assert_allclose(frames.quat_turned_both(*converted), q_nb, atol=EXACT)


@given(rotvecs)
def test_only_the_world_changes(rotvec):
    q = quat_from_rotvec(rotvec)
    converted = quat_turned_world(*q)
    expected = frames.ENU_NED @ matrix_from_quat(q)
    assert_allclose(matrix_from_quat(converted), expected, atol=EXACT)
    back = matrix_from_quat(quat_turned_world(*converted))
    assert_allclose(back, matrix_from_quat(q), atol=EXACT)


@pytest.mark.parametrize("blocks", [1, 2])
def test_covariance_of_turned_vectors(blocks):
    size = 3 * blocks
    root = np.random.default_rng(1).normal(size=(size, size))
    covariance = root @ root.T
    converted = covariance_turned_world(covariance, size)
    turn = np.kron(np.eye(blocks), frames.ENU_NED)
    # a permutation with signs: no rounding at all
    assert_array_equal(converted.reshape(size, size), turn @ covariance @ turn.T)
    back = covariance_turned_world(converted, size).reshape(size, size)
    assert_array_equal(back, covariance)
