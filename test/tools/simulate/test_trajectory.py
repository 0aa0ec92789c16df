"""The perfect IMU and the true motion belong together; the record of an IMU at rest."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import (
    euler_from_quat,
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
from tirgeo_ros.core.types.measurements import HeadingSample, Source
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from
from tirgeo_ros.tools.simulate.sensors import imu_bias, imu_white
from tirgeo_ros.tools.simulate.static_imu import main, write_static
from tirgeo_ros.tools.simulate.trajectory import Trajectory

SPIN_E = np.array([0.0, 0.0, EARTH_RATE_RAD_S])


def derivative_e(position_e, velocity_e, q_eb, force_b, rate_b):
    """The equations of motion in the earth-fixed frame (Groves 5.26, 5.36 and 2.133)."""
    lat, lon, height = (float(x) for x in geodetic_from_ecef(position_e))
    gravity_e = rotation_ecef_from_ned(lat, lon)[:, 2] * gravity_down(lat, height)
    rotation = matrix_from_quat(q_eb)
    acceleration = rotation @ force_b + gravity_e - 2 * np.cross(SPIN_E, velocity_e)
    rate_eb_b = rate_b - rotation.T @ SPIN_E
    return velocity_e, acceleration, 0.5 * quat_multiply(q_eb, np.array([0.0, *rate_eb_b]))


def integrate(trajectory, duration_s, step_s):
    """Runge and Kutta's fourth order on the IMU's values, from the true start."""
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


def test_what_the_receiver_says_is_true_beside_the_antimeridian_and_the_pole():
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


HOURS, SEED = 0.01, 3


@pytest.fixture(scope="module")
def scenario():
    return scenario_from({"imu.rate_hz": 400.0})


@pytest.fixture(scope="module")
def messages(scenario, tmp_path_factory):
    path = tmp_path_factory.mktemp("static") / "static.mcap"
    count = write_static(path, HOURS, scenario, SEED)
    cdr = Cdr()
    read = [(m, cdr.deserialize(m.data, m.typename)) for m in BagReader(path).messages()]
    assert len(read) == count == 14400
    return read


def test_stamps_are_even_and_the_log_times(scenario, messages):
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in messages])
    assert stamps[0] == scenario.start_ns
    np.testing.assert_array_equal(np.diff(stamps), 2_500_000)
    np.testing.assert_array_equal(stamps, [raw.log_time_ns for raw, _ in messages])
    assert {(raw.topic, m.header.frame_id) for raw, m in messages} == {("/imu/data", "base_link")}


def test_values_are_gravity_and_the_errors_of_the_flights(scenario, messages):
    def xyz(vectors):
        return np.array([(v.x, v.y, v.z) for v in vectors])

    rate = flu_from_frd(xyz(m.angular_velocity for _, m in messages))
    force = flu_from_frd(xyz(m.linear_acceleration for _, m in messages))
    bias = imu_bias(scenario.imu, SEED, len(messages))
    white = imu_white(scenario.imu, SEED, len(messages))
    gravity = gravity_down(np.radians(scenario.site.latitude_deg), scenario.site.ground_height_m)
    np.testing.assert_allclose(rate, bias.gyro_b + white[0], rtol=1e-12, atol=1e-15)
    wanted = bias.accel_b + white[1] - [0, 0, gravity]
    np.testing.assert_allclose(force, wanted, rtol=1e-12, atol=1e-12)


def test_the_command(tmp_path, capsys):
    path = tmp_path / "new" / "static.mcap"
    main(["-o", str(path), "--hours", "0.001"])
    assert capsys.readouterr().out == f"360 messages: {path}\n"
    first = path.read_bytes()
    main(["-o", str(path), "--hours", "0.001"])
    assert path.read_bytes() == first
    with pytest.raises(SystemExit, match="--hours must be above 0"):
        main(["-o", str(path), "--hours", "0"])
