"""Measure in several processes, and lay figures out in tables that mark what is missed."""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import NamedTuple, TypeVar

from tirgeo_ros.io.files.child_process import safe_workers
from tirgeo_ros.tools.presentation.progress import Report, silent

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


def in_processes(
    work: Callable[[_Job], _Result],
    jobs: Sequence[_Job],
    workers: int,
    progress: Report = silent,
) -> list[_Result]:
    """Return the results of jobs, in their order, from ``workers`` processes."""
    # A forked child would inherit locks that other threads hold, of OpenCV for one.
    context = multiprocessing.get_context("spawn")
    with safe_workers(), ProcessPoolExecutor(workers, mp_context=context) as pool:
        futures = [pool.submit(work, job) for job in jobs]
        for done, _ in enumerate(as_completed(futures), 1):
            progress(done, len(jobs))
        return [future.result() for future in futures]


class MarkedTable:
    """Make lines of text, and count how many of their figures are missed."""

    def __init__(self, name_width: int, cell_width: int) -> None:
        self.missed = 0
        self._widths = name_width, cell_width

    def row(self, name: str, cells: Sequence[str]) -> str:
        """Return a line."""
        wide, narrow = self._widths
        return (f"{name:<{wide}}" + "".join(f"{cell:>{narrow}}" for cell in cells)).rstrip()

    def cell(
        self, value: float, low: float = -math.inf, high: float = math.inf, digits: int = 2
    ) -> str:
        """Return a value, marked if it is not from ``low`` to ``high``; an absent one is ``-``.

        What is absent is missed where something is asked of it.
        """
        good = low <= value <= high or (math.isnan(value) and -low == high == math.inf)
        self.missed += not good
        text = "-" if math.isnan(value) else "none" if math.isinf(value) else f"{value:.{digits}f}"
        return text + (" " if good else "!")


class Figure(NamedTuple):
    """Hold one line of the table."""

    what: str
    value: float
    unit: str
    wanted: str = ""


def line(figure: Figure) -> str:
    """Return one line of the table."""
    digits = 2 if figure.value >= 1 else 3
    return f"{figure.what:<44}{figure.value:>9.{digits}f}  {figure.unit:<12}{figure.wanted}"
