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
"""Samples of IMU and gimbal: attitude, joints, streams, order, unit, refused readings."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from aircraft_readings import KIT, MS, START, attitude, gimbal, imu, of, t_ms, taken, wxyz
from hypothesis import assume, given, settings, strategies as st

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.frames.rotations import (
    euler_from_quat,
    matrix_from_quat,
    quat_from_euler,
    quat_from_rotvec,
    quat_multiply,
    rotation_x,
    rotation_y,
    rotation_z,
    wrap_pi,
)
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample
from tirgeo_ros.dji.interpret.imu_samples import G_M_S2
from tirgeo_ros.dji.interpret.interpreter import Interpreter
from tirgeo_ros.dji.sources.readings import AccelerationUnit, ImuOrigin

NAN, INF = math.nan, math.inf
HARD, SENT, CAST = ImuOrigin.HARD_SYNC, ImuOrigin.SUBSCRIPTION, ImuOrigin.BROADCAST


def interpreter(**config):
    return Interpreter(DjiConfig(geoid_undulation_m=40.0, aircraft=KIT, **config))


def test_a_reading_becomes_a_sample_in_si():
    interp = interpreter()
    (sample,) = interp.take(
        imu(5, (0.1, -0.2, -0.9), q_nb=wxyz(0.1, -0.2, 2.0), rate=(0.01, -0.02, 0.03))
    )
    assert sample.stamp_ns == START + 5 * MS
    np.testing.assert_allclose(
        sample.specific_force_b, [0.1 * 9.80665, -0.2 * 9.80665, -0.9 * 9.80665], rtol=1e-15
    )
    np.testing.assert_array_equal(sample.angular_rate_b, [0.01, -0.02, 0.03])
    np.testing.assert_allclose(sample.autopilot_q_nb, quat_from_euler(0.1, -0.2, 2.0), atol=1e-15)
    assert interp.counts == {}
    assert interp.warnings == []
    assert interp.diagnostics["imu_source"] == "broadcast"
    assert interp.diagnostics["acceleration_unit"] == "g (stated)"


@pytest.mark.parametrize(
    "q_nb",
    [
        (0.0, 0.0, 0.0, 0.0),
        (NAN, NAN, NAN, NAN),
        (1.0, 0.0, NAN, 0.0),
        (INF, 0.0, 0.0, 0.0),
        (1.02, 0.0, 0.0, 0.0),
        (0.7, 0.0, 0.0, 0.7),
        (1e200, 1e200, 0.0, 0.0),
    ],
)
def test_an_invalid_attitude_is_left_out(q_nb):
    interp = interpreter()
    (sample,) = interp.take(imu(0, q_nb=q_nb))
    assert sample.autopilot_q_nb is None
    assert interp.counts == {"attitude_not_unit": 1, "imu_without_attitude": 1}


def test_attitude_of_another_message_is_propagated_by_the_rate():
    """So an attitude that is 20 ms old has no error from 20 ms of turning."""
    interp = interpreter()
    rate = (0.3, -0.2, 2.0)
    q0 = quat_from_euler(0.05, -0.1, 1.0)
    interp.take(attitude(100, tuple(q0.tolist())))
    for after_ms in (0, 20, 50):
        (sample,) = interp.take(imu(100 + after_ms, q_nb=None, rate=rate))
        expected = quat_multiply(q0, quat_from_rotvec(np.array(rate) * after_ms * 1e-3))
        # Both are exact for a constant rate.
        np.testing.assert_allclose(sample.autopilot_q_nb, expected, atol=1e-15)
    assert interp.counts == {"imu_attitude_carried": 3}


@pytest.mark.parametrize("bad", [NAN, INF, -INF, 1e300])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("of_rate", [False, True])
def test_an_invalid_number_is_refused(bad, axis, of_rate):
    interp = interpreter()
    vector = [0.0, 0.0, -1.0]
    vector[axis] = bad
    parts = {"rate": tuple(vector)} if of_rate else {"acceleration": tuple(vector)}
    assert interp.take(imu(0, **parts)) == []
    assert interp.counts == {"imu_refused": 1}
    assert len(interp.take(imu(10))) == 1


def both(until_ms, hard_until_ms=1e9, hard_from_ms=0.0):
    """Return HARD_SYNC at 400 Hz and the broadcast at 100 Hz, whose stamps are 1 ms later."""
    readings = [
        imu(t, origin=HARD)
        for t in np.arange(0, until_ms, 2.5)
        if hard_from_ms <= t < hard_until_ms
    ]
    readings += [imu(t + 1, origin=CAST) for t in range(0, until_ms, 10)]
    return sorted(readings, key=lambda reading: reading.stamp_ns)


def test_a_worse_stream_is_selected_when_the_better_is_silent():
    interp = interpreter()
    samples = taken(interp, both(1000, hard_until_ms=500))
    stamps = [t_ms(s) for s in samples]
    # The last of HARD_SYNC is at 497.5; the broadcast's 601 is the first over 100 ms later.
    assert stamps == [2.5 * k for k in range(200)] + [601 + 10 * k for k in range(40)]
    assert interp.diagnostics["imu_source"] == "broadcast"
    assert interp.counts["imu_handovers"] == 1
    assert interp.counts["imu_unused_broadcast"] == 60


@given(
    st.lists(
        st.tuples(st.sampled_from([HARD, SENT, CAST]), st.integers(0, 400), st.integers(0, 600)),
        max_size=4,
    ),
    st.integers(0, 9),
)
def test_stamps_of_any_mixture_ascend(bursts, phase):
    """However streams begin and end, stamps increase and each unused reading is counted."""
    readings = [
        imu(t + phase * (origin is CAST), origin=origin)
        for origin, start, length in bursts
        for t in range(start, start + length, 10)
    ]
    readings.sort(key=lambda reading: reading.stamp_ns)
    interp = interpreter()
    samples = taken(interp, readings)
    assert all(a.stamp_ns < b.stamp_ns for a, b in itertools.pairwise(samples))
    lost = sum(
        number
        for name, number in interp.counts.items()
        if name.startswith("imu_unused") or name == "imu_out_of_order"
    )
    assert len(samples) + lost == len(readings)


def test_a_better_stream_is_selected_once_it_is_steady():
    interp = interpreter()
    samples = taken(interp, both(1000, hard_from_ms=500))
    stamps = [t_ms(s) for s in samples]
    assert stamps == sorted(set(stamps))
    # HARD_SYNC is selected after 100 ms; before that, the broadcast is used.
    assert stamps == [1 + 10 * k for k in range(60)] + [600 + 2.5 * k for k in range(160)]
    assert interp.counts["imu_handovers"] == 1


UNKNOWN = AccelerationUnit.UNKNOWN


def readings(seconds, mean, rate_hz=100.0, shake=0.0, seed=1, start_s=0.0):
    """Yield readings without a unit about a mean, with vibration of ``shake`` rms per axis."""
    rng = np.random.default_rng(seed)
    for k in range(round(seconds * rate_hz)):
        acceleration = tuple((np.array(mean) + shake * rng.standard_normal(3)).tolist())
        yield imu(1e3 * (start_s + k / rate_hz), acceleration, UNKNOWN)


def sizes(samples):
    return [float(np.linalg.norm(sample.specific_force_b)) for sample in samples]


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0, 400.0])
@pytest.mark.parametrize(("size", "unit"), [(1.0, "g"), (G_M_S2, "m/s2")])
def test_the_unit_is_found_in_half_a_second(rate_hz, size, unit):
    interp = interpreter()
    samples = taken(interp, readings(0.5, (0.0, 0.0, -size), rate_hz))
    # No sample is lost: those that waited are returned with the decision.
    assert len(samples) == 0.5 * rate_hz
    assert [t_ms(s) for s in samples] == pytest.approx(
        [1e3 * k / rate_hz for k in range(len(samples))]
    )
    np.testing.assert_allclose(sizes(samples), G_M_S2, rtol=1e-12)
    assert interp.counts == {}
    assert interp.diagnostics["acceleration_unit"].startswith(f"{unit} (by its size")


@settings(max_examples=60)
@given(
    st.sampled_from([1.0, G_M_S2]),
    st.floats(0.6, 1.6),
    st.floats(0, 1.0),
    st.floats(0, 0.6),
    st.floats(-math.pi, math.pi),
    st.integers(0, 100),
)
def test_the_unit_is_found_in_flight_with_vibration(unit, load, shake, tilt, azimuth, seed):
    """Between 0.6 and 1.6 g, at any tilt of a turn, with vibration of up to 1 g rms on each axis.

    The mean of 41 readings has 0.16 of the vibration's sigma (a hundredth more by trimming). The
    vibration is limited so that 4.5 sigma are inside the bounds, half and twice gravity.
    """
    across = load * math.sin(tilt)
    mean = (across * math.cos(azimuth), across * math.sin(azimuth), -load * math.cos(tilt))
    shake = min(shake, min(load - 0.5, 2.0 - load) / (4.5 * 0.16))
    interp = interpreter()
    samples = taken(interp, readings(0.5, unit * np.array(mean), shake=unit * shake, seed=seed))
    assert len(samples) == 50
    average = np.mean([sample.specific_force_b for sample in samples], 0)
    np.testing.assert_allclose(average, G_M_S2 * np.array(mean), atol=6 * G_M_S2 * shake / 50**0.5)


@pytest.mark.parametrize("wild", [30.0, 399.0, 1e30, 3.4e38])
def test_outliers_do_not_decide_the_unit(wild):
    interp = interpreter()
    with_outliers = list(readings(0.6, (0.0, 0.0, -1.0)))
    for k in (3, 17, 30):
        with_outliers[k] = with_outliers[k]._replace(acceleration_b=(wild, 0.0, wild))
    samples = taken(interp, with_outliers)
    assert len(samples) + interp.counts.get("imu_refused", 0) == 60
    assert interp.diagnostics["acceleration_unit"].startswith("g ")


@pytest.mark.parametrize("size", [0.0, 0.3, 3.0, 30.0])
def test_without_gravity_there_are_no_imu_samples(size):
    interp = interpreter()
    assert taken(interp, readings(3.0, (0.0, 0.0, -size))) == []
    assert interp.counts == {"imu_without_gravity": 300}
    (warning,) = interp.warnings
    assert "gravity neither in g nor in m/s2" in warning
    assert "Set raw acceleration data in DJI Assistant 2 (SDK)" in warning
    assert interp.diagnostics["acceleration_unit"].startswith("fused, without gravity")


def test_a_unit_that_is_corrected_in_flight_is_found():
    interp = interpreter()
    assert taken(interp, readings(5.0, (0.1, 0.0, 0.0))) == []
    samples = taken(interp, readings(9.0, (0.0, 0.0, -1.0), start_s=5.0))
    # Three means over 2 s; the first begins up to 2 s earlier.
    assert len(samples) > 100
    np.testing.assert_allclose(sizes(samples), G_M_S2, rtol=1e-12)
    assert interp.counts["acceleration_unit_changes"] == 1
    assert interp.warnings == []


def test_samples_that_wait_at_the_end_are_returned_in_their_unit():
    interp = interpreter()
    assert taken(interp, readings(0.1, (0.0, 0.0, -1.0))) == []
    np.testing.assert_allclose(sizes(interp.flush()), [G_M_S2] * 10, rtol=1e-12)
    assert interp.flush() == []
    assert interp.counts == {}


angles = st.floats(-math.pi, math.pi)
tilts = st.floats(-0.6, 0.6)
camera_angles = st.tuples(st.floats(-0.6, 0.6), st.floats(-math.pi / 2, 0.5), angles)


def at(interp, reading, q_nb):
    """Return the camera's and joints' samples of a reading, with the body's attitude."""
    t = (reading.stamp_ns - gimbal(0).stamp_ns) / MS
    samples = taken(interp, [imu(t - 5, q_nb=q_nb), reading, imu(t + 5, q_nb=q_nb)])
    return of(CameraAttitudeSample, samples)[0], of(JointSample, samples)[0]


def rotation_bg(joints):
    yaw = rotation_z(joints.yaw_rad)
    return yaw @ rotation_x(joints.roll_rad) @ rotation_y(joints.pitch_rad)


@given(st.tuples(tilts, tilts, angles), camera_angles)
def test_joints_are_the_whole_rotation(body, camera):
    """Also with the aircraft tilted, and the camera straight down."""
    q_nb = wxyz(*body)
    sample, joints = at(interpreter(), gimbal(100, *camera), q_nb)
    np.testing.assert_allclose(
        matrix_from_quat(sample.q_ng), matrix_from_quat(quat_from_euler(*camera)), atol=1e-14
    )
    expected = matrix_from_quat(np.array(q_nb)).T @ matrix_from_quat(quat_from_euler(*camera))
    # Some tens of roundings: a quaternion's norm, two matrices, three angles.
    np.testing.assert_allclose(rotation_bg(joints), expected, atol=1e-14)
    assert joints.computed
    assert sample.stamp_ns == joints.stamp_ns == gimbal(100).stamp_ns


@given(tilts, angles, camera_angles)
def test_yaw_from_the_nose(tilt, nose, camera):
    """As a Ronin-MX, whose yaw is the angle from the aircraft's heading."""
    roll, pitch, yaw = camera
    assume(pitch > -1.5)  # where the camera's yaw is defined
    interp = interpreter(gimbal_reference="body")
    sample, joints = at(interp, gimbal(100, roll, pitch, yaw), wxyz(tilt, -tilt, nose))
    text = euler_from_quat(sample.q_ng)
    # Over the cosine of the pitch, 0.07.
    np.testing.assert_allclose(wrap_pi(text - [roll, pitch, nose + yaw]), 0, atol=2e-13)
    expected = matrix_from_quat(np.array(wxyz(tilt, -tilt, nose))).T @ matrix_from_quat(
        sample.q_ng
    )
    np.testing.assert_allclose(rotation_bg(joints), expected, atol=1e-14)


def test_a_yaw_from_the_nose_is_dropped_without_an_attitude():
    interp = interpreter(gimbal_reference="body")
    assert taken(interp, [gimbal(20 * k) for k in range(50)]) == []
    assert interp.flush() == []
    assert interp.counts == {"gimbal_without_heading": 50}


@pytest.mark.parametrize("bad", [NAN, INF, -INF, 1e154])
@pytest.mark.parametrize("angle", ["roll", "pitch", "yaw"])
def test_an_invalid_angle_is_refused(bad, angle):
    interp = interpreter()
    assert interp.take(gimbal(0, **{angle: bad})) == []
    assert interp.flush() == []
    assert interp.counts == {"gimbal_refused": 1}


@settings(max_examples=50)
@given(angles, st.floats(-0.09, 0.09), angles, st.sampled_from([-1.0, 1.0]))
def test_near_the_singularity_the_joints_still_give_the_rotation(yaw, off, pitch, side):
    """The aircraft is on its side within 5 deg, and the camera level."""
    interp = interpreter()
    body = wxyz(side * (math.pi / 2 + off), 0.0, 0.3)
    camera, joints = at(interp, gimbal(100, 0.0, 0.0, 0.3 + 1e-3 * yaw), body)
    expected = matrix_from_quat(np.array(body)).T @ matrix_from_quat(camera.q_ng)
    np.testing.assert_allclose(rotation_bg(joints), expected, atol=1e-14)
    assert interp.counts == {"joints_near_singularity": 1}


def test_a_reading_waits_for_the_attitude_after_it():
    interp = interpreter()
    assert len(interp.take(imu(0))) == 1
    assert interp.take(gimbal(5)) == []
    samples = interp.take(attitude(8))
    assert samples == []  # beside the IMU's own attitude it is not used
    samples = interp.take(imu(10))
    assert [t_ms(s) for s in samples] == [10, 5, 5]
