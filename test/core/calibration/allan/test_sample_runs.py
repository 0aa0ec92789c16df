"""Samples one after another: a slot for each, whatever their stamps shake."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.calibration.allan.sample_runs import SampleRuns
from tirgeo_ros.core.types.errors import CalibrationError

STEP_NS = 5_000_000


def given(size=4000, seed=1):
    rng = np.random.default_rng(seed)
    return np.arange(size, dtype=np.int64) * STEP_NS + 10**18, rng.standard_normal((size, 2))


def put(grid, stamps_ns, values, size=700):
    found = []
    for first in range(0, len(stamps_ns), size):
        found += grid.add(stamps_ns[first : first + size], values[first : first + size])
    return found


def test_even_stamps_are_as_they_are():
    stamps, values = given()
    grid = SampleRuns()
    found = put(grid, stamps, values)
    np.testing.assert_array_equal(np.concatenate([p.sums for p in found]), values)
    assert [p.fresh for p in found] == [True] + [False] * (len(found) - 1)
    assert grid.mean_step_ns == STEP_NS
    assert grid.jitter_ns == 0


def test_stamps_that_shake_by_half_a_step_have_a_slot_each():
    """6, 6, 8, 6, 9 ms in turns: a receiver's clock of whole milliseconds."""
    values = given()[1]
    steps = np.resize([6, 6, 8, 6, 9], len(values)) * 1_000_000
    grid = SampleRuns()
    found = put(grid, np.cumsum(steps) + 10**18, values)
    np.testing.assert_array_equal(np.concatenate([p.sums for p in found]), values)
    assert all((p.counts == 1).all() for p in found)
    assert grid.mean_step_ns == pytest.approx(7e6, rel=0.01)
    assert grid.jitter_ns == pytest.approx(np.std([6, 6, 8, 6, 9]) * 1e6, rel=0.05)


def test_lost_samples_leave_their_slots_empty():
    stamps, values = given()
    keep = np.ones(len(stamps), bool)
    keep[[100, 101, 102, 700, 1400, 3000]] = False
    grid = SampleRuns()
    found = put(grid, stamps[keep], values[keep])
    counts = np.concatenate([p.counts for p in found])
    np.testing.assert_array_equal(np.flatnonzero(counts == 0), np.flatnonzero(~keep))
    assert (grid.irregularities.missing, grid.irregularities.gaps) == (6, 4)


def test_too_few_tell_no_rate():
    stamps, values = given(50)
    with pytest.raises(CalibrationError, match="50 samples are too few to tell their rate"):
        put(SampleRuns(), stamps, values)
