"""A progress bar on a terminal, for work of more than two seconds."""

from __future__ import annotations

import math
import shutil
import sys
import time
from collections.abc import Callable
from typing import TextIO, final

#: What long work calls: how much is done, and of how much (None = unknown).
Report = Callable[[float, float | None], None]

_SHOW_AFTER_S = 2.0
_REDRAW_S = 0.1


def silent(_done: float, _total: float | None = None) -> None:
    """A Report for work that nobody watches."""


@final
class Progress:
    """A Report that draws one line on stderr if that is a terminal, and wipes it at the end.

    ``with Progress("processing", unit="s") as bar: process(..., progress=bar)``
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
        self._next_s = self._begun_s + _SHOW_AFTER_S if self._stream.isatty() else math.inf
        self._drawn = False

    def __call__(self, done: float, total: float | None = None) -> None:
        """Tell that ``done`` of ``total`` is done; cheap to call often."""
        now_s = self._clock()
        if now_s < self._next_s:
            return
        self._next_s = now_s + _REDRAW_S
        self._draw(self._line(done, total, now_s - self._begun_s))

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._drawn:
            self._draw("")

    def _draw(self, line: str) -> None:
        columns = shutil.get_terminal_size().columns
        try:
            self._stream.write(f"\r\x1b[K{line[: columns - 1]}")  # CSI K wipes the old line
            self._stream.flush()
        except OSError:  # the terminal is gone, the work goes on
            self._next_s, line = math.inf, ""
        self._drawn = bool(line)

    def _line(self, done: float, total: float | None, elapsed_s: float) -> str:
        rate = done / elapsed_s
        pace = f"{rate:.4g}{self._unit}/s"
        if not total:
            return f"{self._what}  {done:.6g}{self._unit}  {pace}"
        part = min(max(done / total, 0.0), 1.0)
        left = f"{_clock_text((total - done) / rate)} left" if rate > 0 else ""
        return (
            f"{self._what} {_bar(part)} {100 * part:3.0f} %  "
            f"{done:.6g} of {total:.6g}{self._unit}  {pace}  {left}"
        ).rstrip()


def _bar(part: float, width: int = 20) -> str:
    full = int(part * width)
    return "[" + "#" * full + "." * (width - full) + "]"


def _clock_text(seconds: float) -> str:
    minutes, rest = divmod(round(max(seconds, 0.0)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
