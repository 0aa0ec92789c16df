"""A flight without end: nothing jumps or grows."""

from __future__ import annotations

import gc
import itertools
import sys
from types import FunctionType, ModuleType

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
    """All that the filter holds is as large, at its largest, in the third minute as in the first.

    A leak of one float (32 bytes with its place in a list) per RTK epoch would be 19 kB by then.
    Counters and stamps of a longer form are some hundred bytes; the history's length swings with
    the delays of the RTK, whose phase to the looks at it is not the same in each minute.
    """
    navigation = Navigation(looped.config)
    first, _, third = (_largest(navigation, minute) for minute in first_minutes(looped, 3))
    assert third - first < 4_000, (first, third)


def _largest(navigation, samples):
    """The most bytes reachable from the filter, of a look after every 23rd sample."""
    sizes = []
    for number, sample in enumerate(samples):
        navigation.process(sample)
        if number % 23 == 0:
            sizes.append(_reachable_bytes(navigation))
    return max(sizes)


def _reachable_bytes(root):
    """Sizes of an object and of all that it holds, without code.

    What the process as a whole takes says less: Python keeps freed tuples for later.
    """
    seen, stack, total = set(), [root], 0
    while stack:
        item = stack.pop()
        if id(item) in seen or isinstance(item, (type, ModuleType, FunctionType)):
            continue
        seen.add(id(item))
        total += sys.getsizeof(item)
        stack.extend(gc.get_referents(item))
    return total
