"""The aircraft's parameters from the filter's innovations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from aircraft_flights import TURNS, aircraft_samples, recorded, truth

from tirgeo_ros.core.aircraft_calibration.filter_run import FlightRuns, longest_piece
from tirgeo_ros.core.aircraft_calibration.fit import fit
from tirgeo_ros.core.aircraft_calibration.parameters import AZIMUTH, PARAMETERS, Floors
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample, Source

SETTLED = 4.0  # sigma: one in 16 000 by chance


@pytest.fixture(scope="module")
def flight():
    return recorded(aircraft_samples(1, 70.0))


@pytest.fixture(scope="module")
def found(flight):
    return fit(FlightRuns(flight, EkfConfig()), ())


def errors(result):
    told = [PARAMETERS.index(name) for name in result.told]
    return ((result.values - truth()) / result.sigma)[told]


@pytest.mark.slow
def test_slopes_are_those_of_runs_apart(flight):
    """A run at a value a little off: its innovations lie along the slope.

    Gains change with the antenna too, by which two slopes differ at random; 10 % is what that and
    the transition's second order leave.
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
    assert set(result.told) == {*PARAMETERS[:3], "position_delay"}
    assert "no rtk/heading" in result.untold["baseline_azimuth"]
    assert "no rtk/vel" in result.untold["velocity_delay"]
    assert np.abs(errors(result)).max() < SETTLED


@pytest.mark.slow
def test_an_outlier_hardly_moves_it(flight, found):
    aids = list(flight.aids)
    for k in range(100, len(aids), 90):
        if not isinstance(aids[k], HeadingSample) and aids[k].source is Source.RTK_POSITION:
            aids[k] = replace(aids[k], height_m=aids[k].height_m + 3.0)
    result = fit(FlightRuns(replace(flight, aids=aids), EkfConfig()), ())
    told = [PARAMETERS.index(name) for name in found.told]
    assert (np.abs(result.values - found.values)[told] < 2 * found.sigma[told]).all()


@pytest.mark.slow
@pytest.mark.long
def test_turns_on_the_spot_tell_the_antenna_though_the_baseline_is_unknown():
    """Held at 25 deg off, the baseline would turn the antenna's place by as much: 13 cm."""
    samples = aircraft_samples(3, 90.0, **{"route.shape": "hover"})
    result = fit(FlightRuns(recorded(samples), EkfConfig()), ())
    assert {"antenna_forward", "antenna_left", "heading_delay"} <= set(result.told)
    assert "baseline_azimuth" in result.untold
    assert np.abs(errors(result)).max() < SETTLED


@pytest.mark.slow
@pytest.mark.long
def test_the_autopilots_attitude_is_not_needed():
    samples = [
        replace(s, autopilot_q_nb=None) if isinstance(s, ImuSample) else s
        for s in aircraft_samples(4, 60.0, **TURNS)
    ]
    result = fit(FlightRuns(recorded(samples), EkfConfig()), ())
    assert "baseline_azimuth" in result.told
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
