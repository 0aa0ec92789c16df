"""Gimbal readings: the camera's attitude, and joints as the whole rotation from the body."""

from __future__ import annotations

import math

import numpy as np
import pytest
from aircraft_readings import MS, attitude, gimbal, imu, of, t_ms, taken, wxyz
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.core.frames.rotations import (
    euler_from_quat,
    matrix_from_quat,
    quat_from_euler,
    rotation_x,
    rotation_y,
    rotation_z,
)
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample
from tirgeo_ros.dji.interpret import Interpreter

NAN, INF = math.nan, math.inf

angles = st.floats(-math.pi, math.pi)
tilts = st.floats(-0.6, 0.6)
camera_angles = st.tuples(st.floats(-0.6, 0.6), st.floats(-math.pi / 2, 0.5), angles)


def interpreter(**config):
    return Interpreter(DjiConfig(geoid_undulation_m=40.0, **config))


def around(t, q_nb=(1.0, 0.0, 0.0, 0.0)):
    """The same attitude 5 ms before and after."""
    return [imu(t - 5, q_nb=q_nb), imu(t + 5, q_nb=q_nb)]


def at(meant, reading, q_nb):
    """The camera and the joints of a reading, where the body's attitude is this."""
    before, after = around((reading.stamp_ns - gimbal(0).stamp_ns) / MS, q_nb)
    samples = taken(meant, [before, reading, after])
    return of(CameraAttitudeSample, samples)[0], of(JointSample, samples)[0]


def rotation_bg(joints):
    yaw = rotation_z(joints.yaw_rad)
    return yaw @ rotation_x(joints.roll_rad) @ rotation_y(joints.pitch_rad)


@given(st.tuples(tilts, tilts, angles), camera_angles)
def test_joints_are_the_whole_rotation(body, camera):
    """Also with the aircraft tilted, and the camera straight down."""
    q_nb = wxyz(*body)
    given_camera, joints = at(interpreter(), gimbal(100, *camera), q_nb)
    np.testing.assert_allclose(
        matrix_from_quat(given_camera.q_ng), matrix_from_quat(quat_from_euler(*camera)), atol=1e-14
    )
    expected = matrix_from_quat(np.array(q_nb)).T @ matrix_from_quat(quat_from_euler(*camera))
    # Some tens of roundings: a quaternion's norm, two matrices, three angles.
    np.testing.assert_allclose(rotation_bg(joints), expected, atol=1e-14)
    assert joints.computed
    assert given_camera.stamp_ns == joints.stamp_ns == gimbal(100).stamp_ns


@given(tilts, angles, camera_angles)
def test_yaw_from_the_nose(tilt, nose, camera):
    """A Ronin-MX: what it says of yaw is the angle from the aircraft's heading."""
    roll, pitch, yaw = camera
    assume(pitch > -1.5)  # where the camera's yaw is defined
    meant = interpreter(gimbal_reference="body")
    given_camera, joints = at(meant, gimbal(100, roll, pitch, yaw), wxyz(tilt, -tilt, nose))
    said = euler_from_quat(given_camera.q_ng)
    # Over the cosine of the pitch, 0.07.
    np.testing.assert_allclose(wrap_pi(said - [roll, pitch, nose + yaw]), 0, atol=2e-13)
    expected = matrix_from_quat(np.array(wxyz(tilt, -tilt, nose))).T @ matrix_from_quat(
        given_camera.q_ng
    )
    np.testing.assert_allclose(rotation_bg(joints), expected, atol=1e-14)
    assert float(meant.diagnostics["psi_coder_deg"]) == pytest.approx(
        math.degrees(yaw), abs=0.0051
    )


# Waiting


def test_without_the_nose_there_is_no_heading_of_a_yaw_from_it():
    meant = interpreter(gimbal_reference="body")
    assert taken(meant, [gimbal(20 * k) for k in range(50)]) == []
    assert meant.flush() == []
    assert meant.counts == {"gimbal_without_heading": 50}


# What is odd


@pytest.mark.parametrize("bad", [NAN, INF, -INF, 1e154])
@pytest.mark.parametrize("angle", ["roll", "pitch", "yaw"])
def test_what_is_no_angle_is_refused(bad, angle):
    meant = interpreter()
    assert meant.take(gimbal(0, **{angle: bad})) == []
    assert meant.flush() == []
    assert meant.counts == {"gimbal_refused": 1}


@settings(max_examples=50)
@given(angles, st.floats(-0.09, 0.09), angles, st.sampled_from([-1.0, 1.0]))
def test_at_the_end_of_the_chain_the_three_still_give_the_rotation(yaw, off, pitch, side):
    """An aircraft on its side under a camera that is level, within 5 deg."""
    meant = interpreter()
    body = wxyz(side * (math.pi / 2 + off), 0.0, 0.3)
    camera, joints = at(meant, gimbal(100, 0.0, 0.0, 0.3 + 1e-3 * yaw), body)
    expected = matrix_from_quat(np.array(body)).T @ matrix_from_quat(camera.q_ng)
    np.testing.assert_allclose(rotation_bg(joints), expected, atol=1e-14)
    assert meant.counts == {"joints_near_singularity": 1}


def test_a_reading_waits_for_the_attitude_after_it():
    meant = interpreter()
    assert len(meant.take(imu(0))) == 1
    assert meant.take(gimbal(5)) == []
    samples = meant.take(attitude(8))
    assert samples == []  # beside the IMU's own attitude it is not used
    samples = meant.take(imu(10))
    assert [t_ms(s) for s in samples] == [10, 5, 5]
