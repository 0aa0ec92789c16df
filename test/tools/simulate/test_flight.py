"""What the simulated sensors say differs from the truth by what the scenario says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import euler_from_quat, matrix_from_quat, wrap_pi
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
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from


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
    """Rows of the truth at the stamps of samples; sensors measure at stamps of the IMU."""
    row = {stamp: k for k, stamp in enumerate(flight.truth.stamp_ns)}
    return [row[sample.stamp_ns] for _, sample in samples]


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
    said = np.array([(s.yaw_rad, s.roll_rad, s.pitch_rad) for _, s in samples])
    np.testing.assert_allclose(np.degrees(rms(said - true)), 0.02, rtol=4 / np.sqrt(2 * 5351))


def test_the_flight_controller_reports_the_command_and_its_own_heading(flight):
    samples = samples_of(flight, CameraAttitudeSample)
    rows = rows_at(flight, samples)
    said = euler_from_quat(np.array([sample.q_ng for _, sample in samples]))
    np.testing.assert_allclose(np.degrees(said[:, 0]), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.degrees(said[:, 1]), -30.0, atol=1e-9)
    # psi_coder: the autopilot's heading error is in both, so only the encoder's noise is left.
    pilot = np.array([s.autopilot_q_nb for _, s in samples_of(flight, ImuSample)])[rows]
    coder = said[:, 2] - euler_from_quat(pilot)[:, 2]
    _, q_pc = flight.gimbal.camera(flight.truth.t_s[rows])
    axis = matrix_from_quat(q_pc)[:, :, 2]
    true = np.arctan2(axis[:, 1], axis[:, 0]) - euler_from_quat(flight.truth.q_nb[rows])[:, 2]
    errors = np.degrees(wrap_pi(coder - true))
    # 0.02 deg of encoder; the plane's meridians converge by 0.0005 deg within 100 m.
    assert rms(errors) == pytest.approx(0.02, rel=0.1)
