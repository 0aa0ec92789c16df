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
"""The solution at an RTK antenna whose position nobody measured: partials, and flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filter_states import estimate_of, state_of
from flights import errors, navigation_samples, rms

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.ins.error_states import ANTENNA, GYRO_BIAS, feedback, states_of
from tirgeo_ros.core.navigation.timeline.ekf import at_antenna
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

STATES = ANTENNA.stop
RATE_B = np.array([0.4, -0.7, 1.1])
PLACE_B = (0.12, -0.2, -0.45)
STATE = state_of(0.3, -0.2, 2.0)
UP_M = 0.3
MOUNTED = {
    "aircraft.rtk_antenna_m": (0.0, 0.0, 0.25),
    "aircraft.rtk_antenna_sigma_m": (0.0, 0.0, 0.1),
}


def antennas_solution(error, covariance=None):
    """The solution of an estimate that is off by ``error`` (n,), with this covariance."""
    state = feedback(STATE, error)
    estimate = estimate_of(state, STATES, covariance)
    receivers = estimate.aids.receivers._replace(antenna_b=PLACE_B).changed(error)
    estimate = estimate._replace(aids=estimate.aids._replace(receivers=receivers))
    imu = NavSolution(
        0,
        state.latitude_rad,
        state.longitude_rad,
        state.height_m,
        np.array(state.velocity_n),
        np.array(state.q_nb),
        RATE_B - error[GYRO_BIAS],
        (0.0, 0.0, 0.0),
        np.zeros((9, 9)),
    )
    return at_antenna(imu, estimate.covariance, estimate.aids.receivers)


def apart(a, b):
    """(9,) position NED m, attitude, velocity of solution ``a`` less those of ``b``."""
    plane = TangentPlane(b.latitude_rad, b.longitude_rad, b.height_m)
    place_n = plane.ned_from_geodetic(a.latitude_rad, a.longitude_rad, a.height_m)
    turned = rotvec_from_quat(quat_multiply(a.q_nb, quat_conjugate(b.q_nb)))
    return np.concatenate([place_n, turned, a.velocity_n - b.velocity_n])


def test_position_and_velocity_are_those_of_the_antenna():
    """``p + R l`` and ``v + R (w x l)``."""
    result = antennas_solution(np.zeros(STATES))
    plane = TangentPlane(STATE.latitude_rad, STATE.longitude_rad, STATE.height_m)
    rotation_nb = matrix_from_quat(np.array(STATE.q_nb))
    place_n = plane.ned_from_geodetic(result.latitude_rad, result.longitude_rad, result.height_m)
    # Half a metre on an ellipsoid of 6.4e6: the plane's curvature is 1e-8 m.
    assert place_n == pytest.approx(rotation_nb @ PLACE_B, abs=1e-6)
    swing_n = rotation_nb @ np.cross(RATE_B, PLACE_B)
    assert result.velocity_n == pytest.approx(STATE.velocity_n + swing_n, abs=1e-12)
    assert result.q_nb == pytest.approx(STATE.q_nb)
    assert result.angular_rate_b == pytest.approx(RATE_B)


@pytest.mark.parametrize("seed", range(5))
def test_the_covariance_is_that_of_the_differences(seed):
    """An estimate off along one direction alone: the covariance is the outer product of what that
    direction changes, by central differences."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=STATES)
    step = 1e-5  # its cube is below the rounding of 1
    ahead, behind = (antennas_solution(sign * step * direction) for sign in (1, -1))
    changed = apart(ahead, behind) / (2 * step)
    result = antennas_solution(np.zeros(STATES), np.outer(direction, direction)).covariance
    # Rounding of 1 cm in places of 6e6 m counted in rad: 1e-9 m over 2e-5.
    assert result == pytest.approx(np.outer(changed, changed), abs=1e-3)


def flown_with(shape, config):
    """A flight of 60 s with the antenna above the IMU; the solutions, and the last estimate."""
    places = {"rtk.lever_arm_m": (0.0, 0.0, UP_M), "rtk.second_antenna_m": (1.0, 0.0, UP_M)}
    flight = fly(scenario_from({"duration_s": 60.0, "route.shape": shape, **places}), 2)
    navigation = Navigation(config)
    steps = [navigation.process(sample) for sample in navigation_samples(flight)]
    published = [step.solution for step in steps if step.solution is not None]
    return flight, published, navigation._ekf.estimate()


def with_truth_of_antenna(flight):
    """The flight with the antenna's place and velocity for its truth."""
    truth, lever_b = flight.truth, np.array([0.0, 0.0, -UP_M])
    rotation_nb = np.array([matrix_from_quat(q) for q in truth.q_nb])
    lever_n = rotation_nb @ lever_b
    meridian, transverse = np.array([radii_of_curvature(lat) for lat in truth.latitude_rad]).T
    east_m = (transverse + truth.height_m) * np.cos(truth.latitude_rad)
    swing_b = np.cross(truth.angular_rate_b, lever_b)
    moved = replace(
        truth,
        latitude_rad=truth.latitude_rad + lever_n[:, 0] / (meridian + truth.height_m),
        longitude_rad=truth.longitude_rad + lever_n[:, 1] / east_m,
        height_m=truth.height_m - lever_n[:, 2],
        velocity_n=truth.velocity_n + np.einsum("nij,nj->ni", rotation_nb, swing_b),
    )
    return replace(flight, truth=moved)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["lawnmower", "hover", "figure_eight"])
def test_an_antenna_that_nobody_measured_is_where_base_link_begins(shape):
    """Default parameters, the antenna 0.3 m above the IMU."""
    flight, published, estimate = flown_with(shape, EkfConfig())
    late = errors(with_truth_of_antenna(flight), published).after(20.0)
    # RTK's own noise is 1, 1, 2 cm: the published place is better than one fix.
    assert (rms(late.state[:, :3]) < [0.01, 0.01, 0.02]).all()
    # Errors last for seconds, so that 40 s hold some ten of them: chi square of 10 over 10 lies
    # within 0.1 and 3.0 but for 0.1 %, its root within 0.3 and 1.75.
    ratio = rms(late.state / late.sigma)
    assert ratio.max() < 1.75
    assert ratio.min() > 0.3
    # Of the IMU it is off by the height: what is tested is the antenna's.
    of_imu = errors(flight, published).after(20.0)
    assert np.mean(of_imu.state[:, 2]) == pytest.approx(UP_M, abs=0.05)
    place_b = np.array(estimate.aids.receivers.antenna_b)
    sigma_m = np.sqrt(estimate.covariance.diagonal()[ANTENNA])
    assert abs(place_b[2] + UP_M) < 3 * sigma_m[2]
    assert 0 < sigma_m[2] < 0.03  # of 0.3 at the start: a tilt of 5 deg moves it by 2.6 cm
    assert not place_b[:2].any()  # forward and left are taken as they are


@pytest.mark.parametrize(
    ("values", "states"),
    [
        ({}, ANTENNA.stop),
        ({"aircraft.rtk_antenna_m": (0.0, 0.0, 0.3)}, ANTENNA.start),
        ({"aircraft.rtk_antenna_sigma_m": (0.0, 0.0, 0.0)}, ANTENNA.start),
        ({"aircraft.imu_m": (0.0, 0.0, -0.3)}, ANTENNA.start),  # measured from the antenna
        (MOUNTED, ANTENNA.stop),
    ],
)
def test_the_parameters_say_whether_the_place_is_estimated(values, states):
    assert states_of(config_from(EkfConfig, values)) == states


def test_a_place_that_is_estimated_from_a_measured_one_leaves_base_link_at_the_imu():
    flight, published, estimate = flown_with("figure_eight", config_from(EkfConfig, MOUNTED))
    late = errors(flight, published).after(20.0)
    sigma_m = float(np.sqrt(estimate.covariance[-1, -1]))
    # Five centimetres to find; down and the height found are one error.
    assert rms(late.state[:, :2]).max() < 0.01
    assert abs(estimate.aids.receivers.antenna_b[2] + 0.05) < 3 * sigma_m
    assert abs(np.mean(late.state[:, 2])) < 3 * sigma_m + 0.01
