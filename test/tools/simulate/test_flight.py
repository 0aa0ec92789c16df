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
"""Sensors have the scenario's errors; the perfect IMU and the motion agree."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tirgeo_ros.core.frames.rotations import (
    euler_from_quat,
    flu_from_frd,
    matrix_from_quat,
    quat_from_matrix,
    quat_multiply,
    rotvec_from_quat,
    wrap_pi,
)
from tirgeo_ros.core.frames.wgs84 import (
    EARTH_RATE_RAD_S,
    ecef_from_geodetic,
    geodetic_from_ecef,
    gravity_down,
    rotation_ecef_from_ned,
)
from tirgeo_ros.core.gimbal.camera_pose import joint_angles
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.tools.simulate.files import parameters_text
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from
from tirgeo_ros.tools.simulate.trajectory import Trajectory


@pytest.fixture(scope="module")
def flight():
    return fly(scenario_from({}))


def samples_of(flight, kind, source=None):
    return [
        (arrival, sample)
        for arrival, sample in flight.samples
        if isinstance(sample, kind) and (source is None or sample.source is source)
    ]


def rows_at(flight, samples):
    """Return rows of the truth at the stamps of samples, which are stamps of the IMU."""
    row = {stamp: k for k, stamp in enumerate(flight.truth.stamp_ns)}
    return [row[sample.stamp_ns] for _, sample in samples]


def readings_of(flight):
    """Return rates and forces (2, N, 3) of the IMU."""
    imu = [sample for _, sample in samples_of(flight, ImuSample)]
    return np.array([[s.angular_rate_b for s in imu], [s.specific_force_b for s in imu]])


def rms(errors):
    return np.sqrt(np.mean(np.square(errors), axis=0))


def test_samples_arrive_in_order_and_at_their_rates(flight):
    arrivals = [arrival for arrival, _ in flight.samples]
    assert arrivals == sorted(arrivals)
    assert all(arrival >= sample.stamp_ns for arrival, sample in flight.samples)
    counts = {kind: len(samples_of(flight, kind)) for kind in (ImuSample, HeadingSample)}
    assert counts == {ImuSample: 10_701, HeadingSample: 536}
    assert len(samples_of(flight, JointSample)) == 5351
    delays = {arrival - sample.stamp_ns for arrival, sample in samples_of(flight, HeadingSample)}
    assert delays == {80_000_000}


def test_rtk_fixes_are_those_of_the_antenna_with_their_noise(flight):
    truth = flight.truth
    arm = matrix_from_quat(truth.q_nb) @ flu_from_frd(np.array(flight.scenario.rtk.lever_arm_m))
    path = truth.position_p + arm
    fixes = samples_of(flight, PositionSample, Source.RTK_POSITION)
    places = np.array([(s.latitude_rad, s.longitude_rad, s.height_m) for _, s in fixes])
    errors = flight.plane.ned_from_geodetic(*places.T) - path[rows_at(flight, fixes)]
    # 536 draws: one sigma of a standard deviation is 3.1 %.
    np.testing.assert_allclose(rms(errors), [0.01, 0.01, 0.02], rtol=4 * 0.031)
    assert {sample.status for _, sample in fixes} == {FixStatus.FIXED}
    np.testing.assert_allclose(fixes[0][1].covariance_n, np.diag([1e-4, 1e-4, 4e-4]))
    samples = samples_of(flight, VelocitySample, Source.RTK_VELOCITY)[1:-1]
    rows = np.array(rows_at(flight, samples))
    true = (path[rows + 1] - path[rows - 1]) / 0.02  # the difference quotient over 20 ms
    errors = np.array([sample.velocity_n for _, sample in samples]) - true
    np.testing.assert_allclose(rms(errors), 0.02, rtol=4 * 0.031)


def test_headings_are_noisy_and_whole_degrees(flight):
    samples = samples_of(flight, HeadingSample)
    heading = np.array([sample.heading_rad for _, sample in samples])
    np.testing.assert_allclose(np.degrees(heading), np.round(np.degrees(heading)), atol=1e-9)
    true = euler_from_quat(flight.truth.q_nb[rows_at(flight, samples)])[:, 2]
    errors = np.degrees(wrap_pi(heading - true))
    # White noise of 0.4 deg and rounding's 1 / sqrt(12); 536 draws.
    expected = np.sqrt(0.4**2 + 1 / 12)
    assert rms(errors) == pytest.approx(expected, rel=4 * 0.031)
    assert samples[0][1].variance_rad2 == pytest.approx(np.radians(expected) ** 2)


def test_a_baseline_shows_what_tilt_does_to_it():
    """Along the nose it is the heading; across, the azimuth of the right wing less 90 deg."""
    exact = {"duration_s": 20.0, "heading.sigma_deg": 0.0, "heading.step_deg": 0.0}
    exact |= {"route.shape": "figure_eight", "route.acceleration_m_s2": 4.0}
    for second_m, baseline_b in (((0.9, 0.32, 0.38), (1, 0, 0)), ((-0.1, -0.78, 0.38), (0, 1, 0))):
        flown = fly(scenario_from({**exact, "rtk.second_antenna_m": second_m}))
        samples = samples_of(flown, HeadingSample)
        q_nb = flown.truth.q_nb[rows_at(flown, samples)]
        north, east, _ = (matrix_from_quat(q_nb) @ np.array(baseline_b)).T
        expected = np.arctan2(east, north) - math.atan2(baseline_b[1], baseline_b[0])
        heading = np.array([sample.heading_rad for _, sample in samples])
        np.testing.assert_allclose(wrap_pi(heading - expected), 0.0, atol=1e-12)
    off_nose = wrap_pi(heading - euler_from_quat(q_nb)[:, 2])
    assert np.degrees(np.abs(off_nose)).max() > 1.0  # half of roll times pitch, and more


def test_the_imu_has_table_5s_noise_about_its_bias(flight):
    truth, noise = flight.truth, flight.scenario.imu.noise
    samples = [sample for _, sample in samples_of(flight, ImuSample)]
    rate = np.array([s.angular_rate_b for s in samples]) - truth.angular_rate_b
    force = np.array([s.specific_force_b for s in samples]) - truth.specific_force_b
    # sqrt(100 Hz) = 10; 10 701 draws: one sigma of a standard deviation is 0.7 %.
    np.testing.assert_allclose(
        rms(rate - truth.gyro_bias_b), 10 * np.array(noise.angle_random_walk), rtol=4 * 0.007
    )
    np.testing.assert_allclose(
        rms(force - truth.accel_bias_b), 10 * np.array(noise.velocity_random_walk), rtol=4 * 0.007
    )


def test_planted_biases_and_late_stamps_are_in_the_readings_and_not_in_params_yaml(flight):
    planted = {
        "imu.gyro_bias_rad_s": [0.01, -0.02, 0.03],
        "imu.accel_bias_m_s2": [0.1, 0.2, -0.3],
        "imu.stamp_delay_s": 0.05,
    }
    scenario = scenario_from(planted)
    assert parameters_text(scenario) == parameters_text(flight.scenario)
    late = fly(scenario)
    np.testing.assert_array_equal(late.truth.q_nb, flight.truth.q_nb)
    bias = [[0.01, 0.02, -0.03], [0.1, -0.2, 0.3]]  # forward, right, down
    more = readings_of(late) - readings_of(flight)
    true = np.stack([flight.truth.angular_rate_b, flight.truth.specific_force_b])
    more[:, 5:] -= true[:, :-5] - true[:, 5:]
    # 5 samples of 10 ms; the biases and the noise are the same by stamp.
    np.testing.assert_allclose(more[0, 5:] - bias[0], 0, atol=1e-9)
    np.testing.assert_allclose(more[1, 5:] - bias[1], 0, atol=1e-9)


@pytest.fixture(scope="module", params=["ground", "hand"])
def take_off(request):
    standing = {
        "route.standing_s": 12.0,
        "route.standing_on": request.param,
        "imu.gyro_vibration_rad_s": 0.05,
        "imu.accel_vibration_m_s2": 2.0,
        "duration_s": 40.0,
    }
    return fly(scenario_from(standing))


def test_the_aircraft_stands_at_rest_or_is_in_a_hand_then_climbs_and_flies(take_off):
    truth = take_off.truth
    standing, flying = truth.t_s < 12.0, truth.t_s > take_off.trajectory.begin_s + 2.0
    turns = truth.angular_rate_b[standing]
    if take_off.scenario.route.standing_on == "ground":
        # Nothing but the earth turns; rounding of the splines is some 1e-16.
        np.testing.assert_allclose(np.linalg.norm(turns, axis=1), EARTH_RATE_RAD_S, atol=1e-12)
        np.testing.assert_allclose(truth.velocity_n[standing], 0.0, atol=1e-12)
        assert np.ptp(truth.q_nb[standing], axis=0).max() < 1e-12
        # Jerk is bounded: a step of the force between two samples of 10 ms would show.
        assert np.abs(np.diff(truth.specific_force_b, axis=0)).max() < 1.0
    else:
        # Turns of 3 deg and shifts of 2 cm at about 1 Hz; the smoothing takes some of them.
        assert np.all((np.degrees(rms(turns)) > 4) & (np.degrees(rms(turns)) < 30))
        shifts = truth.position_p[standing].std(axis=0)
        assert np.all((shifts > 0.005) & (shifts < 0.03))
    np.testing.assert_allclose(truth.position_p[standing, 2], -0.5, atol=0.1)
    # 20 m high, with an error of 0.1 m, at 3 m/s.
    np.testing.assert_allclose(truth.position_p[flying, 2], -20.0, atol=0.6)
    assert np.linalg.norm(truth.velocity_n[flying], axis=1).max() == pytest.approx(3.0, abs=0.4)


def test_vibration_begins_with_the_engine(take_off):
    truth = take_off.truth
    off = readings_of(take_off) - [truth.angular_rate_b, truth.specific_force_b]
    off -= np.stack([truth.gyro_bias_b, truth.accel_bias_b])
    before, after = truth.t_s < 7.0, truth.t_s >= 7.0
    white = take_off.scenario.imu.noise
    # 700 draws: one sigma of a standard deviation is 2.7 %.
    np.testing.assert_allclose(
        rms(off[0, before]), 10 * np.array(white.angle_random_walk), rtol=4 * 0.027
    )
    # Wandering lines are fewer independent numbers than the 3300 samples.
    np.testing.assert_allclose(rms(off[0, after]), 0.05, rtol=0.1)
    np.testing.assert_allclose(rms(off[1, after]), 2.0, rtol=0.1)


def test_the_camera_wanders_by_table_8_and_the_encoders_see_it(flight):
    truth = flight.truth
    np.testing.assert_allclose(
        np.degrees(rms(flight.gimbal.wander_rad(truth.t_s))), [0.2704, 0.4839], rtol=2e-3
    )
    samples = samples_of(flight, JointSample)
    rows = rows_at(flight, samples)
    rotation_pg = flight.gimbal.rotation_pg(truth.t_s[rows])
    rotation_pb = flight.trajectory.motion(truth.t_s[rows]).rotation_pb
    true = joint_angles(np.swapaxes(rotation_pb, 1, 2) @ rotation_pg)
    measured = np.array([(s.yaw_rad, s.roll_rad, s.pitch_rad) for _, s in samples])
    np.testing.assert_allclose(np.degrees(rms(measured - true)), 0.02, rtol=4 / np.sqrt(2 * 5351))


def test_the_flight_controller_reports_the_command_and_its_own_heading(flight):
    samples = samples_of(flight, CameraAttitudeSample)
    rows = rows_at(flight, samples)
    reported = euler_from_quat(np.array([sample.q_ng for _, sample in samples]))
    np.testing.assert_allclose(np.degrees(reported[:, 0]), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.degrees(reported[:, 1]), -30.0, atol=1e-9)
    # psi_coder: the autopilot's heading error is in both, so only the encoder's noise is left.
    pilot = np.array([s.autopilot_q_nb for _, s in samples_of(flight, ImuSample)])[rows]
    coder = reported[:, 2] - euler_from_quat(pilot)[:, 2]
    _, q_pc = flight.gimbal.camera(flight.truth.t_s[rows])
    axis = matrix_from_quat(q_pc)[:, :, 2]
    true = np.arctan2(axis[:, 1], axis[:, 0]) - euler_from_quat(flight.truth.q_nb[rows])[:, 2]
    errors = np.degrees(wrap_pi(coder - true))
    # 0.02 deg of encoder; the plane's meridians converge by 0.0005 deg within 100 m.
    assert rms(errors) == pytest.approx(0.02, rel=0.1)


SPIN_E = np.array([0.0, 0.0, EARTH_RATE_RAD_S])


def derivative_e(position_e, velocity_e, q_eb, force_b, rate_b):
    """Return the rates of the motion in the earth-fixed frame (Groves 5.26, 5.36 and 2.133)."""
    lat, lon, height = (float(x) for x in geodetic_from_ecef(position_e))
    gravity_e = rotation_ecef_from_ned(lat, lon)[:, 2] * gravity_down(lat, height)
    rotation = matrix_from_quat(q_eb)
    acceleration = rotation @ force_b + gravity_e - 2 * np.cross(SPIN_E, velocity_e)
    rate_eb_b = rate_b - rotation.T @ SPIN_E
    return velocity_e, acceleration, 0.5 * quat_multiply(q_eb, np.array([0.0, *rate_eb_b]))


def integrate(trajectory, duration_s, step_s):
    """Integrate the IMU's values from the true start by Runge and Kutta's fourth order."""
    half_steps = np.arange(0, 2 * round(duration_s / step_s) + 1) * step_s / 2
    motion = trajectory.motion(half_steps)
    force, rate = trajectory.inertial(motion)
    plane = trajectory.plane
    to_earth = rotation_ecef_from_ned(plane.latitude_rad, plane.longitude_rad)
    origin = ecef_from_geodetic(plane.latitude_rad, plane.longitude_rad, plane.height_m)
    state = (
        origin + to_earth @ motion.position_p[0],
        to_earth @ motion.velocity_p[0],
        quat_from_matrix(to_earth @ motion.rotation_pb[0]),
    )
    for k in range(0, len(half_steps) - 1, 2):
        slopes = []
        for stage, weight in ((0, 0.0), (1, 0.5), (1, 0.5), (2, 1.0)):
            moved = [
                x + weight * step_s * slopes[-1][i] if slopes else x for i, x in enumerate(state)
            ]
            slopes.append(derivative_e(*moved, force[k + stage], rate[k + stage]))
        state = tuple(
            x + step_s / 6 * (a + 2 * b + 2 * c + d)
            for x, a, b, c, d in zip(state, *slopes, strict=True)
        )
    position_e, velocity_e, q_eb = state
    last_q = quat_multiply(
        np.array([1.0, -1.0, -1.0, -1.0]) * q_eb,
        quat_from_matrix(to_earth @ motion.rotation_pb[-1]),
    )
    return (
        to_earth.T @ (position_e - origin) - motion.position_p[-1],
        to_earth.T @ velocity_e - motion.velocity_p[-1],
        rotvec_from_quat(last_q),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "site"),
    [
        ("hover", (39.85, 116.70, 11.5)),
        ("figure_eight", (-45.0, 170.5, 300.0)),
        ("lawnmower", (-17.0, 179.9999, 5.0)),  # over the antimeridian
        ("lawnmower", (-89.0, 20.0, 2800.0)),
    ],
)
def test_integrating_the_perfect_imu_gives_the_trajectory_back(shape, site):
    names = ("site.latitude_deg", "site.longitude_deg", "site.ground_height_m")
    values = {"route.shape": shape, "duration_s": 40.0, **dict(zip(names, site, strict=True))}
    scenario = scenario_from(values)
    position, velocity, attitude = integrate(Trajectory(scenario, 7), 40.0, 0.02)
    # Truncation of order four at 0.02 s is below a micrometre per second of manoeuvre, rounding
    # of earth-fixed coordinates (6e6 m) 1e-9 m a step; Coriolis left out would be decimetres.
    assert np.abs(position).max() < 1e-4
    assert np.abs(velocity).max() < 1e-5
    assert np.abs(attitude).max() < 1e-7


def test_the_paper_flight_is_flown_as_the_paper_says():
    scenario = scenario_from({})
    motion = Trajectory(scenario, scenario.seed).motion(np.arange(0.0, 107.0, 0.05))
    speed = np.linalg.norm(motion.velocity_p, axis=1)
    cruising = (motion.t_s > 8) & (np.abs(np.degrees(motion.rate_pb_b[:, 2])) < 1)
    # The autopilot's slips of 0.1 m over 4 s are some 0.1 m/s.
    assert abs(speed[cruising].mean() - 3.0) < 0.1
    assert np.abs(motion.position_p[:, 2] + 20.0).max() < 5 * scenario.route.hold_error_m
    yaw_rate = np.degrees(np.abs(motion.rate_pb_b[:, 2])).max()
    assert 30 < yaw_rate < 40
    assert speed[0] < 0.3
    assert speed[-1] < 1.0


def test_receivers_are_right_near_the_antimeridian_and_the_pole():
    """Without noise: longitudes within 180 degrees, headings from true north at the aircraft."""
    values = {
        "site.latitude_deg": 89.0,
        "site.longitude_deg": 179.9999,  # 2 m west of the antimeridian
        "duration_s": 20.0,
        "route.heading_deg": 90.0,
        "imu.rate_hz": 50.0,
        **{f"rtk.{name}_m": (0.0, 0.0, 0.0) for name in ("position_sigma", "lever_arm")},
        "rtk.second_antenna_m": (1.0, 0.0, 0.0),
        **{f"heading.{name}_deg": 0.0 for name in ("sigma", "step")},
    }
    flown = fly(scenario_from(values))
    truth, rows = flown.truth, {stamp: k for k, stamp in enumerate(flown.truth.stamp_ns)}
    fixes = [s for _, s in flown.samples if getattr(s, "source", None) is Source.RTK_POSITION]
    assert max(s.longitude_rad for s in fixes) <= math.pi
    assert min(s.longitude_rad for s in fixes) < -3.14
    for fix in fixes:
        k = rows[fix.stamp_ns]
        apart = wrap_pi(fix.longitude_rad - truth.longitude_rad[k])
        assert apart == pytest.approx(0.0, abs=1e-14)
        assert fix.latitude_rad == pytest.approx(truth.latitude_rad[k], abs=1e-15)
    for sample in (s for _, s in flown.samples if isinstance(s, HeadingSample)):
        true = euler_from_quat(truth.q_nb[rows[sample.stamp_ns]])[2]
        # 42 m east there, meridians have turned by 0.02 deg.
        assert wrap_pi(sample.heading_rad - true) == pytest.approx(0.0, abs=1e-12)
