"""Whether the broadcast counts milliseconds or ticks of 2.5 ms."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.config.dji import DjiClockConfig
from tirgeo_ros.dji.clocks.aircraft_clock import AircraftClock
from tirgeo_ros.dji.clocks.tick_clock import TickClock

NOW_NS = 1_800_000_000_000_000_000
MS = 1_000_000
CONFIG = DjiClockConfig()


def clock():
    return TickClock(lambda tick_ns: AircraftClock(CONFIG, tick_ns))


def errors_ms(clock, ticks_a_ms, first, duration_s=10.0, latency=lambda _: 2.0):
    """Stamps less true times (ms), 100 a second."""
    found = []
    for k in range(int(duration_s * 100)):
        arrival_ns = NOW_NS + round((10 * k + latency(k)) * MS)
        ticks = (first + int(10 * k * ticks_a_ms)) % 2**32
        found.append((clock.stamp_ns(ticks, arrival_ns) - NOW_NS) / MS - 10 * k)
    return np.array(found)


@pytest.mark.parametrize("first", [7000, 2**32 - 1000, 2**32 - 10])
def test_ticks_of_2_5_ms_are_seen_within_a_second(first):
    ticking = clock()
    errors = errors_ms(ticking, 0.4, first)
    assert np.abs(errors[101:] - 2.0).max() < 0.1  # the latency cannot be seen
    assert errors.min() > -0.6 * 1000 - 1
    assert ticking.diagnostics["clock tick [ms]"] == "2.5"


def test_milliseconds_are_those_of_the_clock_itself():
    """Jitter, a burst at the start, a pause: the same stamps as without looking."""
    rng = np.random.default_rng(5)
    queue = [300.0 - 10 * k if k < 30 else 0.0 for k in range(1000)]
    late = [2.0 + queue[k] + rng.exponential(4.0) for k in range(1000)]
    looking, plain = clock(), AircraftClock(CONFIG)
    found = errors_ms(looking, 1.0, 5000, latency=late.__getitem__)
    assert found.tolist() == errors_ms(plain, 1.0, 5000, latency=late.__getitem__).tolist()
    assert "clock tick [ms]" not in looking.diagnostics


def test_one_look_alone_decides_nothing():
    """A host that halts for 0.75 s while the counter runs 0.5 s looks like long ticks, once."""
    looking = clock()
    for at_ms, count in [(0, 0), (1250, 500), (1260, 510), (1800, 1050), (2400, 1650)]:
        looking.stamp_ns(count, NOW_NS + at_ms * MS)
    assert "clock tick [ms]" not in looking.diagnostics
