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
"""Lever arm, delays, IMU tilt and headings, fitted to the IMU's motion without the filter."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from checked_flights import Arrived, changed, checked, simulated
from flights import flight

from dev.flight_errors import fitting_config
from tirgeo_ros.core.checks.inertial_checks import ImuMean
from tirgeo_ros.core.checks.lever_arm_checks import Normal, integrated, solved
from tirgeo_ros.core.checks.navigation_checks import NavigationChecks, nearest_causes
from tirgeo_ros.core.frames.rotations import flu_from_frd, matrix_from_euler, quat_from_euler
from tirgeo_ros.core.types.finding import Finding, Severity

LEVER_FLU_M = np.array((-0.10, 0.32, 0.38))  # the scenario's


@pytest.fixture(scope="module")
def flown():
    return flight(1, 60.0)


@pytest.fixture(scope="module")
def arrived(flown):
    return simulated(flown)


def misplaced(config, signs):
    """Multiply the places of both antennas by signs (3,)."""
    aircraft = config.aircraft
    both = {
        name: tuple((np.array(getattr(aircraft, name)) * signs).tolist())
        for name in ("rtk_antenna_m", "second_antenna_m")
    }
    return replace(config, aircraft=replace(aircraft, **both))


@pytest.mark.parametrize(
    ("signs", "axis"), [((1, -1, 1), "left"), ((1, 1, -1), "up"), ((-1, -1, 1), "left")]
)
def test_a_wrong_sign_of_the_antennas_place_is_named(signs, axis, flown, arrived):
    findings = checked(arrived, misplaced(fitting_config(flown), signs))
    (finding,) = (each for each in findings if each.check == "antenna_place")
    assert finding.severity is Severity.CAUTION
    assert finding.parameter == "ekf_node aircraft.rtk_antenna_m"
    assert finding.mend == f"check the sign of {axis}"


def fitted(arrived: list[Arrived], config):
    navigation = NavigationChecks(config, None)
    for sample in arrived:
        navigation.take(*sample)
    estimate = navigation._levers.fit.estimate
    assert estimate is not None
    return estimate


def test_the_place_is_found_within_its_sigmas(flown, arrived):
    estimate = fitted(arrived, fitting_config(flown))
    off = flu_from_frd(estimate.lever_b) - LEVER_FLU_M
    assert (np.abs(off) < 4 * estimate.lever_sigma_b).all()  # 3 values, 4 sigma: once in 5000
    assert (estimate.lever_sigma_b < 0.05).all()  # a third of what is reported
    assert (np.abs(estimate.delays_s) < np.maximum(4 * estimate.delay_sigmas_s, 0.01)).all()


@pytest.mark.parametrize("late_s", [-0.4, -0.1, 0.1, 0.6])
def test_late_stamps_are_found_and_the_parameter_removes_them(late_s, flown, arrived):
    late = rtk_late(arrived, late_s)
    estimate = fitted(late, fitting_config(flown))
    # The fit is linear in the delay: changes of the motion within 0.1 s remain.
    assert estimate.delays_s == pytest.approx([late_s, 0.0], abs=0.04)
    assert (np.abs(flu_from_frd(estimate.lever_b) - LEVER_FLU_M) < 0.1).all()
    # The parameter removes the delay.
    corrected = fitted(late, fitting_config(flown, rtk__delay_s=late_s))
    assert (np.abs(corrected.delays_s) < np.maximum(4 * corrected.delay_sigmas_s, 0.01)).all()


def rtk_late(arrived, late_s):
    """Delay the positions and velocities of RTK, and their stamps."""
    late_ns = round(late_s * 1e9)
    move = changed("rtk/fix rtk/vel", stamp_ns=lambda ns: ns + late_ns)
    moved = [
        move(sample)._replace(arrival_ns=sample.arrival_ns + late_ns)
        if sample.topic in {"rtk/fix", "rtk/vel"}
        else sample
        for sample in arrived
    ]
    return sorted(moved, key=lambda sample: sample.arrival_ns)


def first(arrived, seconds):
    return [each for each in arrived if each.arrival_ns - arrived[0].arrival_ns < seconds * 1e9]


@pytest.mark.parametrize("begin_s", [0.0, 13.0, 31.0])
def test_a_quarter_of_a_minute_shows_signs_and_delays(begin_s, flown, arrived):
    """Six windows of 4 s, which begin 2 s apart, need 14.5 s."""
    part = first(arrived[len(first(arrived, begin_s)) :], 15.5)
    assert checked(part, fitting_config(flown)) == []
    wrong = checked(part, misplaced(fitting_config(flown), (-1, -1, -1)))
    assert [each.check for each in wrong] == ["antenna_place"]
    delayed = checked(rtk_late(part, 0.6), fitting_config(flown))
    assert [each.check for each in delayed if each.severity] == ["rtk_fix_delay"]


def errors_in_sigmas(rng):
    """Return errors of 39 windows that share halves: 5 times the residuals, as of a tilt."""
    truth = np.array((0.1, -0.2, 0.3, 0.4, 0.0))
    halves = []
    for _ in range(40):
        rows = np.pad(rng.normal(size=(30, 4)), ((0, 0), (0, 1)))
        matrix = rows.T @ rows
        right = matrix @ truth + 5 * rows.T @ rng.normal(size=30)
        squares = right @ np.linalg.pinv(matrix) @ right + 26
        halves.append([np.array([part, 0 * part]) for part in (matrix, right, squares, 30.0)])
    windows = [
        Normal(*(a + b for a, b in zip(half, other, strict=True)))
        for half, other in pairwise(halves)
    ]
    estimate = solved(windows)
    return (estimate.lever_b - truth[:3]) / estimate.lever_sigma_b


def test_the_sigmas_of_windows_that_overlap_are_those_of_their_errors():
    rng = np.random.default_rng(3)
    off = np.array([errors_in_sigmas(rng) for _ in range(200)])
    # Bartlett's half of what neighbours share leaves 3 / 4 of the variance, and 39 / 35 are put
    # on it: 1.09 sigma. Without neighbours it is 1.34, from residuals alone 5.
    assert np.sqrt(np.mean(off**2)) == pytest.approx(1.09, abs=0.12)


def test_a_flight_without_turns_or_tilts_says_nothing():
    still = ImuMean(0, 0.05, np.array((0.0, 0.0, -9.81)), np.zeros(3), None, True)
    path = integrated([still] * 80, quat_from_euler(0, 0, 0), np.zeros(3))
    times_s = np.arange(0.2, 3.9, 0.2)
    fixes = np.random.default_rng(1).normal(0, 0.01, (len(times_s), 3))
    estimate = solved([Normal.of(path, (times_s, fixes), (times_s, fixes))] * 6)
    assert estimate is not None
    assert (estimate.lever_sigma_b > 5).all()  # the prior: 10 m


IMU_RPY = "ekf_node aircraft.imu_rpy_deg"
#: The autopilot's own tilt error, 0.3 deg rms on each axis over a flight, and its noise.
OFF_DEG = 0.8


def mounted(*rpy_deg):
    """Turn the IMU in its mount by roll, pitch, yaw about forward, left, up."""
    to_imu = matrix_from_euler(*np.radians(flu_from_frd(np.array(rpy_deg)))).T
    return changed(
        "imu/data", specific_force_b=lambda f: to_imu @ f, angular_rate_b=lambda w: to_imu @ w
    )


BARE = changed("imu/data", autopilot_q_nb=lambda _: None)


def worse(findings):
    return [each for each in findings if each.severity is not Severity.NOTE]


def angles(finding):
    return [float(text) for text in re.search(r"\[(.*)\]", finding.mend)[1].split(",")]


@pytest.mark.parametrize("rpy_deg", [(5, 0, 0), (0, -5, 0), (0, 10, 0), (-20, 0, 0), (7, 7, 0)])
def test_a_tilted_imu_is_named_alone_and_with_its_angles(rpy_deg, flown, arrived):
    (tilt,) = worse(checked(arrived, fitting_config(flown), mounted(*rpy_deg)))
    assert (tilt.check, tilt.severity, tilt.parameter) == ("imu_tilt", Severity.STOP, IMU_RPY)
    assert angles(tilt) == pytest.approx(rpy_deg, abs=OFF_DEG)


def test_a_tilt_is_added_to_the_configured_angles(flown, arrived):
    config = fitting_config(flown)
    set_to = replace(config, aircraft=replace(config.aircraft, imu_rpy_deg=(0.0, 0.0, 90.0)))
    assert worse(checked(arrived, set_to, mounted(0, 0, 90))) == []
    (finding,) = worse(checked(arrived, set_to, mounted(6, 0, 90)))
    assert angles(finding) == pytest.approx((6, 0, 90), abs=OFF_DEG)


def test_an_autopilot_that_errs_as_much_as_real_ones_is_no_fault(flown, arrived):
    """Twelve recorded flights differ by up to 2.2 deg."""
    assert worse(checked(arrived, fitting_config(flown), mounted(1.6, -1.4, 0))) == []


def test_without_the_autopilots_attitude_the_tilt_is_not_known(flown, arrived):
    (tilt,) = checked(arrived, fitting_config(flown), BARE, mounted(0, 10, 0))
    assert (tilt.check, tilt.severity, tilt.parameter) == ("imu_tilt", Severity.NOTE, IMU_RPY)
    assert "not known" in tilt.evidence


@pytest.mark.parametrize("off_deg", [4, -4, 7])
def test_headings_that_are_off_are_named_with_the_angle(off_deg, flown, arrived):
    off_rad = math.radians(off_deg)
    change = changed("rtk/heading", heading_rad=lambda rad: (rad + off_rad) % math.tau)
    (finding,) = worse(checked(arrived, fitting_config(flown), change))
    assert (finding.check, finding.severity) == ("heading_offset", Severity.STOP)
    assert finding.parameter == "ekf_node aircraft.second_antenna_m"
    off, sigma = map(float, re.search(r"is (.*) deg \(sigma (.*)\)", finding.evidence).groups())
    assert sigma < 1.0  # a quarter of what is reported
    assert off == pytest.approx(off_deg, abs=3 * sigma)


TURNED = [(90, 0, 0), (0, 90, 0), (0, 0, 90), (0, 0, -90), (0, 0, 180), (90, 0, 90)]


@pytest.mark.parametrize("rpy_deg", TURNED)
def test_a_turned_imu_is_named_with_its_angles(rpy_deg, flown, arrived):
    first, *_ = checked(arrived, fitting_config(flown), mounted(*rpy_deg))
    assert first.severity is Severity.STOP
    assert IMU_RPY in first.parameter
    assert (np.array(angles(first)) - rpy_deg) % 360 == pytest.approx([0, 0, 0])


def test_gravity_alone_shows_no_yaw(flown, arrived):
    (finding,) = worse(checked(arrived, fitting_config(flown), BARE, mounted(90, 0, 90)))
    assert "to [90.0, 0.0, 0.0] (gravity does not show the yaw)" in finding.mend


def finding_of(check, severity=Severity.STOP):
    return Finding(check, severity, "", "", "")


def test_the_camera_is_not_blamed_for_the_bodys_attitude():
    camera, motion = finding_of("boresight_by_motion"), finding_of("picture_motion")
    heading, latency = finding_of("heading_offset"), finding_of("video_latency")
    assert nearest_causes([camera, heading, latency, motion]) == [heading, latency]
    compass = finding_of("heading_offset", Severity.CAUTION)
    assert nearest_causes([compass, camera]) == [compass, camera]
