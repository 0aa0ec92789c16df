# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""The progress bar: only on a terminal, from the first message on, erased at the end."""

from __future__ import annotations

import contextlib
import io
import os

from tirgeo_ros.tools.presentation.progress import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


def made(stream):
    clock = Clock()
    return Progress("reading", "s", stream=stream, clock=clock), clock


def test_part_rate_and_time_left(monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    stream = Terminal()
    bar, clock = made(stream)
    clock.now_s += 4
    bar(20, 80)  # 5 a second, so 60 more take 12 s
    assert stream.getvalue() == (
        "\r\x1b[Kreading [#####...............] 25.0 %  20.0 of 80.0 s  5.00x real time  0:12 left"
    )


def test_the_line_is_redrawn_ten_times_a_second_at_most_fits_and_is_wiped(monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    stream, silent = Terminal(), io.StringIO()
    (bar, clock), (quiet, _) = made(stream), made(silent)
    with bar, quiet:
        for done in range(100):
            clock.now_s += 0.01
            bar(done, 1e9)
            quiet(done, 1e9)
        lines = stream.getvalue().split("\r\x1b[K")[1:]
        assert 9 <= len(lines) <= 11
        assert {len(line) for line in lines} == {29}
    assert stream.getvalue().endswith("\r\x1b[K")
    assert not silent.getvalue()  # no terminal


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
