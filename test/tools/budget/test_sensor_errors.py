"""Equation 22 on tracks whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_matrix, rotation_z
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.measurements import FixStatus, ImuSample, PositionSample, Source
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.tools.budget.sensor_errors import camera_track, gps_less_rtk_n

PLANE = TangentPlane(0.6955, 2.0368, 11.5)
Q_NB = quat_from_matrix(rotation_z(np.radians(90.0)))  # the nose to the east
ARMS = {"aircraft.rtk_antenna_m": (0.5, 0, 0.4), "aircraft.gps_antenna_m": (0, 0.3, 0.1)}  # FLU
CONFIG = config_from(EkfConfig, ARMS)
OFF_N = np.array([1.0, -2.0, 3.0])


def imu(count=200):
    force, rate = np.array([0, 0, -9.8]), np.zeros(3)
    return [ImuSample(10**9 + k * 10_000_000, force, rate, Q_NB) for k in range(count)]


def track(source, rate_hz, arm_b, off_n=(0, 0, 0), status=FixStatus.FIXED, seconds=2.0):
    """Flown to the north-east at 5 m/s, as an antenna finds it."""
    found = []
    for k in range(int(seconds * rate_hz)):
        t_s = k / rate_hz
        place_n = np.array([3.0, 4.0, 0.1]) * t_s + matrix_from_quat(Q_NB) @ arm_b + off_n
        place = map(float, PLANE.geodetic_from_ned(place_n))
        stamp_ns = 10**9 + round(t_s * 1e9)
        found.append(PositionSample(stamp_ns, source, status, *place, np.eye(3)))
    return found


def test_the_antennas_places_and_rates_do_not_matter_but_rtk_must_be_fixed():
    rtk = track(Source.RTK_POSITION, 5, CONFIG.aircraft.rtk_lever_b)
    gps = track(Source.GPS_POSITION, 7, CONFIG.aircraft.gps_lever_b, OFF_N, FixStatus.SINGLE)
    errors = gps_less_rtk_n([*gps, *rtk], imu(), PLANE, CONFIG)
    # the last RTK is at 1.8 s: 13 of the GPS's come before
    np.testing.assert_allclose(errors, np.tile(OFF_N, (13, 1)), atol=1e-6)
    rtk = track(Source.RTK_POSITION, 5, CONFIG.aircraft.rtk_lever_b, status=FixStatus.FLOAT)
    assert gps_less_rtk_n([*rtk, *gps], imu(), PLANE, CONFIG).shape == (0, 3)


def test_no_truth_across_a_gap():
    rtk = track(Source.RTK_POSITION, 5, CONFIG.aircraft.rtk_lever_b, seconds=4.0)
    gps = track(Source.GPS_POSITION, 5, CONFIG.aircraft.gps_lever_b, OFF_N, FixStatus.SINGLE, 4.0)
    left = [p for k, p in enumerate(rtk) if not 5 <= k <= 10]  # none from 0.8 to 2.2 s
    # five up to 0.8 s, eight after 2.2 s, whose own RTK ends the gap
    errors = gps_less_rtk_n([*left, *gps], imu(400), PLANE, CONFIG)
    np.testing.assert_allclose(errors, np.tile(OFF_N, (13, 1)), atol=1e-6)


def test_the_cameras_way_and_its_covariance_along_it():
    """A camera to the east, 40 deg down, whose error ahead is the largest."""
    down = np.radians(40.0)
    ahead_n = np.array([0.0, np.cos(down), np.sin(down)])
    right_n = np.array([-1.0, 0.0, 0.0])
    rotation_nc = np.stack([right_n, np.cross(ahead_n, right_n), ahead_n], axis=1)
    q_nc = quat_from_matrix(rotation_nc)
    covariance = np.diag([1.0, 9.0, 4.0, 1e-4, 9e-4, 4e-4])
    poses = [
        CameraPose(k * 10**8, np.array([0, 0.2 * k, -20]), q_nc, covariance) for k in range(5)
    ]
    found = camera_track(poses, PLANE)
    assert found.depression_deg == pytest.approx(40.0)
    assert found.speed_m_s == pytest.approx(2.0)
    assert found.height_m == pytest.approx(31.5, abs=1e-6)
    np.testing.assert_allclose(
        found.covariance_a, np.diag([9.0, 1.0, 4.0, 9e-4, 1e-4, 4e-4]), atol=1e-12
    )
