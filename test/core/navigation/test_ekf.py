"""The filter over simulated flights: accuracy, consistency, gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flights import (
    NAVIGATION_SAMPLES,
    config_for,
    errors,
    flight,
    navigation_samples,
    rms,
    solutions,
)

from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    PressureSample,
    VelocitySample,
)
from tirgeo_ros.tools.simulate.flight import fly


def test_paper_flight_after_20_s():
    """The figures that the method is held to: 0.12 deg and 2 cm."""
    flown = flight()
    late = errors(flown, solutions(flown, config_for(flown))).after(20.0)
    assert np.degrees(rms(late.rpy)).max() <= 0.12
    assert rms(late.state[:, :3]).max() <= 0.02


@pytest.mark.slow
def test_direct_position_flies_too():
    """The paper's own cycle, with its median filter: within the RTK's noise in position."""
    flown = flight()
    config = config_for(flown, position_update="rtk_direct", rtk__median_window=3)
    late = errors(flown, solutions(flown, config)).after(20.0)
    assert np.degrees(rms(late.rpy)).max() <= 0.12
    assert (rms(late.state[:, :3]) <= 1.5 * np.array([0.01, 0.01, 0.02])).all()


@pytest.mark.slow
def test_heading_is_worth_three_times():
    flown = flight()
    with_heading = errors(flown, solutions(flown, config_for(flown))).after(20.0)
    without = errors(flown, solutions(flown, config_for(flown, method="ekf"))).after(20.0)
    assert rms(without.rpy)[2] >= 3 * rms(with_heading.rpy)[2]


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [50.0, 400.0])
def test_other_imu_rates(rate_hz):
    base = flight(duration_s=40.0).scenario
    flown = fly(replace(base, imu=replace(base.imu, rate_hz=rate_hz)), 3)
    late = errors(flown, solutions(flown, config_for(flown))).after(20.0)
    assert np.degrees(rms(late.rpy)).max() <= 0.15  # a short flight: fewer turns to learn from
    assert rms(late.state[:, :3]).max() <= 0.02


def test_angular_rate_is_within_its_own_sigma():
    """The rate's variance: white noise of one sample and the bias's; per axis over a flight."""
    flown = flight(duration_s=40.0)
    index = {stamp: i for i, stamp in enumerate(flown.truth.stamp_ns)}
    found = [s for s in solutions(flown, config_for(flown)) if index[s.stamp_ns] > 2000]
    error = [s.angular_rate_b - flown.truth.angular_rate_b[index[s.stamp_ns]] for s in found]
    ratio = rms(np.array(error) / np.sqrt([s.rate_variance_b for s in found]))
    # 2000 white samples: 1.6 % one sigma; the slow bias adds little beside the white noise.
    assert ratio == pytest.approx([1.0] * 3, abs=0.08)


def test_lost_heading_and_gap_start_again():
    """A gap beyond max_imu_gap_s is named, and the filter aligns anew."""
    flown = flight(duration_s=12.0)
    samples = navigation_samples(flown)
    start = samples[0].stamp_ns
    gap = [s for s in samples if not 5.0 < (s.stamp_ns - start) * 1e-9 < 6.0]
    navigation = Navigation(config_for(flown))
    for sample in gap:
        navigation.process(sample)
    counts = navigation.status().counts
    assert counts["imu", "gap"] == 1
    late = errors(flown, solutions(flown, config_for(flown), gap)).after(9.0)
    assert np.degrees(rms(late.rpy)).max() < 1.0


def test_bridged_gap_keeps_the_state():
    flown = flight(duration_s=12.0)
    samples = navigation_samples(flown)
    start = samples[0].stamp_ns
    gap = [
        s
        for s in samples
        if not (isinstance(s, ImuSample) and 5.0 < (s.stamp_ns - start) * 1e-9 < 5.15)
    ]
    navigation = Navigation(config_for(flown))
    for sample in gap:
        navigation.process(sample)
    assert ("imu", "gap") not in navigation.status().counts
    late = errors(flown, solutions(flown, config_for(flown), gap)).after(9.0)
    assert np.degrees(rms(late.rpy)).max() < 0.5


def test_only_these_samples_are_for_the_filter():
    flown = {type(s) for s in navigation_samples(flight())}  # without a barometer
    assert flown == set(NAVIGATION_SAMPLES) - {PressureSample}
    assert {HeadingSample, VelocitySample} <= set(NAVIGATION_SAMPLES)
