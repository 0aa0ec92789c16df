"""Headings in whole degrees: what the two ways of reading them give, and why one is the default.

A scalar filter stands for the whole one here: its heading drifts as that of the gyroscopes does
between readings at 5 Hz, while the aircraft holds a heading, which is where rounding hurts, and
turns every ten seconds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from filter_states import NOW_NS, ZERO, ekf_config, estimate_of, state_of
from flights import filtered, rms
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import HeadingAid, interval_measurement
from tirgeo_ros.core.navigation.ins.kalman import update
from tirgeo_ros.core.types.measurements import HeadingSample
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

STEP_DEG = 1.0
ROUNDING_DEG2 = STEP_DEG**2 / 12
FLOOR_DEG = EkfConfig().heading.sigma_floor_deg
#: Gives the whole filter's 0.08 deg with the default floor: sqrt(P) = sqrt(walk x noise).
WALK_DEG = 0.08**2 / FLOOR_DEG
RUNS, READINGS, SETTLED, LEG = 60, 500, 100, 50


class Heading(NamedTuple):
    """Of many scalar filters, settled."""

    rms_deg: float
    ratio: float  # of error over sigma, rms


def _filtered(sigma_deg: float, floor_deg: float, resolution_deg: float) -> Heading:
    """Scalar filters over the same readings; places between whole degrees are covered evenly."""
    rng = np.random.default_rng(round(1000 * sigma_deg))
    squares, ratios = [], []
    for run in range(RUNS):
        first = (run + 0.5) / RUNS
        turns = np.cumsum(rng.uniform(size=READINGS // LEG)) + first
        true = np.repeat(turns, LEG)
        readings = np.round(true + sigma_deg * rng.standard_normal(READINGS))
        walks = WALK_DEG * rng.standard_normal(READINGS)
        error, variance = 0.5 * rng.standard_normal(), 0.25
        for number in range(READINGS):
            error, variance = error + walks[number], variance + WALK_DEG**2
            off = readings[number] - true[number] - error
            noise = max(sigma_deg**2 + ROUNDING_DEG2, floor_deg**2)
            if resolution_deg:
                told = interval_measurement(off, variance, sigma_deg**2, resolution_deg)
                if told[0] ** 2 <= 16 * (variance + told[1]):  # the gate of Headings
                    off, noise = told
            gain = variance / (variance + noise)
            error, variance = error + gain * off, variance * (1 - gain)
            if number >= SETTLED:
                squares.append(error**2)
                ratios.append(error**2 / variance)
    return Heading(math.sqrt(np.mean(squares)), math.sqrt(np.mean(ratios)))


def test_at_the_usual_noise_an_interval_says_no_more_than_a_number():
    """That is why ``resolution_deg`` is 0 by default: noise of 0.4 deg rounds evenly by itself."""
    assert EkfConfig().heading.resolution_deg == 0
    plain = _filtered(0.4, FLOOR_DEG, 0.0)
    interval = _filtered(0.4, 0.0, STEP_DEG)
    # 60 runs of 80 s hold some 600 independent errors: each rms is known to 3 %, their ratio
    # better, being of the same data.
    assert interval.rms_deg == pytest.approx(plain.rms_deg, rel=0.06)
    assert 0.7 < plain.ratio < 1.3  # what is asked of error over sigma
    assert 0.7 < interval.ratio < 1.3


@pytest.mark.parametrize("sigma_deg", [0.05, 0.1])
def test_of_a_quiet_receiver_an_interval_beats_any_larger_noise(sigma_deg):
    """Its rounding stays the same along a leg, so readings may not be averaged at all."""
    interval = _filtered(sigma_deg, 0.0, STEP_DEG)
    assert 0.7 < interval.ratio < 1.3  # what is asked of error over sigma
    assert _filtered(sigma_deg, FLOOR_DEG, 0.0).ratio > 1.5  # a good library asserts 1.5
    for floor_deg in (0.0, FLOOR_DEG, 1.2, 2.4):
        # The rounding alone is up to half a degree, 0.29 deg rms; the interval finds its ends.
        assert interval.rms_deg < 0.8 * _filtered(sigma_deg, floor_deg, 0.0).rms_deg


@given(off=st.floats(-1.5, 1.5), predicted=st.floats(1e-2, 4.0), sigma=st.floats(0.1, 2.0))
def test_interval_leaves_the_moments_of_the_exact_posterior(off, predicted, sigma):
    """Against the sum over a fine grid of prior times likelihood."""
    innovation, noise = interval_measurement(off, predicted, sigma**2, STEP_DEG)
    x = np.linspace(-10, 10, 4001) * math.sqrt(predicted)
    root = math.sqrt(2) * sigma
    upper, lower = (off + side * STEP_DEG / 2 for side in (1, -1))
    erf = np.vectorize(math.erf)
    weight = np.exp(-0.5 * x * x / predicted) * (erf((upper - x) / root) - erf((lower - x) / root))
    mean = np.average(x, weights=weight)
    variance = np.average((x - mean) ** 2, weights=weight)
    gain = predicted / (predicted + noise)
    # Smooth and with both ends at zero, the sum is exact but for erf's differences (1e-16 / 1e-8).
    scale = math.sqrt(predicted)
    assert gain * innovation == pytest.approx(mean, abs=1e-6 * scale)
    assert (1 - gain) * predicted == pytest.approx(variance, abs=1e-6 * predicted)


def _aided(heading_deg: float, **values: float):
    config = ekf_config(**{f"heading__{key}": value for key, value in values.items()})
    covariance = np.eye(18) * math.radians(0.03) ** 2
    sample = HeadingSample(NOW_NS, math.radians(heading_deg), math.radians(0.05) ** 2)
    estimate = estimate_of(state_of(0.0, 0.0, 0.0), 18, covariance)
    aid = HeadingAid(config).measured(sample, estimate, ZERO)[0]
    return covariance, aid.measurement


def test_a_reading_whose_ends_are_far_away_says_nothing():
    covariance, measurement = _aided(0.1, sigma_floor_deg=0.05, resolution_deg=1.0)
    updated = update(covariance, measurement).covariance
    # The near end is 0.4 deg away, 6.9 of sqrt(0.03^2 + 0.05^2): density 2e-11 there.
    assert updated[2, 2] == pytest.approx(covariance[2, 2], rel=1e-8)
    covariance, measurement = _aided(0.1, sigma_floor_deg=0.05)
    updated = update(covariance, measurement).covariance
    assert updated[2, 2] == pytest.approx(covariance[2, 2] * 25 / 34, rel=1e-9)


@pytest.mark.parametrize("heading_deg", [0.95, 5.0])
def test_a_reading_that_contradicts_the_state_is_taken_as_a_number(heading_deg):
    """Of 0.95 deg the interval ends 7.7 sigma away, while it is 3.2 as a number; 5 is refused."""
    covariance, measurement = _aided(heading_deg, sigma_floor_deg=0.05, resolution_deg=1.0)
    assert math.degrees(measurement.innovation[0]) == pytest.approx(heading_deg)
    noise_deg2 = math.degrees(math.sqrt(measurement.noise[0, 0])) ** 2
    assert noise_deg2 == pytest.approx(0.05**2 + ROUNDING_DEG2)
    assert (update(covariance, measurement).error is None) == (heading_deg > 4 * 0.3)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["lawnmower", "hover"])
def test_no_heading_of_a_quiet_receiver_is_refused(shape):
    """In turns the rounding flips by up to a degree; on legs it is 0.4 deg, all the time."""
    values = {"route.shape": shape, "route.heading_deg": 20.4, "heading.sigma_deg": 0.05}
    flight = fly(scenario_from({**values, "duration_s": 50.0}), 3)
    assert flight.scenario.heading.step_deg == STEP_DEG
    found_deg = []
    for values in ({}, {"heading__resolution_deg": 1.0, "heading__sigma_floor_deg": 0.05}):
        found = filtered(flight, **values)
        counted = found.status.counts.items()
        counts = {o: n for (source, o), n in counted if source == "rtk_heading"}
        assert counts["used"] > 200  # 5 Hz, less the start
        assert not {"gated", "reset"} & set(counts)
        found_deg.append(math.degrees(rms(found.errors.after(20.0).rpy)[2]))
    assert found_deg[1] < 0.6 * found_deg[0]
