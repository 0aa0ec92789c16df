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
"""The baselines: lever arm, velocity, ages, and the reason given when something is missing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import canonical, matrix_from_quat, quat_from_euler
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.estimator.unfiltered_solution import UnfilteredSolution
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import Outcome

SECOND_NS = 1_000_000_000
NOW_NS = 100 * SECOND_NS
PLANE = TangentPlane(0.7, 2.0, 30.0)
CONFIG = config_from(
    EkfConfig,
    {"aircraft.rtk_antenna_m": [0.3, 0.4, 0.5], "aircraft.gps_antenna_m": [-0.1, 0.2, 0.6]},
)
COVARIANCE = np.array([[4.0, 1, 0], [1, 9, 0], [0, 0, 16]])
RTK = (Source.RTK_POSITION, Source.RTK_VELOCITY)
GPS = (Source.GPS_POSITION, Source.GPS_VELOCITY)
#: Position covariance where a message has none, by receiver.
DEFAULTS = {
    RTK: CONFIG.rtk.position_sigma_floor_m**2 * np.eye(3),
    GPS: np.diag(np.square(CONFIG.gps.position_sigma_m)),
}
receivers = pytest.mark.parametrize("receiver", [RTK, GPS])
LEVEL = np.array([1.0, 0, 0, 0])
RATE_B = np.array([0.1, -0.2, 0.3])


def imu(q_nb=LEVEL):
    return ImuSample(NOW_NS, np.array([0, 0, -9.8]), RATE_B, q_nb)


def position(age_ns=0, source=RTK[0], covariance=COVARIANCE, lon=2.0):
    return PositionSample(NOW_NS - age_ns, source, FixStatus.FIXED, 0.7, lon, 30.0, covariance)


def velocity(age_ns=0, source=RTK[1], covariance=COVARIANCE, v=(3.0, -2.0, 1.0)):
    return VelocitySample(NOW_NS - age_ns, source, np.array(v), covariance)


def fed(*samples, source=RTK[0]):
    result = UnfilteredSolution(CONFIG, source)
    for sample in samples:
        result.add_imu(sample) if isinstance(sample, ImuSample) else result.add_aiding(sample)
    return result


def place_n(solution, plane=PLANE):
    place = solution.latitude_rad, solution.longitude_rad, solution.height_m
    return plane.ned_from_geodetic(*place)


@receivers
@given(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3))
def test_body_is_the_lever_arm_away_from_the_antenna(receiver, roll, pitch, yaw):
    q_nb, source = quat_from_euler(roll, pitch, yaw), receiver[0]
    lever_b = CONFIG.aircraft.antenna_b(source)
    solution = fed(imu(q_nb), position(source=source), source=source).solution()
    # Curvature over 1 m: 1e-7 m; the earth-fixed coordinates hold 1e-9 m.
    np.testing.assert_allclose(place_n(solution), -matrix_from_quat(q_nb) @ lever_b, atol=2e-7)
    np.testing.assert_array_equal(solution.q_nb, canonical(q_nb))
    np.testing.assert_array_equal(solution.angular_rate_b, RATE_B)
    assert solution.stamp_ns == NOW_NS


@pytest.mark.parametrize("age_s", [-0.05, 0.0, 0.1, 1.0])
def test_position_is_carried_to_the_imu_s_time(age_s):
    """Forwards for an old position, backwards for one measured after the newest IMU sample."""
    age_ns = round(age_s * SECOND_NS)
    solution = fed(position(age_ns), velocity(age_ns), imu()).solution()
    expected = np.array([3.0, -2.0, 1.0]) * age_s - CONFIG.aircraft.rtk_lever_b
    # Curvature over 4 m: 16 / (2 x 6.4e6) = 1.3e-6 m.
    np.testing.assert_allclose(place_n(solution), expected, atol=2e-6)
    np.testing.assert_array_equal(solution.velocity_n, [3, -2, 1])


def test_an_old_velocity_is_not_used():
    solution = fed(position(SECOND_NS // 2), velocity(SECOND_NS + 1), imu()).solution()
    np.testing.assert_array_equal(solution.velocity_n, 0)
    np.testing.assert_array_equal(solution.covariance[6:, 6:], np.eye(3))


def test_longitude_goes_on_behind_the_date_line():
    east = velocity(SECOND_NS, v=(0.0, 10.0, 0.0))
    solution = fed(position(SECOND_NS, lon=math.pi - 1e-9), east, imu()).solution()
    beyond = place_n(solution, TangentPlane(0.7, math.pi, 30.0))
    assert -math.pi <= solution.longitude_rad < 0
    # 10 m and the arm (left is -y), from 1e-9 rad before the line (5 mm); curvature 8e-6 m.
    parallel_m = 6.4e6 * math.cos(0.7)
    assert beyond[1] == pytest.approx(10 + 0.4 - 1e-9 * parallel_m, abs=5e-5)


@receivers
@pytest.mark.parametrize("reported", [COVARIANCE, 0.0 * np.eye(3), -1.0 * np.eye(3)])
def test_covariance_of_a_message_is_taken_or_has_a_default(receiver, reported):
    is_known = reported is COVARIANCE
    source, other = receiver
    samples = position(0, source, reported), velocity(0, other, reported)
    result = fed(imu(), *samples, source=source).solution().covariance
    np.testing.assert_allclose(result[:3, :3], reported if is_known else DEFAULTS[receiver])
    attitude = np.radians(CONFIG.autopilot.attitude_sigma_deg) ** 2
    np.testing.assert_allclose(np.diag(result)[3:6], attitude)
    np.testing.assert_array_equal(result[6:, 6:], reported if is_known else np.eye(3))


@pytest.mark.parametrize("q", [None, np.zeros(4), np.full(4, math.nan), np.ones(4)])
def test_a_missing_attitude_is_reported(q):
    estimator = fed(position())
    for _ in range(2):  # without an IMU sample, and with one that has no attitude
        assert estimator.reason == "imu/data has no orientation"
        assert estimator.solution() is None
        assert estimator.add_imu(imu(q)) == (Outcome.INVALID, "no orientation")
    assert estimator.add_imu(imu()) == (Outcome.USED, "")


@receivers
@pytest.mark.parametrize(("age_ns", "good"), [(SECOND_NS, True), (SECOND_NS + 1, False)])
def test_age_of_the_position(receiver, age_ns, good):
    source = receiver[0]
    for sign in (1, -1):
        estimator = fed(position(sign * age_ns, source), imu(), source=source)
        assert (estimator.solution() is not None) is good
        assert estimator.reason == ("" if good else f"no {source.topic} within 1 s")


@receivers
def test_only_the_chosen_receiver_is_used(receiver):
    estimator = UnfilteredSolution(CONFIG, receiver[0])
    samples = [position(source=s[0]) for s in (RTK, GPS)] + [velocity(source=RTK[1])]
    for sample in (*samples, velocity(source=GPS[1]), HeadingSample(NOW_NS, 0.0, 1e-4)):
        verdict = estimator.add_aiding(sample)
        expected = Outcome.USED if sample.source in receiver else Outcome.UNUSED
        assert (verdict.source, verdict.outcome) == (sample.source, expected)
