"""Bag time against real time, without ROS, on a clock that the waits turn."""

from __future__ import annotations

import threading

import pytest

from tirgeo_ros.nodes import bag_player as module
from tirgeo_ros.nodes.bag_player import PlayClock

MS = 1_000_000
START = 1_700_000_000_000_000_000


class TurnedTime(threading.Event):
    """Real time that passes in waits alone: a busy machine has no part in it."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 1000.0

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.now_s += max(timeout, 0.0)
        return self.is_set()


@pytest.fixture
def turned(monkeypatch):
    turned = TurnedTime()
    monkeypatch.setattr(module.time, "monotonic", lambda: turned.now_s)
    return turned


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_messages_are_due_at_the_rate(turned, rate):
    clock = PlayClock(rate, 100.0, lambda _: None)
    for k in range(5):
        assert clock.wait_until(START + k * 50 * MS, turned)
        assert turned.now_s - 1000.0 == pytest.approx(k * 0.05 / rate, abs=1e-9)


def test_ticks_go_on_between_messages_and_never_back(turned):
    ticks: list[int] = []
    clock = PlayClock(1.0, 100.0, ticks.append)
    assert clock.wait_until(START, turned)
    assert clock.wait_until(START + 300 * MS, turned)
    assert ticks == sorted(ticks)
    assert ticks[0] == START
    # A tick every 10 ms; the sums of floating numbers may leave the last one to the next message.
    assert len(ticks) in {30, 31}
    assert START + 289 * MS <= ticks[-1] <= START + 300 * MS


def test_a_stall_leaves_ticks_out_and_none_passes_the_message_that_is_due(turned):
    ticks: list[int] = []
    clock = PlayClock(1.0, 1000.0, ticks.append)
    clock.wait_until(START, turned)
    turned.now_s += 0.05  # the publisher stalls
    clock.wait_until(START + 10 * MS, turned)
    assert ticks == [START, START + 10 * MS]
