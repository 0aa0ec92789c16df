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
"""The camera's pose from body and gimbal: Equation 12, joints in every order, covariances."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tirgeo_ros.core.config import AircraftConfig, GimbalConfig
from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    euler_from_matrix,
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_euler,
    quat_from_matrix,
    quat_multiply,
    rotation_x,
    rotation_y,
    rotation_z,
    rotvec_from_quat,
    wrap_pi,
)
from tirgeo_ros.core.gimbal.camera_pose import (
    Mount,
    YawBias,
    chain,
    from_computed,
    from_joints,
    from_reported,
    joint_angles,
)
from tirgeo_ros.core.types.measurements import JOINT_ORDERS, CameraAttitudeSample, JointSample
from tirgeo_ros.core.types.poses import BodyPose

PLAIN = Mount.from_config(GimbalConfig())
CONFIG = GimbalConfig(
    aircraft=AircraftConfig(
        gimbal_pivot_m=(0.3, -0.1, -0.4), camera_from_pivot_m=(0.1, 0.05, -0.02)
    ),
    boresight_rpy_deg=(0.4, -0.7, 1.1),
    encoder_sigma_deg=0.2,
)
FULL = Mount.from_config(CONFIG)
KNOWN = YawBias(0.0, 0.0)

headings = st.floats(-3.1, 3.1)
tilts = st.floats(-0.5, 0.5)
attitudes = st.tuples(tilts, tilts, headings)
# a gimbal's reach, kept off the pitch where Euler angles end: 1e-12 / cos(pitch) is the arithmetic
camera_attitudes = st.tuples(st.floats(-0.5, 0.5), st.floats(-1.5, 0.5), headings)


def body_at(euler, position_n=(3.0, 4.0, -20.0), covariance=None):
    covariance = np.eye(6) * 1e-4 if covariance is None else covariance
    return BodyPose(7, np.array(position_n), quat_from_euler(*euler), covariance)


def rotation_ng(pose):
    """Return the camera body's rotation, for a mount without boresight."""
    return matrix_from_quat(pose.q_nc) @ BODY_OPTICAL.T


@given(attitudes, headings, camera_attitudes, headings)
def test_reported_is_equation_12(body_euler, autopilot_yaw, camera_euler, bias):
    autopilot = quat_from_euler(0.02, -0.03, autopilot_yaw)
    reported = CameraAttitudeSample(7, quat_from_euler(*camera_euler))
    pose = from_reported(PLAIN, body_at(body_euler), autopilot, reported, YawBias(bias, 0.0))
    roll, pitch, yaw = euler_from_matrix(rotation_ng(pose))
    psi_coder = wrap_pi(camera_euler[2] - autopilot_yaw - bias)
    assert roll == pytest.approx(camera_euler[0], abs=1e-9)
    assert pitch == pytest.approx(camera_euler[1], abs=1e-9)
    assert wrap_pi(yaw - (body_euler[2] + psi_coder)) == pytest.approx(0, abs=1e-9)


@given(headings, headings, headings, tilts)
def test_looking_straight_down_only_the_heading_turns(body_yaw, autopilot_yaw, camera_yaw, roll):
    body = body_at((0.01, 0.02, body_yaw))
    autopilot = quat_from_euler(0.01, 0.02, autopilot_yaw)
    result = []
    for pitch in (-np.pi / 2, -np.pi / 2 + 1e-6):
        reported = quat_from_euler(roll, pitch, camera_yaw)
        sample = CameraAttitudeSample(7, reported)
        pose = from_reported(PLAIN, body, autopilot, sample, KNOWN)
        turned = rotation_z(body_yaw - autopilot_yaw) @ matrix_from_quat(reported)
        np.testing.assert_allclose(rotation_ng(pose), turned, atol=1e-9)
        assert np.linalg.eigvalsh(pose.covariance)[0] > -1e-15
        result.append(pose)
    # continuous there: a pitch of 1e-6 moves the axes by as much and the covariance's axes too
    np.testing.assert_allclose(rotation_ng(result[0]), rotation_ng(result[1]), atol=1.1e-6)


@given(attitudes, camera_attitudes)
def test_joints_are_the_whole_chain(body_euler, angles):
    roll, pitch, yaw = angles
    pose = from_joints(PLAIN, body_at(body_euler), JointSample(7, yaw, roll, pitch))
    chain = rotation_z(yaw) @ rotation_x(roll) @ rotation_y(pitch)
    expected = matrix_from_quat(quat_from_euler(*body_euler)) @ chain
    np.testing.assert_allclose(rotation_ng(pose), expected, atol=1e-12)


def test_boresight_turns_about_camera_axes():
    mount = Mount.from_config(GimbalConfig(boresight_rpy_deg=(0.0, 0.0, -2.0)))  # FLU: right
    down = from_joints(mount, body_at((0.0, 0.0, 0.0)), JointSample(7, 0.0, 0.0, -np.pi / 2))
    up_in_picture_n = -matrix_from_quat(down.q_nc)[:, 1]
    forward_n = matrix_from_quat(down.q_nc)[:, 2]
    angle = np.radians(2.0)
    np.testing.assert_allclose(forward_n, [0, np.sin(angle), np.cos(angle)], atol=1e-12)
    np.testing.assert_allclose(up_in_picture_n, [1, 0, 0], atol=1e-12)


def turned(body, error):
    """Return the body pose with a position error (m) and phi_n (rad), (6,), added."""
    q = quat_from_matrix(matrix_from_rotvec(error[3:]) @ matrix_from_quat(body.q_nb))
    return dataclasses.replace(body, position_n=body.position_n + error[:3], q_nb=q)


def pose_error(pose, reference):
    """(6,) position error and phi_n that take ``reference`` to ``pose``."""
    turn = matrix_from_quat(pose.q_nc) @ matrix_from_quat(reference.q_nc).T
    phi_n = rotvec_from_quat(quat_from_matrix(turn))
    return np.concatenate([pose.position_n - reference.position_n, phi_n])


def covariance_by_differences(compose, body, variances):
    """J S J^T with J by central differences of the whole composition."""
    count = 6 + len(variances)
    zero = compose(body, np.zeros(len(variances)))
    columns = []
    for k in range(count):
        step = np.zeros(count)
        step[k] = 1e-5
        ends = [compose(turned(body, sign * step[:6]), sign * step[6:]) for sign in (1, -1)]
        columns.append((pose_error(ends[0], zero) - pose_error(ends[1], zero)) / 2e-5)
    jacobian = np.array(columns).T
    spread = np.zeros((count, count))
    spread[:6, :6], spread[6:, 6:] = body.covariance, np.diag(variances)
    return jacobian @ spread @ jacobian.T


NORTH_VARIANCE = np.radians(2.0) ** 2


def computed(autopilot_q_nb, camera_euler):
    """Return joints computed from the two attitudes that the flight controller reports."""
    rotation_bg = matrix_from_quat(autopilot_q_nb).T @ matrix_from_quat(
        quat_from_euler(*camera_euler)
    )
    return JointSample(7, *joint_angles(rotation_bg).tolist(), computed=True)


@given(attitudes, camera_attitudes, headings, headings)
def test_computed_joints_are_equation_12_where_the_tilts_agree(euler, camera, heading, bias):
    """Whatever the two headings and the gimbal's north are."""
    autopilot = quat_from_euler(*euler)
    body = body_at((euler[0], euler[1], heading))
    north = YawBias(bias, NORTH_VARIANCE)
    pose = from_computed(FULL, body, computed(autopilot, camera), north)
    reported = CameraAttitudeSample(7, quat_from_euler(*camera))
    expected = from_reported(FULL, body, autopilot, reported, north)
    # some tens of roundings, and over the cosine of the chain's roll
    np.testing.assert_allclose(pose.position_n, expected.position_n, atol=1e-12)
    np.testing.assert_allclose(
        matrix_from_quat(pose.q_nc), matrix_from_quat(expected.q_nc), atol=1e-12
    )


def by_joints(euler, camera):
    def compose(at, error):
        roll, pitch, yaw = camera
        return from_joints(FULL, at, JointSample(7, *(np.array([yaw, roll, pitch]) + error)))

    return compose, FULL.joint_variance


def erring(camera, error):
    """Euler angles with errors of roll, pitch, and the tilt aside as far as it looks down."""
    roll, pitch, yaw = camera + np.append(error[:2], 0.0)
    aside = np.array([np.cos(camera[2]), np.sin(camera[2]), 0.0]) * -np.sin(camera[1]) * error[2]
    turned = matrix_from_rotvec(aside) @ matrix_from_quat(quat_from_euler(roll, pitch, yaw))
    return euler_from_matrix(turned)


def by_reported(euler, camera):
    def compose(at, error):
        reported = CameraAttitudeSample(7, quat_from_euler(*erring(camera, error)))
        north = YawBias(0.05 - error[3], NORTH_VARIANCE)
        return from_reported(FULL, at, quat_from_euler(0.0, 0.0, euler[2]), reported, north)

    return compose, np.append(FULL.reported_variance, NORTH_VARIANCE)


def by_computed(euler, camera):
    """The autopilot's tilt equals the body's, so the camera's tilt is the reported one."""

    def compose(at, error):
        tilted = quat_multiply(quat_from_euler(*error[3:5], 0.0), quat_from_euler(*euler))
        joints = computed(tilted, erring(camera, error))
        return from_computed(FULL, at, joints, YawBias(0.05 - error[5], NORTH_VARIANCE))

    tilt = FULL.tilt_variance
    return compose, np.append(FULL.reported_variance, (tilt, tilt, NORTH_VARIANCE))


@pytest.mark.parametrize("composed", [by_joints, by_reported, by_computed])
@settings(max_examples=20)  # each composes some twenty times
@given(attitudes, st.tuples(tilts, st.floats(-1.4, 0.5), headings), headings, st.integers(0, 1000))
def test_covariance_against_differences(composed, euler, camera, heading, seed):
    root = np.random.default_rng(seed).normal(size=(6, 6)) * 1e-2
    body = body_at((*euler[:2], heading), covariance=root @ root.T)
    compose, variances = composed(euler, np.array(camera))
    expected = covariance_by_differences(compose, body, variances)
    result = compose(body, np.zeros(len(variances))).covariance
    # step 1e-5: truncation 1e-10, rounding 1e-11, on covariances of order 1e-3, arms below 1 m
    np.testing.assert_allclose(result, expected, atol=1e-9)
    np.testing.assert_array_equal(result, result.T)


@pytest.mark.parametrize("pitch_deg", [0, -30, -60, -89.99, -90])
def test_the_tilt_aside_is_as_uncertain_at_any_pitch(pitch_deg):
    """Also straight down, where Euler roll is a turn about the vertical."""
    reported = CameraAttitudeSample(7, quat_from_euler(0.0, np.radians(pitch_deg), 0.0))
    level = quat_from_euler(0.0, 0.0, 0.0)
    pose = from_reported(PLAIN, body_at((0.0, 0.0, 0.0)), level, reported, KNOWN)
    # the camera looks north: its tilt aside is phi about north, and has no other error
    assert pose.covariance[3, 3] == pytest.approx(PLAIN.reported_variance[0], rel=1e-6)


def test_nose_straight_up_has_no_heading():
    reported = CameraAttitudeSample(7, quat_from_euler(0.0, -0.5, 0.4))
    up, level = quat_from_euler(0.0, np.pi / 2, 0.0), quat_from_euler(0.0, 0.0, 0.0)
    upright = dataclasses.replace(body_at((0.0, 0.0, 0.0)), q_nb=up)
    assert from_reported(PLAIN, upright, level, reported, KNOWN) is None
    assert from_reported(PLAIN, body_at((0.0, 0.0, 0.0)), up, reported, KNOWN) is None


ROUNDING = 1e-12
TURNS = {"yaw": rotation_z, "roll": rotation_x, "pitch": rotation_y}

angles = st.floats(-math.pi, math.pi)
orders = st.sampled_from(JOINT_ORDERS)


def body_from_gimbal(order, **by_name):
    """R_bg by the matrices of the three turns."""
    first, middle, last = (TURNS[name](by_name[name]) for name in order.split("-"))
    return first @ middle @ last


def by_name(order, first, middle, last):
    return dict(zip(order.split("-"), (first, middle, last), strict=True))


@given(orders, angles, st.floats(-math.pi / 2, math.pi / 2), angles)
def test_joint_angles_give_the_matrix_anywhere(order, first, middle, last):
    matrix = body_from_gimbal(order, **by_name(order, first, middle, last))
    text = dict(zip(TURNS, joint_angles(matrix, order), strict=True))
    np.testing.assert_allclose(body_from_gimbal(order, **text), matrix, atol=ROUNDING)
    assert abs(text[order.split("-")[1]]) <= math.pi / 2


@given(orders, angles, angles, angles)
def test_the_axes_are_what_small_turns_of_the_joints_turn_about(order, yaw, roll, pitch):
    at = np.array([yaw, roll, pitch])
    q_bg, axes_b = chain(JointSample(0, *at.tolist()), order)
    rotation = matrix_from_quat(np.array(q_bg))
    for joint, axis_b in enumerate(axes_b.T):
        moved = at + 1e-6 * np.eye(3)[joint]
        more = chain(JointSample(0, *moved.tolist()), order)[0]
        expected = matrix_from_rotvec(1e-6 * axis_b) @ rotation
        # a turn about one axis is exact; 1e-16 of rounding beside 1e-6
        np.testing.assert_allclose(matrix_from_quat(np.array(more)), expected, atol=ROUNDING)
