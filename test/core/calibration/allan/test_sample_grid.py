"""Stamps of all kinds laid on a grid, with what was wrong counted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tirgeo_ros.core.calibration.allan.sample_blocks import SampleBlocks
from tirgeo_ros.core.calibration.allan.sample_grid import Piece, SampleGrid
from tirgeo_ros.core.types.errors import CalibrationError

STEP_NS = 10_000_000
START_NS = 1_700_000_000_000_000_000


def laid(stamps_ns, values=None, size=1000):
    grid = SampleGrid()
    stamps_ns = START_NS + np.asarray(stamps_ns, np.int64)
    values = np.arange(float(len(stamps_ns)))[:, None] if values is None else values
    found = []
    for begin in range(0, len(stamps_ns), size):
        end = begin + size
        found += grid.add(stamps_ns[begin:end], values[begin:end])
    return grid, found


def slots(pieces):
    return np.concatenate([piece.counts for piece in pieces])


def even(number):
    return np.arange(number) * STEP_NS


def test_even_stamps_fill_each_slot_once():
    grid, pieces = laid(even(2500))
    assert (slots(pieces) == 1).all()
    assert len(slots(pieces)) == 2500
    assert [piece.fresh for piece in pieces] == [True, False, False]
    starts = [0, 1000 * STEP_NS, 2000 * STEP_NS]
    assert [piece.start_ns for piece in pieces] == pytest.approx(starts, abs=10)
    assert np.concatenate([piece.sums for piece in pieces])[:, 0].tolist() == list(range(2500))
    assert grid.mean_step_ns == pytest.approx(STEP_NS, rel=1e-9)
    assert grid.jitter_ns < 1
    told = grid.irregularities
    assert (told.samples, told.gaps, told.missing, told.splits) == (2500, 0, 0, 0)


def test_a_gap_is_slots_without_samples():
    stamps = np.delete(even(3000), slice(1500, 1700))
    grid, pieces = laid(stamps)
    there = slots(pieces)
    assert len(there) == 3000
    assert not there[1500:1700].any()
    assert there.sum() == 2800
    assert (grid.irregularities.gaps, grid.irregularities.missing) == (1, 200)


def test_dropped_samples_are_told_and_leave_the_rate():
    keep = np.random.default_rng(1).random(20_000) > 0.1
    grid, pieces = laid(even(20_000)[keep])
    assert grid.mean_step_ns == pytest.approx(STEP_NS)
    assert grid.irregularities.missing == pytest.approx((~keep).sum(), abs=3)  # the ends
    assert slots(pieces).sum() == keep.sum()


def test_a_long_gap_splits():
    stamps = even(2000)
    stamps[1200:] += 60_000_000_000
    grid, pieces = laid(stamps)
    assert [piece.fresh for piece in pieces] == [True, False, True]
    assert grid.irregularities.splits == 1
    assert grid.irregularities.missing == 0
    assert pieces[2].start_ns == pytest.approx(1200 * STEP_NS + 60_000_000_000, abs=10)
    assert (slots(pieces) == 1).all()


def test_a_clock_that_goes_back_far_splits_and_goes_on():
    stamps = even(2000)
    stamps[1200:] -= 3_600_000_000_000
    grid, pieces = laid(stamps)
    assert grid.irregularities.splits == 1
    assert slots(pieces).sum() == 2000
    assert grid.irregularities.late == 0


def test_late_and_repeated_samples_are_left_out():
    stamps = even(1000)
    stamps[500] = stamps[499]
    stamps[700] = stamps[690]
    grid, pieces = laid(stamps)
    told = grid.irregularities
    assert (told.repeated, told.late, told.samples) == (1, 1, 998)
    assert told.gaps == told.missing == 2
    assert np.flatnonzero(slots(pieces) == 0).tolist() == [500, 700]


def test_what_is_not_finite_is_left_out():
    values = np.random.default_rng(2).standard_normal((1000, 6))
    values[300, 2], values[301, 5] = np.nan, np.inf
    grid, pieces = laid(even(1000), values)
    assert grid.irregularities.not_finite == 2
    assert all(np.isfinite(piece.sums).all() for piece in pieces)


def test_samples_equal_to_the_one_before_are_counted():
    values = np.repeat(np.arange(500.0), 2)[:, None]
    grid, _ = laid(even(1000), values, size=333)
    assert grid.irregularities.identical == 500


@settings(max_examples=30, deadline=None)
@given(
    jitter=st.floats(0, 0.3),
    rate_hz=st.floats(40, 500),
    unit_ns=st.sampled_from([1, 1000, 1_000_000]),
    seed=st.integers(0, 99),
)
def test_shaking_stamps_keep_every_sample_and_its_time(jitter, rate_hz, unit_ns, seed):
    """Stamps of any rate, rounded as clocks round them, with up to 0.3 of a step of jitter."""
    rng = np.random.default_rng(seed)
    step_ns = 1e9 / rate_hz
    shaken = np.arange(5000) * step_ns + rng.uniform(-jitter, jitter, 5000) * step_ns
    stamps = np.sort(np.round(shaken / unit_ns) * unit_ns).astype(np.int64)
    grid, pieces = laid(stamps)
    told = grid.irregularities
    assert told.samples + told.repeated == 5000
    assert slots(pieces).sum() == told.samples
    # Its length is that of the stamps, to the rounding and the jitter of the two ends.
    assert len(slots(pieces)) == pytest.approx(5000, abs=2 + 2 * unit_ns / step_ns)


def test_stamps_of_arrival_in_bursts():
    """Ten samples at a time, microseconds apart: slots sum them up, and the time is kept."""
    stamps = np.repeat(even(3000)[9::10], 10) + np.tile(np.arange(10) * 1000, 300)
    _, pieces = laid(stamps)
    assert slots(pieces).sum() == 3000
    assert len(slots(pieces)) == pytest.approx(3000, rel=0.02)


def test_two_samples_have_no_rate():
    with pytest.raises(
        CalibrationError, match="2 samples in one piece are too few to tell their rate"
    ):
        laid(even(2))


def test_blocks_go_across_pieces_but_not_across_breaks():
    def piece(start, number, *, fresh):
        values = np.arange(start, start + number, dtype=float)[:, None]
        return Piece(start * STEP_NS, fresh, values, np.ones(number))

    blocks = SampleBlocks(4, STEP_NS)
    found = [
        (start_s, sums[:, 0].tolist())
        for one in (
            piece(0, 6, fresh=True),
            piece(6, 3, fresh=False),
            piece(100, 5, fresh=True),
            piece(105, 4, fresh=False),
        )
        for start_s, sums, _ in blocks.add(one)
    ]
    assert [values[0] for _, values in found] == [0, 4, 100, 104]
    assert [start_s for start_s, _ in found] == pytest.approx([0, 0.04, 1.0, 1.04])
