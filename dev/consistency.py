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
"""Compare the filter's errors with its own sigmas over 60 simulated flights: ``make consistency``.

Prints the rms errors for each shape of flight and IMU rate beside the required figures, then three
measures of consistency, as in Bar-Shalom, Li and Kirubarajan, Estimation with Applications to
Tracking and Navigation, section 5.4:

error over sigma
    By state; its rms over time and flights is 1 for a consistent filter.
NEES
    The normalised estimation error squared, ``e^T P^-1 e`` of the nine states together. Errors of
    one flight are correlated over tens of seconds (biases are learned once), so each flight gives
    one value, at its end. Flights have no random number in common, so N flights give N times 9
    degrees of freedom.
NIS
    The normalised innovation squared of every measurement that reached a gate. The innovations
    of a consistent filter are independent of each other, so each counts.

If a figure is missed, it is marked and the exit code is 1.
"""

from __future__ import annotations

import argparse
import math
import operator
import os
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dev.flight_errors import (
    STATE_NAMES,
    Squares,
    errors,
    fitting_config,
    navigation_samples,
    rms_of,
)
from dev.judging import MarkedTable, exit_code, in_processes, print_report
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.ins.kalman import chi_square_limit
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.measurements import HeadingSample, NavigationInput, Source
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import Outcome, Verdict
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import SHAPES, scenario_from

#: Errors count from here on, when the filter has learned its biases.
SETTLED_S = 20.0
_FIRST_HEADING_DEG = 20.0
#: Headings are reported in whole degrees, and their error depends on the fraction of a degree of
#: the true one. The first headings of the flights therefore cover a degree evenly.
_GOLDEN = 0.5 * (math.sqrt(5) - 1)
_END_NS = 100_000_000
_JUDGED = (Outcome.USED, Outcome.GATED)
_SOURCES = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)


@dataclass(frozen=True)
class Case:
    """Hold the settings of one flight."""

    shape: str
    imu_rate_hz: float
    seed: int
    duration_s: float = 107.0


class Nis(NamedTuple):
    """Hold sums over the measurements of one source."""

    squares: float = 0.0  # normalised innovations
    expected: float = 0.0  # of the squares, for the measurements' true noise
    degrees: int = 0  # of freedom

    @property
    def ratio(self) -> float:
        """Return the squares over their expectation: 1 for a consistent filter."""
        return self.squares / self.expected


def summed(a: Nis, b: Nis) -> Nis:
    """Return the sums of both."""
    return Nis(*map(operator.add, a, b))


@dataclass(frozen=True)
class Flown:
    """Hold the results of one flight, later than SETTLED_S."""

    case: Case
    squares: Squares
    nees: float  # at the end
    nis: dict[Source, Nis]


def cases(seeds: int, rates_hz: Sequence[float], duration_s: float) -> list[Case]:
    """Return ``seeds`` flights of each shape and IMU rate, no two with the same random numbers."""
    kinds = [(shape, rate_hz) for rate_hz in rates_hz for shape in SHAPES]
    return [
        Case(*kind, 1 + seeds * number + k, duration_s)
        for number, kind in enumerate(kinds)
        for k in range(seeds)
    ]


def fly_case(case: Case, **values: object) -> Flown:
    """Fly one case, with the filter's defaults but for ``values`` (``rtk__delay_s=0.1``).

    Raises TirgeoError if the filter has no solution at the end.
    """
    flight = flight_of(case)
    config = fitting_config(flight, **values)
    solutions, nis = _filtered(config, navigation_samples(flight), flight.scenario.start_ns)
    if not solutions or solutions[-1].stamp_ns < flight.truth.stamp_ns[-1] - _END_NS:
        raise TirgeoError(
            f"{case.shape}, {case.imu_rate_hz:g} Hz, seed {case.seed}: the filter has no "
            "solution at the end of the flight"
        )
    every = errors(flight, solutions)
    last = every.state[-1]
    nees = float(last @ np.linalg.solve(solutions[-1].covariance, last))
    return Flown(case, Squares.of(every, SETTLED_S), nees, nis)


def flight_of(case: Case) -> SimulatedFlight:
    """Return the flight of a case."""
    return fly(
        scenario_from(
            {
                "route.shape": case.shape,
                "route.heading_deg": _FIRST_HEADING_DEG + case.seed * _GOLDEN % 1.0,
                "imu.rate_hz": case.imu_rate_hz,
                "duration_s": case.duration_s,
            }
        ),
        case.seed,
    )


def _filtered(
    config: EkfConfig, samples: Iterable[NavigationInput], start_ns: int
) -> tuple[list[NavSolution], dict[Source, Nis]]:
    navigation = Navigation(config)
    solutions: list[NavSolution] = []
    nis: defaultdict[Source, Nis] = defaultdict(Nis)
    settled_ns = start_ns + round(SETTLED_S * 1e9)
    for sample in samples:
        verdict, solution = (step := navigation.process(sample)).verdict, step.solution
        if solution is not None:
            solutions.append(solution)
        judged = verdict.outcome in _JUDGED and verdict.source in _SOURCES
        if judged and sample.stamp_ns > settled_ns:
            sums = _nis(config, sample, verdict, solutions[-1])
            nis[verdict.source] = summed(nis[verdict.source], sums)
    return solutions, dict(nis)


def _nis(config: EkfConfig, sample: NavigationInput, verdict: Verdict, newest: NavSolution) -> Nis:
    """Return one measurement's NIS; its test ratio is the NIS over the gate's limit."""
    degrees = len(verdict.innovation)
    if not isinstance(sample, HeadingSample):
        squares = verdict.test_ratio * chi_square_limit(config.rtk.gate_sigma, degrees)
        return Nis(squares, degrees, degrees)
    squares = verdict.test_ratio * chi_square_limit(config.heading.gate_sigma, degrees)
    # The floor is above the true noise, so less than 1 is expected.
    predicted = newest.covariance[5, 5]
    believed = max(sample.variance_rad2, math.radians(config.heading.sigma_floor_deg) ** 2)
    return Nis(squares, (predicted + sample.variance_rad2) / (predicted + believed), degrees)


def pooled_nis(flown: Iterable[Flown]) -> dict[Source, Nis]:
    """Return sums over flights, by source."""
    total: dict[Source, Nis] = {}
    for each in flown:
        for source, nis in each.nis.items():
            total[source] = summed(total.get(source, Nis()), nis)
    return total


def chi_square_bounds(degrees: int, sigma: float = 3.29) -> tuple[float, float]:
    """Return the bounds of 99.9 % (3.29 sigma) of a chi-square variable over its degrees.

    By Wilson and Hilferty's cube root, good to 1 % of the interval from 30 degrees on.
    """
    spread = 2 / (9 * degrees)
    low, high = (1 - spread + side * sigma * math.sqrt(spread) for side in (-1, 1))
    return low**3, high**3


#: Largest rms over ten flights: roll, pitch, heading in deg; position in cm, by axis.
ASKED_ERRORS = (0.10, 0.10, 0.08, 1.2, 1.2, 1.2)
#: Lowest and highest rms of error over sigma, by state.
ASKED_RATIO = (0.7, 1.3)


def groups(flown: Sequence[Flown]) -> dict[str, list[Flown]]:
    """Return flights by shape and IMU rate, in their order."""
    named: dict[str, list[Flown]] = {}
    for each in flown:
        name = f"{each.case.shape}, {each.case.imu_rate_hz:g} Hz"
        named.setdefault(name, []).append(each)
    return named


def report(flown: Sequence[Flown]) -> tuple[list[str], int]:
    """Return the lines of the report and the number of missed figures."""
    table = MarkedTable(26, 9)
    low, high = ASKED_RATIO
    lines = [f"rms error later than {SETTLED_S:g} s"]
    lines += error_head(table, "asked, at the most", ASKED_ERRORS)
    lines += [
        error_row(table, name, [flight.squares for flight in flights], ASKED_ERRORS)
        for name, flights in groups(flown).items()
    ]
    lines += ["", f"error over sigma, rms (asked: {low:g} to {high:g})", ratio_head(table)]
    squares = [flight.squares for flight in flown]
    lines += [ratio_row(table, "all flights", squares, ASKED_RATIO), "", *_distances(table, flown)]
    return lines, table.missed


def error_head(table: MarkedTable, name: str, limits: Sequence[float]) -> Iterator[str]:
    """Yield the head above rows of errors, and a named row of their limits."""
    yield table.row("", ["roll", "pitch", "heading", "north", "east", "down"])
    yield table.row("", ["deg"] * 3 + ["cm"] * 3)
    yield table.row(name, [f"{limit:.3f} " for limit in limits])


def error_row(
    table: MarkedTable, name: str, flights: Sequence[Squares], limits: Sequence[float]
) -> str:
    """Return the rms errors over flights, marked above their limits."""
    values = [*np.degrees(rms_of(flights, "rpy")), *(100 * rms_of(flights, "position"))]
    cells = zip(values, limits, strict=True)
    return table.row(name, [table.cell(value, high=limit, digits=3) for value, limit in cells])


def ratio_head(table: MarkedTable) -> str:
    """Return the head above rows of error over sigma: three letters, and one of the axis."""
    names = map(str.split, STATE_NAMES)
    return table.row("", [f"{quantity[:3]} {axis[0].upper()} " for quantity, axis in names])


def ratio_row(
    table: MarkedTable, name: str, flights: Sequence[Squares], bounds: tuple[float, float]
) -> str:
    """Return error over sigma by state, marked outside of the bounds."""
    return table.row(name, [table.cell(value, *bounds) for value in rms_of(flights, "ratio")])


def _distances(table: MarkedTable, flown: Sequence[Flown]) -> Iterator[str]:
    yield "normalised squares over their degrees of freedom, with bounds of 99.9 %"
    yield table.row("", ["value", "low", "high", "degrees"])
    degrees = len(STATE_NAMES) * len(flown)
    rows = {"NEES, one per flight": (sum(each.nees for each in flown) / degrees, degrees)}
    for source, nis in sorted(pooled_nis(flown).items(), key=lambda item: item[0].value):
        rows[f"NIS {source.value}"] = nis.ratio, nis.degrees
    for name, (value, degrees) in rows.items():
        low, high = chi_square_bounds(degrees)
        cells = [table.cell(value, low, high, 3), f"{low:.3f} ", f"{high:.3f} ", str(degrees)]
        yield table.row(name, cells)


def main(argv: Sequence[str] | None = None) -> int:
    """Fly all cases and print the report."""
    parser = argparse.ArgumentParser(prog="python -m dev.consistency")
    parser.add_argument("--seeds", type=int, default=10, help="flights of each shape and rate")
    parser.add_argument("--duration", type=float, default=107.0, metavar="S", help="of a flight")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    args = parser.parse_args(argv)
    if args.seeds < 1 or args.workers < 1 or args.duration <= SETTLED_S:
        parser.error(f"at least one seed and one worker, and more than {SETTLED_S:g} s")

    def run() -> int:
        planned = cases(args.seeds, (100.0, 400.0), args.duration)
        with Progress("flying", "flights") as bar:
            flown = in_processes(fly_case, planned, args.workers, bar)
        lines, missed = report(flown)
        return print_report([f"{len(flown)} flights of {args.duration:g} s", "", *lines], missed)

    return exit_code("consistency", run)


if __name__ == "__main__":
    sys.exit(main())
