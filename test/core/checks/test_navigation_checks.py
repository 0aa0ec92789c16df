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
"""Faults planted in flights are named with their parameter; clean flights give no finding."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from checked_flights import changed, checked, lost, recorded

from tirgeo_ros.core.checks.heading_checks import HeadingChecks
from tirgeo_ros.core.checks.inertial_checks import ImuMean
from tirgeo_ros.core.checks.navigation_checks import NavigationChecks, VelocityChecks
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, wrapped
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample, Source, VelocitySample
from tirgeo_ros.tools.replay.node_configs import node_configs

NOTE, CAUTION, STOP = Severity
RTK = "rtk/fix rtk/vel rtk/heading"
ALL = f"imu/data gps/fix gps/vel {RTK}"
HEADING, RTK_DELAY = "rtk/heading", "rtk.delay_s"
FORCE, RATE = "imu/data linear_acceleration", "imu/data angular_velocity"
SECOND, GEOID = "aircraft.second_antenna_m", "geoid_undulation_m"
DEGREES = math.degrees(1.0)


@pytest.fixture(scope="module")
def flight(sample):
    return recorded(sample / "flight.mcap")


@pytest.fixture(scope="module")
def config(sample):
    return node_configs([sample / "params.yaml"]).ekf


def heading(turn=None, plus_deg=0.0):
    def changed_rad(rad):
        return (turn(rad) if turn else rad + math.radians(plus_deg)) % math.tau

    return changed(HEADING, heading_rad=changed_rad)


def azimuth(rad):
    return math.pi / 2 - rad


def in_degrees(rad):
    return math.pi / 2 - math.degrees(math.pi / 2 - rad)


def stamps(topics, seconds):
    return changed(topics, stamp_ns=lambda ns: ns + round(seconds * 1e9))


def unstamped(topics):
    return changed(topics, stamp_ns=lambda _: 0)


def imu(force=1.0, rate=1.0):
    return changed(
        "imu/data",
        specific_force_b=lambda f: f * np.array(force),
        angular_rate_b=lambda w: w * np.array(rate),
    )


def higher(topic, metres):
    return changed(topic, height_m=lambda m: m + metres)


def velocity(topic, change):
    return changed(topic, velocity_n=change)


def ned(velocity_n):
    """Return a velocity as decoded if x is sent as north, y as east, z as down."""
    north, east, down = velocity_n
    return np.array([east, north, -down])


stopped = velocity("rtk/vel", np.zeros_like)
in_km_h = velocity("rtk/vel", lambda v: v * 3.6)
bare = changed("imu/data", autopilot_q_nb=lambda _: None)
swapped_rates = changed("imu/data", angular_rate_b=lambda w: w[[1, 0, 2]])
another_base = changed("rtk/fix", latitude_rad=lambda rad: rad + 30 / 6.37e6)
no_covariance = changed("rtk/fix rtk/vel", covariance_n=np.zeros_like)
no_variance = changed(HEADING, variance_rad2=lambda _: 0.0)
ON_ITS_SIDE = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]).T  # its y is down
turned_imu = changed(
    "imu/data",
    specific_force_b=lambda f: ON_ITS_SIDE @ f,
    angular_rate_b=lambda w: ON_ITS_SIDE @ w,
)


def without_gravity(arrived):
    if arrived.topic != "imu/data":
        return arrived
    sample = arrived.sample
    gravity_b = 9.81 * matrix_from_quat(sample.autopilot_q_nb)[2]
    force_b = sample.specific_force_b + gravity_b
    return arrived._replace(sample=replace(sample, specific_force_b=force_b))


def swapped(arrived):
    if arrived.topic != "rtk/fix":
        return arrived
    s = arrived.sample
    there = replace(s, latitude_rad=s.longitude_rad, longitude_rad=s.latitude_rad)
    return arrived._replace(sample=there)


def every(number, *topics):
    """Keep one sample in ``number`` of each topic."""
    counts = dict.fromkeys(topics, 0)

    def change(arrived):
        if arrived.topic not in counts:
            return arrived
        counts[arrived.topic] += 1
        return arrived if counts[arrived.topic] % number == 0 else None

    return change


def gaps(arrived):
    """Silence the IMU for 0.4 s in every 5 s."""
    silent = arrived.topic == "imu/data" and arrived.arrival_ns // 10**8 % 50 < 4
    return None if silent else arrived


#: Fault: its change; the first finding's severity, check, parameter and words of its line.
PLANTED = {
    "acceleration in g": (imu(force=1 / 9.80665), STOP, "force_unit", FORCE, "it is in g"),
    "gravity taken off": (without_gravity, STOP, "force_unit", FORCE, "gravity was removed"),
    "gravity's sign": (imu(force=-1.0), STOP, "force_axes", FORCE, "the sign is wrong"),
    "IMU on its side": (turned_imu, STOP, "force_axes", FORCE, "aircraft.imu_rpy_deg"),
    "accelerometers 5 % off": (imu(force=1.05), CAUTION, "force_scale", FORCE, "calibrate the"),
    "gyroscopes in deg/s": (imu(rate=DEGREES), STOP, "gyro_unit", RATE, "deg/s"),
    "roll rate's sign": (imu(rate=[-1, 1, 1]), STOP, "gyro_axes", RATE, "(roll) has the wrong"),
    "yaw rate's sign": (imu(rate=[1, 1, -1]), STOP, "gyro_axes", RATE, "(yaw) has the wrong sign"),
    "roll and pitch rate swapped": (swapped_rates, STOP, "gyro_axes", RATE, "turn the axes"),
    "heading + 90 deg": (heading(plus_deg=90), STOP, "heading_offset", SECOND, "across"),
    "heading + 180 deg": (heading(plus_deg=180), STOP, "heading_offset", SECOND, "swapped"),
    "heading + 20 deg": (heading(plus_deg=20), STOP, "heading_offset", SECOND, "measure both"),
    "azimuth for ENU yaw": (heading(azimuth), STOP, "heading_turns", HEADING, "90 deg less"),
    "heading in degrees": (heading(in_degrees), STOP, "heading_turns", HEADING, "degrees instead"),
    "heading repeated": (heading(lambda _: 0.3), STOP, "heading_turns", HEADING, "repeated"),
    "heading silent": (lost(HEADING), CAUTION, "no_rtk_heading", HEADING, "method to ekf"),
    "RTK above sea level": (higher("rtk/fix", -47), CAUTION, "height_datum", GEOID, "sea level"),
    "GPS above sea level": (higher("gps/fix", 9), CAUTION, "height_datum", GEOID, "sea level"),
    "another base": (another_base, CAUTION, "position_datum", "rtk/fix", "of the RTK base"),
    "latitude for longitude": (swapped, STOP, "position_elsewhere", "latitude", "swapped"),
    "rtk/vel NED": (velocity("rtk/vel", ned), STOP, "rtk_vel_axes", "rtk/vel", "send ENU"),
    "gps/vel NED": (velocity("gps/vel", ned), STOP, "gps_vel_axes", "gps/vel", "send ENU"),
    "rtk/vel in km/h": (in_km_h, STOP, "rtk_vel_unit", "rtk/vel", "km/h"),
    "rtk/vel always 0": (stopped, STOP, "rtk_vel_zero", "rtk/vel", "0,"),
    "covariances 0": (no_covariance, CAUTION, "covariance_zero", "rtk/fix", "rtk/vel (150 of"),
    "heading's variance 0": (no_variance, CAUTION, "covariance_zero", HEADING, "sigma_floor_deg"),
    "stamps zero": (unstamped(RTK), CAUTION, "stamp_zero", RTK_DELAY, "rtk/fix (150 of 150)"),
    "all stamps zero": (unstamped(ALL), CAUTION, "stamp_zero", "imu.delay_s", "imu/data"),
    "RTK stamped 0.5 s early": (stamps(RTK, -0.5), STOP, "stamp_late", RTK_DELAY, "0.58 s behind"),
    "RTK stamped 0.5 s late": (stamps(RTK, 0.5), STOP, "stamp_ahead", RTK_DELAY, "0.42 s ahead"),
    "RTK in GPS time": (stamps(RTK, 18), STOP, "stamp_ahead", "rtk/fix", "17.92 s ahead"),
    "RTK 0.2 s early": (stamps(RTK, -0.2), CAUTION, "rtk_fix_delay", RTK_DELAY, "earlier"),
    "IMU at 20 Hz": (every(5, "imu/data"), CAUTION, "imu_rate", "imu/data", "20 Hz"),
    "RTK at 1 Hz": (every(5, *RTK.split()), CAUTION, "rtk_rate", "rtk/fix", "1.0 Hz"),
    "gaps of the IMU": (gaps, CAUTION, "imu_gaps", "imu/data", "longest 0.4 s"),
    "no RTK": (lost("rtk/"), NOTE, "no_rtk_fix", "rtk/fix", "ordinary GPS"),
    "no position": (lost("rtk/", "gps/"), STOP, "no_rtk_fix", "rtk/fix", "nothing gives a"),
    "no IMU": (lost("imu/data"), STOP, "no_imu_data", "imu/data", "no message"),
}


@pytest.mark.parametrize("fault", PLANTED)
def test_a_planted_fault_is_named_first(fault, flight, config):
    change, severity, check, parameter, words = PLANTED[fault]
    first, *others = checked(flight, config, change)
    assert (first.check, first.severity) == (check, severity)
    assert parameter in first.parameter
    assert words in first.line
    # One fault gives one finding; only turned axes concern both sensors.
    assert all(item.severity is NOTE or check == "force_axes" for item in others)


def of_headings(count, rate_of, heading_of):
    """Return the checks that report headings (rad) at 20 Hz beside yaw rates (rad/s)."""
    checks, forces_b = HeadingChecks(EkfConfig()), np.array([0.0, 0.0, -9.8])
    for k in range(1, count):
        rates_b = np.array([0.0, 0.0, rate_of(k)])
        checks.block(ImuMean(k * 50_000_000, 0.05, forces_b, rates_b, None, joined=True))
        checks.heading(HeadingSample(k * 50_000_000, wrapped(heading_of(k)), 1e-4))
    return [item.check for item in checks.findings()]


@pytest.mark.parametrize(("sign", "expected"), [(1, []), (-1, ["heading_turns"])])
def test_turns_of_some_minutes_ago_still_show_the_sign_of_headings(sign, expected):
    turned = of_headings(6000, lambda k: 0.3 * (k < 600), lambda k: sign * 0.015 * min(k, 600))
    assert turned == expected


@pytest.mark.parametrize(("every", "expected"), [(16, []), (3, ["heading_turns"])])
def test_single_outliers_among_headings_are_no_fault(every, expected):
    """Two headings of 34 s are 140 deg off: the changes to them and back have 54 deg rms."""

    def outlying(k):
        return 0.005 * k + (2.4 if k // 20 % every == 8 % every else 0.0)

    assert of_headings(681, lambda _: 0.1, outlying) == expected


@pytest.mark.parametrize(("sign", "expected"), [(1, []), (-1, ["rtk_vel_up"])])
def test_climbs_with_the_wrong_sign_are_named(sign, expected):
    checks = VelocityChecks("rtk/vel", "rtk/fix")
    for stamp_ns in range(0, 20_000_000_000, 200_000_000):
        turn = 0.5e-9 * stamp_ns
        climbs = np.array([0.0, 0.0, sign * 1.5 * np.cos(turn)])
        checks.velocity(VelocitySample(stamp_ns, Source.RTK_VELOCITY, climbs, np.eye(3)))
        checks.position(stamp_ns, np.array([0.0, 0.0, 3 * np.sin(turn)]))
    assert [item.check for item in checks.findings()] == expected


def over_ground(noise_m, change):
    """Return the findings of a turning flight at 3 m/s; ``change`` takes velocities and times."""
    checks, rng = VelocityChecks("gps/vel", "gps/fix"), np.random.default_rng(7)
    for stamp_ns in range(0, 60_000_000_000, 200_000_000):
        turn = 0.2e-9 * stamp_ns
        sent = change(3.0 * np.array([np.cos(turn), np.sin(turn), 0.0]), turn)
        checks.velocity(VelocitySample(stamp_ns, Source.GPS_VELOCITY, sent, np.eye(3)))
        place = 15.0 * np.array([np.sin(turn), -np.cos(turn), 0.0])
        checks.position(stamp_ns, place + rng.normal(0, noise_m, 3) * (1, 1, 0))
    return [(item.check, item.mend) for item in checks.findings()]


@pytest.mark.parametrize(
    ("change", "check", "end"),
    [
        (lambda v, _: v * 3.6, "gps_vel_unit", " means km/h"),
        (lambda v, _: v * 3600 / 1852, "gps_vel_unit", " means knots"),
        (lambda v, _: v * 2.237, "gps_vel_unit", " means mph"),
        (lambda v, _: v * 100.0, "gps_vel_unit", " means cm/s"),
        (lambda v, _: np.linalg.norm(v) * np.eye(3)[0], "gps_vel_axes", "not in axes of the body"),
    ],
)
def test_a_unit_is_named_by_its_ratio_and_axes_by_directions(change, check, end):
    ((name, mend),) = over_ground(0.3, change)
    assert name == check
    assert mend.endswith(end)


@pytest.mark.parametrize("noise_m", [1.0, 1.5, 2.5, 4.0, 8.0])
@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_poor_positions_are_no_other_unit(noise_m, factor):
    """Poor positions give speeds of 1.5 times and more, in other directions."""
    assert over_ground(noise_m, lambda v, _: v * factor) == []


def test_a_jump_of_a_clock_is_reported_with_its_size(flight, config):
    middle_ns = flight[len(flight) // 2].arrival_ns

    def change(arrived):
        later = arrived.topic in RTK.split() and arrived.arrival_ns > middle_ns
        return stamps(RTK, 0.3)(arrived) if later else arrived

    by_check = {item.check: item for item in checked(flight, config, change)}
    assert "jumped by -0.30 s" in by_check["stamp_jump"].evidence


def test_the_sample_flight_is_clean(flight, config):
    assert checked(flight, config, given=()) == []


def test_places_that_are_not_configured(flight):
    (finding,) = checked(flight, EkfConfig(), given=())
    (unknown,) = checked(flight, EkfConfig())
    assert (finding.check, finding.severity) == ("antenna_place", CAUTION)
    assert "aircraft.rtk_antenna_m" in finding.parameter
    assert unknown.severity is NOTE
    # A configured place of zero contradicts the flight.
    (text,) = checked(flight, EkfConfig(), given=("aircraft.rtk_antenna_m",))
    assert (text.check, text.severity) == ("antenna_place", CAUTION)
    assert "not at (+0.00, +0.00, +0.00)" in text.evidence


def test_without_the_autopilots_attitude_the_course_tells(flight, config):
    assert [item.check for item in checked(flight, config, bare)] == ["imu_tilt"]  # not known
    (finding,) = checked(flight, config, bare, heading(plus_deg=180))
    assert (finding.check, finding.severity) == ("heading_offset", STOP)
    assert "the course over ground" in finding.evidence


def test_without_the_autopilots_attitude_headings_tell_of_the_gyroscopes(flight, config):
    findings = checked(flight, config, bare, imu(rate=DEGREES * 0.7))
    by_check = {item.check: item for item in findings}
    assert by_check["heading_turns"].severity is STOP
    assert "imu/data angular_velocity" in by_check["heading_turns"].parameter


def test_numbers_that_are_none_do_no_harm(flight, config):
    noise = changed(
        "imu/data",
        specific_force_b=lambda f: f * np.nan,
        angular_rate_b=lambda w: w * np.inf,
    )
    nowhere = changed(
        "rtk/fix gps/fix", height_m=lambda _: math.nan, covariance_n=lambda c: c * np.nan
    )
    still = changed("rtk/vel gps/vel", velocity_n=lambda v: v * np.nan)
    headless = heading(lambda _: math.nan)
    assert checked(flight[:2000], config, noise, nowhere, still, headless) == []


@pytest.mark.parametrize(("counts_s", "severity"), [(math.inf, CAUTION), (60.0, NOTE)])
def test_a_gap_of_the_imu_is_over_in_flight_and_counts_in_a_log(counts_s, severity):
    checks, zero = NavigationChecks(EkfConfig(), None, counts_s), np.zeros(3)
    for ms in (*range(0, 1000, 20), *range(1500, 62_000, 20)):
        stamp_ns = ms * 1_000_000 + 1
        checks.take("imu/data", ImuSample(stamp_ns, np.array([0, 0, -9.8]), zero), stamp_ns)
        if ms == 30_000:
            assert severity_of(checks, "imu_gaps") is CAUTION
    assert severity_of(checks, "imu_gaps") is severity


def severity_of(checks, name):
    return next(item.severity for item in checks.findings() if item.check == name)
