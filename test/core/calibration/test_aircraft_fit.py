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
"""The aircraft's parameters from the filter's innovations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from aircraft_flights import TURNS, aircraft_samples, recorded, truth

from tirgeo_ros.core.calibration.aircraft_fit import fit, mounting_level
from tirgeo_ros.core.calibration.aircraft_parameters import (
    AZIMUTH,
    PARAMETERS,
    Floors,
    values_of_config,
)
from tirgeo_ros.core.calibration.aircraft_run import FlightRuns, longest_piece
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_matrix,
    rotation_z,
)
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample, Source

SETTLED = 4.0  # sigma: one in 16 000 by chance


@pytest.fixture(scope="module")
def flight():
    return recorded(aircraft_samples(1, 70.0))


@pytest.fixture(scope="module")
def estimate(flight):
    return fit(FlightRuns(flight, EkfConfig()), ())


def errors(result):
    reports = [PARAMETERS.index(name) for name in result.determined]
    return ((result.values - truth()) / result.sigma)[reports]


@pytest.mark.slow
def test_slopes_are_those_of_runs_apart(flight):
    """Compare a run at a value that is a little off: its innovations change by the slope.

    Gains change with the antenna too, which makes two slopes differ at random. This and the
    transition's second order leave 10 %.
    """
    runs = FlightRuns(flight, EkfConfig())
    start = runs.aligned(truth(), by_antennas=False)
    here = runs.run(truth(), start, Floors())
    for k, step in ((1, 0.02), (2, 0.02), (AZIMUTH, 0.005)):
        off = truth()
        off[k] += step
        change = (runs.run(off, start, Floors()).error - here.error) / step
        slope = here.slope[:, k]
        assert change @ slope == pytest.approx(slope @ slope, rel=0.1)


@pytest.mark.slow
def test_without_headings_and_velocities_the_rest_is_found(flight):
    aids = [s for s in flight.aids if getattr(s, "source", None) is Source.RTK_POSITION]
    result = fit(FlightRuns(replace(flight, aids=aids), EkfConfig()), ())
    assert set(result.determined) == {*PARAMETERS[:3], "position_delay"}
    assert "no rtk/heading" in result.undetermined["baseline_azimuth"]
    assert "no rtk/vel" in result.undetermined["velocity_delay"]
    assert np.abs(errors(result)).max() < SETTLED


@pytest.mark.slow
def test_an_outlier_hardly_moves_the_fit(flight, estimate):
    aids = list(flight.aids)
    for k in range(100, len(aids), 90):
        if not isinstance(aids[k], HeadingSample) and aids[k].source is Source.RTK_POSITION:
            aids[k] = replace(aids[k], height_m=aids[k].height_m + 3.0)
    result = fit(FlightRuns(replace(flight, aids=aids), EkfConfig()), ())
    reports = [PARAMETERS.index(name) for name in estimate.determined]
    assert (np.abs(result.values - estimate.values)[reports] < 2 * estimate.sigma[reports]).all()


@pytest.mark.slow
@pytest.mark.long
def test_turns_on_the_spot_tell_the_antenna_though_the_baseline_is_unknown():
    """A baseline held 25 deg off would turn the antenna's place as far: 13 cm."""
    samples = aircraft_samples(3, 90.0, **{"route.shape": "hover"})
    result = fit(FlightRuns(recorded(samples), EkfConfig()), ())
    assert {"antenna_forward", "antenna_left", "heading_delay"} <= set(result.determined)
    assert "baseline_azimuth" in result.undetermined
    assert np.abs(errors(result)).max() < SETTLED


@pytest.mark.slow
@pytest.mark.long
def test_the_autopilots_attitude_is_not_needed():
    samples = [
        replace(s, autopilot_q_nb=None) if isinstance(s, ImuSample) else s
        for s in aircraft_samples(4, 60.0, **TURNS)
    ]
    result = fit(FlightRuns(recorded(samples), EkfConfig()), ())
    assert "baseline_azimuth" in result.determined
    assert np.abs(errors(result)).max() < SETTLED


def test_without_attitude_and_headings_it_says_what_is_missing(flight):
    imu = [replace(sample, autopilot_q_nb=None) for sample in flight.imu[:500]]
    aids = [s for s in flight.aids if not isinstance(s, HeadingSample)]
    with pytest.raises(CalibrationError, match=r"does not start: needs .*orientation"):
        fit(FlightRuns(replace(flight, imu=imu, aids=aids), EkfConfig()), ())


def test_the_longest_part_without_a_gap_is_taken(flight):
    imu = [*flight.imu[:100], *flight.imu[150:400], *flight.imu[440:500]]
    assert longest_piece(imu, 0.2) == (100, 350)
    assert longest_piece(imu, 1.0) == (0, len(imu))


PLANTED_RAD = np.radians((2.0, -3.0))


@pytest.fixture(scope="module")
def aligned_run():
    """Run the filter over a flight with right parameters; its attitude is the IMU's."""
    flight = recorded(aircraft_samples(5, 60.0))
    runs = FlightRuns(flight, EkfConfig())
    values = values_of_config(runs.config)
    return runs.run(values, runs.aligned(values, by_antennas=False), Floors(0.5, 0.5, 0.1))


def autopilot(aligned_run, turn, yaw_rad=0.0):
    """Return the body's attitude from the IMU's, with a wrong heading."""
    body_imu = matrix_from_rotvec(np.array([*turn, 0.0]))
    return [
        ImuSample(
            stamp_ns,
            np.zeros(3),
            np.zeros(3),
            quat_from_matrix(rotation_z(yaw_rad) @ matrix_from_quat(q) @ body_imu.T),
        )
        for stamp_ns, q in zip(aligned_run.attitude_ns, aligned_run.attitude_q_nb, strict=True)
    ]


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3])
def test_a_turn_is_found_whatever_the_heading(aligned_run, yaw_rad):
    """The fit neglects the product of two small angles, 2e-3 rad."""
    level = mounting_level(aligned_run, autopilot(aligned_run, PLANTED_RAD, yaw_rad), 6)
    np.testing.assert_allclose(level.angles_rad, PLANTED_RAD, atol=2e-3)
    np.testing.assert_allclose(level.sigma_rad, aligned_run.tilt_sigma_rad, rtol=0.1)


def test_an_attitude_that_wanders_is_less_sure(aligned_run):
    samples = autopilot(aligned_run, PLANTED_RAD)
    third = len(samples) // 3
    samples[:third] = autopilot(aligned_run, PLANTED_RAD + 0.02)[:third]
    level = mounting_level(aligned_run, samples, 6)
    assert (level.sigma_rad > 3e-3).all()  # two of six parts 0.02 off: 0.01 / sqrt(6) = 4e-3


def test_without_the_autopilots_attitude_there_is_none(aligned_run):
    blind = [ImuSample(stamp_ns, np.zeros(3), np.zeros(3)) for stamp_ns in aligned_run.attitude_ns]
    assert mounting_level(aligned_run, blind, 6) is None
