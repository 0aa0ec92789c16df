"""A flight without end: nothing jumps or grows."""

from __future__ import annotations

import gc
import itertools
import tracemalloc

import pytest

from dev.flights import LoopedFlight
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.types.verdicts import Outcome

RATE_HZ = 50.0


@pytest.fixture(scope="module")
def looped():
    return LoopedFlight(RATE_HZ)


def first_minutes(looped, count):
    return list(itertools.islice(looped.minutes(), count))


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.long
def test_memory_does_not_grow_with_the_flight(looped):
    """The most memory in use is as large in the third minute as in the first.

    A leak of one float (32 bytes with its place in a list) per RTK epoch would be 38 kB by then;
    temporary arrays and the history's length make 5 kB of difference.
    """
    navigation, minutes, peaks = Navigation(looped.config), first_minutes(looped, 3), []
    tracemalloc.start()
    for minute in minutes:
        gc.collect()
        tracemalloc.reset_peak()
        for sample in minute:
            navigation.process(sample)
        peaks.append(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    assert peaks[2] - peaks[0] < 15_000, peaks
