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
"""Flights without RTK start on ordinary GPS and go on, whatever accuracy it reports."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from filter_states import SECOND_NS, ZERO, estimate_of, state_of
from flights import GPS, RTK, filtered, flight, without

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.nose_heading import AutopilotHeadingAid
from tirgeo_ros.core.navigation.estimator.filter_status import MOST_GPS_SIGMAS
from tirgeo_ros.core.navigation.ins.error_states import ANTENNA
from tirgeo_ros.core.types.measurements import AutopilotHeading, ImuSample, PositionSample, Source
from tirgeo_ros.core.types.verdicts import FilterState, Outcome
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from


def poor(sigma_m=None, begin_s=1e9, end_s=1e9):
    """No RTK, and no GPS in between; ``sigma_m`` (3,) in every gps/fix, zeros if unknown."""
    silent = without(*GPS, begin_s=begin_s, end_s=end_s)

    def change(sample, t_s):
        if sample.source in RTK:
            return None
        if sigma_m is not None and isinstance(sample, PositionSample):
            sample = replace(sample, covariance_n=np.diag(np.square(sigma_m)))
        return silent(sample, t_s)

    return change


@pytest.mark.parametrize("method", ["ekf", "ekf_heading"])
@pytest.mark.parametrize(
    ("sigma_m", "said"),
    [
        (None, ""),
        (ZERO, ""),
        ((0.9, 1.3, 100.0), "; gps/fix has a sigma of 100 m in height"),  # as import has it
        ((15.0, 15.0, 30.0), "; gps/fix has a sigma of 15 m, 30 m in height"),
        ((10.0, 10.0, 1000.0), "; gps/fix has a sigma of 1000 m in height"),  # of a 2D fix
    ],
)
def test_it_starts_after_its_wait_and_stays_degraded(method, sigma_m, said):
    result, states, navigation = filtered(
        flight(44, 40.0), poor(sigma_m), watched=True, method=method
    )
    # alignment.wait_s and max_delay_s: 5.5 s
    assert {state for t_s, state in states if t_s > 5.7} == {FilterState.DEGRADED}
    heading = ", rtk/heading" if method == "ekf_heading" else ""
    assert navigation.status().reason == f"no rtk/fix, rtk/vel{heading}{said}"
    late = result.after(15.0)
    assert (np.abs(late.state / late.sigma)[:, :3] < 4.0).all()
    assert (late.sigma[:, :3] > 0.5 * np.array(EkfConfig().gps.position_sigma_m)).all()
    assert (np.abs(late.state[:, :2]) < 5.0).all()  # four of the receiver's true 1.28 m
    if sigma_m and sigma_m[2] >= 30:
        assert late.sigma[-1, 2] > 0.5 * sigma_m[2]  # a lasting error does not average out


def test_it_outlasts_a_silence_of_a_poor_receiver():
    """Five seconds on velocities alone: dead reckoning, not lost; a poor GPS is still poor."""
    change = poor((0.9, 1.3, 100.0), 20.0, 25.0)
    states = filtered(flight(44, 40.0), change, watched=True, method="ekf").states
    observed = Counter(state for _, state in states)
    assert observed[FilterState.DEAD_RECKONING] > 300
    assert FilterState.LOST not in observed
    assert states[-1][1] is FilterState.DEGRADED


def flown_with_barometer(bias_n, begin_s=-1.0, sigma_m_s=None, seed=1):
    """Errors and status without RTK, with wrong GPS velocities; ``sigma_m_s`` as reported."""
    flown = fly(scenario_from({"barometer.rate_hz": 10.0, "duration_s": 80.0}, "test"), seed)

    def change(sample, t_s):
        if sample.source is Source.GPS_VELOCITY and t_s > begin_s:
            variances = sample.covariance_n if sigma_m_s is None else sigma_m_s**2 * np.eye(3)
            velocity_n = sample.velocity_n + np.array(bias_n)
            sample = replace(sample, velocity_n=velocity_n, covariance_n=variances)
        return poor()(sample, t_s)

    result, _, navigation = filtered(flown, change, method="ekf")
    return result, navigation.status()


@pytest.mark.slow
@pytest.mark.parametrize(("begin_s", "sigma_m_s"), [(-1.0, None), (40.0, None), (-1.0, 1.44)])
@pytest.mark.parametrize("down_m_s", [0.7, -0.7])
def test_a_wrong_vertical_velocity_does_not_carry_the_height_away(down_m_s, begin_s, sigma_m_s):
    plain, _ = flown_with_barometer((0.0, 0.0, 0.0))
    result, status = flown_with_barometer((0.0, 0.0, down_m_s), begin_s, sigma_m_s)
    both = np.isin(plain.t_s, result.t_s), np.isin(result.t_s, plain.t_s)
    moved_m = result.state[both[1], 2] - plain.state[both[0], 2]
    # In the seconds that it takes to learn 0.7 m/s: 50 m without a barometer's help.
    assert np.abs(moved_m).max() < 1.0
    late = result.after(15.0)
    assert (np.abs(late.state / late.sigma)[:, :3] < 3.0).all()
    assert status.resets == {}
    assert status.gps_sigmas < MOST_GPS_SIGMAS


def test_positions_that_drift_away_from_the_barometer_are_a_contradiction():
    """Heights that run away by 0.5 m/s, and velocities that agree with them."""
    flown = fly(scenario_from({"barometer.rate_hz": 10.0, "duration_s": 60.0}, "test"), 1)

    def change(sample, t_s):
        if isinstance(sample, PositionSample):
            sample = replace(sample, height_m=sample.height_m + 0.5 * t_s)
        if sample.source is Source.GPS_VELOCITY:
            sample = replace(sample, velocity_n=sample.velocity_n - (0.0, 0.0, 0.5))
        return poor()(sample, t_s)

    status = filtered(flown, change, method="ekf").status
    assert status.gps_sigmas > MOST_GPS_SIGMAS
    (warning,) = status.warnings
    assert warning.startswith(f"gps/fix: was {status.gps_sigmas:.1f} times gps.position_sigma_m")


@pytest.mark.slow
def test_the_autopilots_heading_is_used_where_nothing_else_gives_one():
    """Hovering in still air for three minutes: poses all the time, within their sigma.

    Without a vibration of the gyroscopes a hover in still air is a rest, which keeps the heading.
    """
    calm = {"wind.gust_m_s": 0.0, "wind.mean_m_s": [0.0, 0.0], "route.hold_error_m": 0.0}
    hover = {"duration_s": 180.0, "route.hover_s": 180.0, "imu.gyro_vibration_rad_s": 0.05}
    flown = fly(scenario_from(calm | hover), 1)
    result, states, navigation = filtered(flown, poor(), watched=True, method="ekf")
    assert {state for t_s, state in states if t_s > 5.7} == {FilterState.DEGRADED}
    assert navigation.status().counts["autopilot_heading", "used"] >= 1
    late = result.after(10.0)
    sigma_deg = np.degrees(late.sigma[:, 5])
    limit_deg = 3 * EkfConfig().autopilot.attitude_sigma_deg[2]
    assert (sigma_deg < 1.1 * limit_deg).all()  # the heading is checked ten times a second
    # Three sigmas of the autopilot in the state, one in its own heading: three of both.
    assert (np.abs(np.degrees(late.rpy[:, 2])) < 3 * limit_deg).all()


# One measurement


def uncertain(heading_sigma_deg):
    sigmas = np.full(ANTENNA.start, 1e-3)
    sigmas[2] = math.radians(heading_sigma_deg)
    return estimate_of(state_of(0.0, 0.0, math.radians(30.0)), covariance=np.diag(sigmas**2))


@pytest.mark.parametrize(
    ("sigma_deg", "off_deg", "outcome"),
    [
        (5.3, 1.0, Outcome.STANDBY),  # three of its 1.7972 deg are 5.39
        (5.5, 1.0, Outcome.USED),
        (5.5, -90.0, Outcome.GATED),  # five of 5.8 deg are 29
        (9.0, 180.0, Outcome.GATED),
    ],
)
def test_it_is_used_if_more_certain_and_refused_if_it_contradicts(sigma_deg, off_deg, outcome):
    variance = math.radians(1.8) ** 2
    sample = AutopilotHeading(SECOND_NS, math.radians(30.0 + off_deg), variance)
    config = EkfConfig()
    verdict, after = Fusion(config).fuse(sample, uncertain(sigma_deg), ZERO)
    assert (verdict.source, verdict.outcome) == (Source.AUTOPILOT_HEADING, outcome)
    if outcome is Outcome.USED:
        expected = 1 / (1 / math.radians(sigma_deg) ** 2 + 1 / variance)
        assert after.covariance[2, 2] == pytest.approx(expected, rel=1e-6)


def test_the_autopilots_heading_is_taken_once_a_second():
    headings = AutopilotHeadingAid(EkfConfig())
    covariance = uncertain(6.0).covariance
    q_nb = quat_from_euler(0.1, -0.2, math.radians(-50.0))

    def imu(t_s, q=q_nb):
        return ImuSample(round(t_s * 1e9), np.zeros(3), np.zeros(3), q)

    assert headings.of_imu(imu(0.5, None), covariance) is None
    assert math.degrees(headings.of_imu(imu(1.0), covariance).heading_rad) == pytest.approx(-50)
    assert headings.of_imu(imu(1.9), covariance) is None
    assert headings.of_imu(imu(2.0), uncertain(1.0).covariance) is None
    assert headings.of_imu(imu(2.1), covariance) is not None
