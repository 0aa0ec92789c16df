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
"""Judge figures: measure in several processes, print tables, and mark what is missed."""

from __future__ import annotations

import math
import multiprocessing
import operator
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.tools.cli.main import INTERRUPTED
from tirgeo_ros.tools.presentation.progress import Report, silent

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

_COMPARED = {">=": operator.ge, "<=": operator.le, "=": operator.eq}


def in_processes(
    work: Callable[[_Job], _Result],
    jobs: Sequence[_Job],
    workers: int,
    progress: Report = silent,
) -> list[_Result]:
    """Return the results of jobs, in their order, from ``workers`` processes."""
    # A forked child would inherit locks that other threads hold, of OpenCV for one.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        futures = [pool.submit(work, job) for job in jobs]
        for done, _ in enumerate(as_completed(futures), 1):
            progress(done, len(jobs))
        return [future.result() for future in futures]


class Figure(NamedTuple):
    """Hold one line of a table; ``wanted`` is what is asked, as ``>= 6``, ``<= 4`` or ``= 0``."""

    what: str
    value: float
    unit: str = ""
    wanted: str = ""

    @property
    def missed(self) -> bool:
        """Return whether it is not as asked; what is not a number is not."""
        sign, _, limit = self.wanted.partition(" ")
        return sign in _COMPARED and not _COMPARED[sign](self.value, float(limit))

    @property
    def line(self) -> str:
        """Return the line."""
        digits = 0 if float(self.value).is_integer() else 2 if self.value >= 1 else 3
        text = f"{self.what:<64}{self.value:>10.{digits}f}  {self.unit:<12}{self.wanted}"
        return text.rstrip() + (" !" if self.missed else "")


def print_figures(figures: Iterable[Figure]) -> list[Figure]:
    """Print each figure when it is there, the missed ones marked; return all."""
    printed = []
    for figure in figures:
        printed.append(figure)
        sys.stdout.write(f"{figure.line}\n")
        sys.stdout.flush()
    return printed


def percentile(values: npt.ArrayLike, share: float) -> float:
    """Return a percentile (``share`` in percent), nan of nothing."""
    every = np.asarray(values, float)
    return float(np.percentile(every, share)) if every.size else math.nan


def exit_code(name: str, work: Callable[[], int]) -> int:
    """Return the exit code of a command's work; what it raises becomes a line and a code."""
    try:
        return work()
    except (TirgeoError, OSError) as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 1
    except KeyboardInterrupt:
        sys.stderr.write(f"{name}: interrupted\n")
        return INTERRUPTED


class MarkedTable:
    """Make lines of text, and count how many of their figures are missed."""

    def __init__(self, name_width: int, cell_width: int) -> None:
        self.missed = 0
        self._widths = name_width, cell_width

    def row(self, name: str, cells: Sequence[object]) -> str:
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


def print_report(lines: Iterable[str], missed: int) -> int:
    """Print lines, then how many figures are missed; return the exit code."""
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    if missed:
        sys.stdout.write(f"{missed} figures are missed: marked with !\n")
    return 1 if missed else 0
