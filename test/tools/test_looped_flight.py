"""A flight without end: nothing jumps where it begins again, and the filter does not grow."""

from __future__ import annotations

import itertools
import tracemalloc

import numpy as np
import pytest

from tirgeo_ros.core.attitude import euler_from_quat
from tirgeo_ros.core.navigation import Navigation
from tirgeo_ros.core.samples import ImuSample, Outcome, PositionSample, Source
from tirgeo_ros.tools.looped_flight import PERIOD_S, LoopedFlight

RATE_HZ = 50.0


@pytest.fixture(scope="module")
def looped():
    return LoopedFlight(RATE_HZ)


def first_minutes(looped, count):
    return list(itertools.islice(looped.minutes(), count))


def of_rtk(samples):
    return [s for s in samples if getattr(s, "source", None) is Source.RTK_POSITION]


def test_stamps_run_on_over_the_seam(looped):
    minutes = first_minutes(looped, 3)
    assert len({len(minute) for minute in minutes}) == 1
    samples = list(itertools.chain(*minutes))
    imu = [s.stamp_ns for s in samples if isinstance(s, ImuSample)]
    assert len(imu) == 3 * looped.imu_samples
    assert set(np.diff(imu)) == {round(1e9 / RATE_HZ)}
    fixes = [s.stamp_ns for s in of_rtk(samples)]
    assert set(np.diff(fixes)) == {200_000_000}


def test_the_aircraft_stands_as_it_stood_a_minute_ago(looped):
    """The autopilot's attitude is the true one here: over the seam no larger step than inside."""
    one = first_minutes(looped, 1)[0]
    attitudes = np.array([s.autopilot_q_nb for s in one if isinstance(s, ImuSample)])
    rpy = euler_from_quat(attitudes)
    assert np.degrees(np.ptp(rpy[:, 2])) > 80  # it does turn
    steps = np.abs(np.diff(rpy, axis=0)).max(axis=0)
    assert (np.abs(rpy[0] - rpy[-1]) <= steps + 1e-9).all()


def test_the_filter_sees_no_seam(looped):
    navigation = Navigation(looped.config)
    for minute in first_minutes(looped, 3):
        for sample in minute:
            step = navigation.process(sample)
            assert step.verdict.outcome not in {
                Outcome.GATED,
                Outcome.RESET,
                Outcome.RESTART,
                Outcome.GAP,
                Outcome.OUT_OF_ORDER,
                Outcome.TIME_JUMP,
            }, step.verdict
    assert navigation.status().state.value == "running"


def test_memory_does_not_grow_with_the_flight(looped):
    """The largest memory of the last half minute is that of the first, three minutes before.

    A leak of one small object (50 bytes) per IMU sample would be 375 kB by then, per RTK epoch
    37 kB. Without any, the largest memory depends on how epochs and the history's batches meet:
    by some kB.
    """
    samples = list(itertools.chain(*first_minutes(looped, 4)))
    size = len(samples) // 8
    navigation = Navigation(looped.config)
    _process(navigation, samples[:size])  # alignment, and what NumPy keeps from its first calls
    tracemalloc.start()
    try:
        peaks = [_peak_of(navigation, samples[k * size : (k + 1) * size]) for k in range(1, 7)]
    finally:
        tracemalloc.stop()
    assert peaks[-1] - peaks[0] < 12_000, peaks


def _process(navigation, samples):
    for sample in samples:
        navigation.process(sample)


def _peak_of(navigation, samples):
    """Largest memory while samples are processed; the samples themselves were there before."""
    tracemalloc.reset_peak()
    _process(navigation, samples)
    return tracemalloc.get_traced_memory()[1]


def test_a_minute_is_whole(looped):
    assert looped.imu_samples == PERIOD_S * RATE_HZ
    assert any(isinstance(s, PositionSample) for s in first_minutes(looped, 1)[0])
