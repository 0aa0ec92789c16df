"""The level of the IMU's mounting against the autopilot's."""

from __future__ import annotations

import numpy as np
import pytest
from aircraft_flights import aircraft_samples, recorded

from tirgeo_ros.core.aircraft_calibration.filter_run import FlightRuns
from tirgeo_ros.core.aircraft_calibration.mounting_level import mounting_level
from tirgeo_ros.core.aircraft_calibration.parameters import Floors, values_of_config
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_matrix,
    rotation_z,
)
from tirgeo_ros.core.types.measurements import ImuSample

PLANTED_RAD = np.radians((2.0, -3.0))


@pytest.fixture(scope="module")
def run():
    """The filter over a flight with all as the parameters say; its attitude is the IMU's."""
    flight = recorded(aircraft_samples(5, 60.0))
    runs = FlightRuns(flight, EkfConfig())
    values = values_of_config(runs.config)
    return runs.run(values, runs.aligned(values, by_antennas=False), Floors(0.5, 0.5, 0.1))


def autopilot(run, turn, yaw_rad=0.0):
    """The IMU's attitude seen from the body, with a heading that is wrong."""
    body_imu = matrix_from_rotvec(np.array([*turn, 0.0]))
    return [
        ImuSample(
            stamp_ns,
            np.zeros(3),
            np.zeros(3),
            quat_from_matrix(rotation_z(yaw_rad) @ matrix_from_quat(q) @ body_imu.T),
        )
        for stamp_ns, q in zip(run.attitude_ns, run.attitude_q_nb, strict=True)
    ]


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3])
def test_a_turn_is_found_whatever_the_heading(run, yaw_rad):
    """Small angles: the product of the two, 2e-3 rad, is what is neglected."""
    level = mounting_level(run, autopilot(run, PLANTED_RAD, yaw_rad), 6)
    np.testing.assert_allclose(level.angles_rad, PLANTED_RAD, atol=2e-3)
    np.testing.assert_allclose(level.sigma_rad, run.tilt_sigma_rad, rtol=0.1)
    assert level.left_out_rad.max() < 1e-3


def test_an_attitude_that_wanders_is_less_sure(run):
    samples = autopilot(run, PLANTED_RAD)
    third = len(samples) // 3
    samples[:third] = autopilot(run, PLANTED_RAD + 0.02)[:third]
    level = mounting_level(run, samples, 6)
    assert (level.sigma_rad > 3e-3).all()  # two of six parts 0.02 off: 0.01 / sqrt(6) = 4e-3


def test_without_the_autopilots_attitude_there_is_none(run):
    blind = [ImuSample(stamp_ns, np.zeros(3), np.zeros(3)) for stamp_ns in run.attitude_ns]
    assert mounting_level(run, blind, 6) is None
