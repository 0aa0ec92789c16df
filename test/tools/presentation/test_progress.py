"""The progress bar: silent where nobody looks, there from the first message, gone at the end."""

from __future__ import annotations

import contextlib
import io
import os

import pytest

from tirgeo_ros.tools.presentation.progress import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")


def made(stream, unit="s"):
    clock = Clock()
    return Progress("reading", unit, stream=stream, clock=clock), clock


def test_nothing_is_drawn_where_there_is_no_terminal():
    stream = io.StringIO()
    bar, clock = made(stream)
    with bar:
        clock.now_s += 60
        bar(5, 10)
    assert not stream.getvalue()


def test_part_rate_and_time_left():
    stream = Terminal()
    bar, clock = made(stream)
    clock.now_s += 4
    bar(20, 80)  # 5 a second, so 60 more take 12 s
    assert stream.getvalue() == (
        "\r\x1b[Kreading [#####...............] 25.0 %  20.0 of 80.0 s  5.00x real time  0:12 left"
    )


def test_the_line_is_redrawn_ten_times_a_second_at_most():
    stream = Terminal()
    bar, clock = made(stream)
    clock.now_s += 3
    for done in range(100):
        clock.now_s += 0.01
        bar(done, 100)
    assert 9 <= stream.getvalue().count("\r") <= 11


def test_the_line_fits_and_is_wiped(monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    stream = Terminal()
    bar, clock = made(stream)
    with bar:
        clock.now_s += 4
        bar(7200, 1e9)
        assert len(stream.getvalue().removeprefix("\r\x1b[K")) == 29
    assert stream.getvalue().endswith("\r\x1b[K")


def test_a_terminal_that_is_gone_does_not_end_the_work():
    """As a lost connection leaves it: every write fails."""
    master, slave = os.openpty()
    stream = os.fdopen(slave, "w")  # no context: closing it fails too
    bar, clock = made(stream)
    with bar:
        clock.now_s += 3
        os.close(master)
        bar(5, 10)
        clock.now_s += 3
        bar(6, 10)
    with contextlib.suppress(OSError):
        stream.close()
