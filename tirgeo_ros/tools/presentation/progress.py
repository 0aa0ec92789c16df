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
"""Draw a progress bar on a terminal, from the first message on."""

from __future__ import annotations

import math
import shutil
import sys
import time
from collections.abc import Callable
from typing import TextIO, final

#: Callback of long work: the amount done, and the total amount (None = unknown).
Report = Callable[[float, float | None], None]

_REDRAW_S = 0.1
_LEAST_S = 0.05  # a rate is computed over at least this time
_WIDTH = 20  # characters of the bar


def silent(_done: float, _total: float | None = None) -> None:
    """Ignore the progress; a Report for work without a display."""


@final
class Progress:
    """Draw one line on stderr if it is a terminal, and erase the line at the end; a Report.

    ``with Progress("processing", unit="s") as bar: process(..., progress=bar)``. With the unit "s"
    the rate is shown as a multiple of real time. Numbers have three digits.
    """

    def __init__(
        self,
        what: str,
        unit: str = "",
        *,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._what = what
        self._unit = f" {unit}" if unit else ""
        self._stream = sys.stderr if stream is None else stream
        self._clock = clock
        self._begun_s = clock()
        self._next_s = self._begun_s if self._stream.isatty() else math.inf
        self._drawn = False

    def __call__(self, done: float, total: float | None = None) -> None:
        """Show that ``done`` of ``total`` is done; cheap to call often."""
        now_s = self._clock()
        if now_s < self._next_s:
            return
        self._next_s = now_s + _REDRAW_S
        self._draw(self._line(done, total, max(now_s - self._begun_s, _LEAST_S)))

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._drawn:
            self._draw("")

    def _draw(self, line: str) -> None:
        columns = shutil.get_terminal_size().columns
        try:
            self._stream.write(f"\r\x1b[K{line[: columns - 1]}")  # CSI K erases the old line
            self._stream.flush()
        except OSError:  # the terminal is gone, but the work continues
            self._next_s, line = math.inf, ""
        self._drawn = bool(line)

    def _line(self, done: float, total: float | None, elapsed_s: float) -> str:
        rate = done / elapsed_s
        pace = (
            f"{three(rate)}x real time" if self._unit == " s" else f"{three(rate)}{self._unit}/s"
        )
        if not total:
            return f"{self._what}  {three(done)}{self._unit}  {pace}"
        part = min(max(done / total, 0.0), 1.0)
        full = int(part * _WIDTH)
        bar = "#" * full + "." * (_WIDTH - full)
        amount = f"{three(done)} of {three(total)}{self._unit}"
        line = f"{self._what} [{bar}] {three(100 * part):>4} %  {amount}  {pace}"
        if rate <= 0:
            return line
        minutes, seconds = divmod(round(max((total - done) / rate, 0.0)), 60)
        return f"{line}  {minutes}:{seconds:02d} left"


def three(value: float) -> str:
    """Return a number with three digits, or with all digits of its integer: 1.23, 12.3, 1234."""
    digits = next((n for n in (2, 1) if abs(round(value, n)) < 10 ** (3 - n)), 0)
    return f"{value:.{digits}f}"


def part(progress: Report, begin: float, end: float) -> Report:
    """Return a Report that converts the progress of a part to that of the whole."""
    share = end - begin
    return lambda done, total: progress(begin * (total or 0.0) + share * done, total)
