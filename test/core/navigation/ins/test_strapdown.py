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
"""The mechanisation against motions whose closed form is known, and the order of its errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from motions import ZERO, angle_between, state_at, steady_readings

from tirgeo_ros.core.frames import rotations as att
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import EARTH_RATE_RAD_S, gravity_down, radii_of_curvature
from tirgeo_ros.core.navigation.ins import strapdown
from tirgeo_ros.core.navigation.ins.strapdown import propagate

STEP_S = 0.01

vectors = st.lists(st.floats(-2, 2), min_size=3, max_size=3)
angles = st.floats(-math.pi, math.pi)


def run(state, force_b, rate_b, seconds, step_s=STEP_S):
    for _ in range(round(seconds / step_s)):
        state, _ = propagate(state, force_b, rate_b, step_s)
    return state


# Small parts


@given(vectors, vectors)
def test_scalar_rotations_are_those_of_the_attitude_module(a, b):
    p, expected = strapdown.quaternion_of(*a), att.matrix_from_rotvec(np.array(a))
    np.testing.assert_allclose(p, att.quat_from_rotvec(np.array(a)), atol=1e-15)
    turned = strapdown.rotate(rotation_of(p), tuple(b))
    np.testing.assert_allclose(turned, expected @ b, atol=4e-15)
    np.testing.assert_allclose(strapdown.cross(tuple(a), tuple(b)), np.cross(a, b), atol=4e-15)


# Motions that keep their state


@given(st.floats(-1.5, 1.5), angles, st.floats(-400, 9000), angles, st.floats(-1.5, 1.5), angles)
def test_at_rest_on_the_turning_earth_nothing_moves(lat, lon, height, roll, pitch, yaw):
    start = state_at(lat, lon, height, euler=(roll, pitch, yaw))
    end = run(start, *steady_readings(start), seconds=2.0)
    # Half a step's turn of the earth, once in the body and once in n, leaves its square over g.
    left = (0.5 * EARTH_RATE_RAD_S * STEP_S) ** 2 * 9.8 * 2.0  # 2.6e-12 m/s
    rounding = 200 * STEP_S * 1e-14
    assert np.abs(end.velocity_n).max() < 1.01 * left + rounding
    assert angle_between(start.q_nb, end.q_nb) < 200 * 1e-15
    assert (end.latitude_rad - lat) * 6.4e6 == pytest.approx(0, abs=2e-9)
    assert math.remainder(end.longitude_rad - lon, 2 * math.pi) == pytest.approx(0, abs=1e-14)
    assert end.height_m == pytest.approx(height, abs=1e-9)


@pytest.mark.parametrize("east", [-250.0, 3.0, 250.0])
@pytest.mark.parametrize("lat", [-1.2, 0.0, 0.7])
@pytest.mark.parametrize("lon", [2.0, math.pi - 1e-5, -math.pi + 1e-5])
def test_flight_along_a_parallel(east, lat, lon):
    """Constant velocity east: latitude and height stay, longitude grows by v / ((N + h) cos)."""
    start = state_at(lat, lon, 500.0, (0.0, east, 0.0), (0.1, -0.05, math.pi / 2))
    end = run(start, *steady_readings(start), seconds=20.0)
    _, transverse = radii_of_curvature(lat)
    expected = lon + east * 20 / ((transverse + 500) * math.cos(lat))
    # 2000 steps, each rounded by 2e-16 of pi the same way, are 4.4e-13 rad: 3e-6 m.
    np.testing.assert_allclose(end.velocity_n, start.velocity_n, rtol=0, atol=1e-10)
    aside_rad = math.remainder(end.longitude_rad - expected, 2 * math.pi)
    assert aside_rad == pytest.approx(0, abs=4.5e-13)
    assert -math.pi <= end.longitude_rad <= math.pi
    assert end.latitude_rad == pytest.approx(lat, abs=4.5e-13)
    assert end.height_m == pytest.approx(500, abs=1e-8)
    assert angle_between(start.q_nb, end.q_nb) < 1e-11


# Free fall


def test_free_fall_and_its_eastward_deflection():
    """Height g t^2 / 2; east omega g t^3 cos(lat) / 3, the classic deflection."""
    start, seconds = state_at(0.7, 2.0, 500.0), 4.0
    end = run(start, ZERO, ZERO, seconds, step_s=0.001)
    gravity = gravity_down(0.7, 500.0)
    # Gravity grows by 3.1e-6 /s2 times 78 m, seen twice: 2.5e-5 of 78 m; Coriolis less.
    assert 500 - end.height_m == pytest.approx(gravity * seconds**2 / 2, rel=1e-5)
    assert end.velocity_n[2] == pytest.approx(gravity * seconds, rel=1e-5)
    place = TangentPlane(0.7, 2.0, 500.0).ned_from_geodetic(
        end.latitude_rad, end.longitude_rad, end.height_m
    )
    east = EARTH_RATE_RAD_S * gravity * seconds**3 * math.cos(0.7) / 3
    # Coriolis is taken at the start of a step: 1.5 steps of 4000 late, and half for rounding.
    assert place[1] == pytest.approx(east, rel=5e-4)
    assert abs(place[0]) < 1e-5  # second order in omega t: (3e-4)^2 of 78 m


@given(vectors, vectors)
def test_attitude_of_a_constant_rate_is_its_exponential(rate_b, gyro_bias):
    """In one long step or in a hundred; the turn of the frame is added to the rate."""
    start = state_at(0.7, 2.0, 30.0, euler=(0.3, -0.2, 0.1))
    start = start._replace(gyro_bias_b=tuple(gyro_bias))
    read = tuple((np.array(rate_b) + gyro_bias).tolist())
    q = start.q_nb
    for _ in range(100):
        start, _ = propagate(start._replace(velocity_n=ZERO), ZERO, read, STEP_S)
    expected = att.quat_multiply(np.array(q), att.quat_from_rotvec(np.array(rate_b)))
    # The earth turns n by 7.3e-5 rad in this second, and nothing else does.
    assert angle_between(expected, start.q_nb) == pytest.approx(EARTH_RATE_RAD_S, rel=1e-6)


# Turns


RATE, LAT, SPEED = 0.5, 0.7, 10.0


def circling(t):
    """The truth on a level circle, the nose along the velocity, on the turning, round earth.

    Over 40 m the radii of curvature are constant to 1e-7.
    """
    yaw, radius = RATE * t, SPEED / RATE
    meridian, transverse = radii_of_curvature(LAT)
    lat = LAT + radius * math.sin(yaw) / (meridian + 50.0)
    lon = 2.0 + radius * (1 - math.cos(yaw)) / ((transverse + 50.0) * math.cos(lat))
    velocity = (SPEED * math.cos(yaw), SPEED * math.sin(yaw), 0.0)
    return state_at(lat, lon, 50.0, velocity, (0.0, 0.0, yaw))


def circled(seconds, step_s):
    """The end of the circle by the mechanisation."""
    state = circling(0.0)
    for k in range(round(seconds / step_s)):
        # As in steady flight, with the turn and its acceleration to the right.
        force_b, rate_b = map(np.array, steady_readings(circling((k + 0.5) * step_s)))
        force_b[1] += RATE * SPEED
        rate_b[2] += RATE
        state, _ = propagate(state, tuple(force_b.tolist()), tuple(rate_b.tolist()), step_s)
    return state


def test_circle_is_flown_as_its_closed_form():
    end, truth = circled(2 * math.pi / 0.5, math.pi / 250), circling(0.0)
    turn = 0.5 * math.pi / 250
    # The force at the middle of a step, linear in the turn, is too large by an eighth of the
    # turn's square, and the mean over the step is smaller by a twenty-fourth. An acceleration
    # too large by a sixth leaves no velocity after a circle but moves it against the first way.
    moved = 10 * 4 * math.pi * turn**2 / 6  # 0.8 mm
    # The Coriolis force, taken at the start of a step, adds 1.5e-4 x 6.3 ms to 6.6e-6.
    share = 0.15
    assert np.linalg.norm(np.subtract(end.velocity_n, truth.velocity_n)) < 10 * turn**2 / 6 * share
    # On the round earth the way does not close: parallels are shorter in its northern half, by
    # its area times tan(latitude) over the radius.
    open_m = math.pi * 20**2 * math.tan(0.7) / 6.4e6
    error = TangentPlane(*truth[2:5]).ned_from_geodetic(*end[2:5])
    np.testing.assert_allclose(error, [-moved, open_m, 0], atol=share * moved)
    assert angle_between(truth.q_nb, end.q_nb) < 1e-8


def test_error_falls_with_the_square_of_the_step():
    """Half the step, a quarter of the error: in velocity, and in position."""
    truth, errors = circling(4.0), []
    for step_s in (0.2, 0.1, 0.05):
        end = circled(4.0, step_s)
        velocity = np.linalg.norm(np.subtract(end.velocity_n, truth.velocity_n))
        place = np.subtract(end[2:4], truth[2:4]) * [1, math.cos(0.7)]
        errors.append([velocity, np.linalg.norm(place)])
    ratios = np.array(errors[:-1]) / errors[1:]
    # The Coriolis force, taken at the start of a step, is of first order: at 0.05 s it is
    # 1.5e-4 x 5 m/s2 x 0.025 s against 5 m/s2 x 0.025^2 / 6, which is 4 %.
    np.testing.assert_allclose(ratios, 4.0, rtol=0.04)
