"""Bag time against real time, without ROS."""

from __future__ import annotations

import threading
import time

import pytest

from tirgeo_ros.nodes.play_clock import PlayClock

MS = 1_000_000
START = 1_700_000_000_000_000_000


def play(rate: float, tick_rate_hz: float, stamps_ns: list[int]) -> tuple[list[int], list[float]]:
    """Ticks, and real seconds from the first stamp to each."""
    ticks: list[int] = []
    clock = PlayClock(rate, tick_rate_hz, ticks.append)
    reached = []
    for stamp in stamps_ns:
        assert clock.wait_until(stamp, threading.Event())
        reached.append(time.monotonic())
    return ticks, [moment - reached[0] for moment in reached]


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_messages_are_due_at_the_rate(rate):
    stamps = [START + k * 50 * MS for k in range(5)]
    _, reached = play(rate, 100.0, stamps)
    for k, moment in enumerate(reached):
        assert moment >= k * 0.05 / rate - 1e-4  # never early, but for the first one's own delay
    assert reached[-1] < 0.2 / rate + 0.1  # a tenth of a second for a busy machine


def test_ticks_go_on_between_messages_and_never_back():
    ticks, _ = play(1.0, 100.0, [START, START + 300 * MS])
    assert ticks == sorted(ticks)
    assert ticks[0] == START
    assert ticks[-1] <= START + 300 * MS
    # 30 periods; a stall leaves ticks out, but never adds any.
    assert 20 <= len(ticks) <= 32


def test_a_tick_never_passes_the_message_that_is_due():
    ticks: list[int] = []
    clock = PlayClock(1.0, 1000.0, ticks.append)
    stop = threading.Event()
    clock.wait_until(START, stop)
    time.sleep(0.05)  # the publisher stalls
    clock.wait_until(START + 10 * MS, stop)
    assert max(ticks) <= START + 10 * MS


def test_a_stop_ends_the_wait():
    clock = PlayClock(1.0, 100.0, lambda _: None)
    stop = threading.Event()
    assert clock.wait_until(START, stop)
    threading.Timer(0.05, stop.set).start()
    begin = time.monotonic()
    assert not clock.wait_until(START + 10_000 * MS, stop)
    assert time.monotonic() - begin < 1.0
