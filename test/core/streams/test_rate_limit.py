"""Which stamps are due at a rate."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.streams.rate_limit import RateLimit

MS = 1_000_000


def due(rate_hz: float, stamps: list[int]) -> list[int]:
    limit = RateLimit(rate_hz)
    return [stamp for stamp in stamps if limit.due(stamp)]


@pytest.mark.parametrize(("rate_hz", "expected"), [(100, 1000), (50, 500), (30, 300), (10, 100)])
def test_share_of_a_hundred_hertz(rate_hz, expected):
    jitter = np.random.default_rng(1).integers(-MS, MS, 1000)
    stamps = [10 * MS * k + int(jitter[k]) for k in range(1000)]
    assert len(due(rate_hz, stamps)) == pytest.approx(expected, abs=1)


def test_slow_inputs_are_all_due():
    stamps = [250 * MS * k for k in range(20)]
    assert due(10.0, stamps) == stamps


def test_schedule_begins_anew_after_a_pause_and_when_stamps_go_back():
    first = [10 * MS * k for k in range(50)]
    later = [5_000 * MS + stamp for stamp in first]
    found = due(10.0, [*first, *later, *first])
    # In each run of half a second: the first stamp, then one 80 ms on (the schedule's 100 ms less
    # the jitter that is let pass), then one each 100 ms.
    run = [0, 80 * MS, 180 * MS, 280 * MS, 380 * MS, 480 * MS]
    assert found == [*run, *(5_000 * MS + stamp for stamp in run), *run]
