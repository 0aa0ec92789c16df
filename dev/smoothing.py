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
"""Compare the smoother with the filter: ``make smoothing``.

Prints errors over seeded flights of three shapes, over outages of RTK, and at fixes that are
hidden from recorded flights, the smoother's beside the required figures. If a figure is missed,
it is marked and the exit code is 1.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dev.consistency import (
    SETTLED_S,
    Case,
    cases,
    error_head,
    error_row,
    flight_of,
    ratio_head,
    ratio_row,
)
from dev.flight_errors import (
    Squares,
    errors,
    fitting_config,
    navigation_samples,
    published,
    rms_of,
)
from dev.judging import MarkedTable, exit_code, in_processes, print_report
from dev.real_flights import CUT_S, Miss, bags_in, config_of, hidden_fixes, median, samples_of
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import smoothed
from tirgeo_ros.core.types.measurements import NavigationInput, Source
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import Scenario

KINDS = FILTER, SMOOTHER = "filter", "smoother"
#: Before the end of a flight a smoother, too, has measurements from one side only.
END_S = 10.0
#: Twelve seconds without RTK's position, velocity and heading; ordinary GPS goes on.
LOST_S, FOUND_S, OUTAGE_FLIGHT_S = 22.0, 34.0, 50.0
_RTK = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)


@dataclass(frozen=True)
class Pair:
    """Hold a flight's errors under both."""

    case: Case
    whole: dict[str, Squares]  # later than SETTLED_S
    inner: dict[str, Squares]  # the same up to END_S before the end


def fly_pair(case: Case) -> Pair:
    """Fly one case with the defaults."""
    flight = flight_of(case)
    samples, inner_s = navigation_samples(flight), (SETTLED_S, case.duration_s - END_S)
    whole, inner = both(flight, samples, (SETTLED_S, math.inf), inner_s)
    return Pair(case, whole, inner)


def both(
    flight: SimulatedFlight, samples: Sequence[NavigationInput], *spans_s: tuple[float, float]
) -> list[dict[str, Squares]]:
    """Return the errors of the filter and of the smoother in each span of time."""
    config = fitting_config(flight)
    by_kind = {
        FILTER: errors(flight, published(Navigation(config), samples)),
        SMOOTHER: errors(flight, published(smoothed(config, samples), samples)),
    }
    return [
        {kind: Squares.of(every, *span) for kind, every in by_kind.items()} for span in spans_s
    ]


def outage_flight(seed: int) -> SimulatedFlight:
    """Return a flight of legs of 85 m and turns of 7.5 m radius, all at 4 m/s."""
    base = Scenario()
    route = replace(
        base.route,
        speed_m_s=4.0,
        acceleration_m_s2=2.5,  # 4 m/s in a turn of 7.5 m take 2.1
        turn_radius_m=7.5,
        leg_length_m=85.0,
    )
    return fly(replace(base, duration_s=OUTAGE_FLIGHT_S, route=route), seed)


def fly_outage(seed: int) -> dict[str, Squares]:
    """Return the errors of a seeded flight while RTK is lost, from LOST_S to FOUND_S."""
    flight = outage_flight(seed)
    start_ns = flight.truth.stamp_ns[0]
    samples = [
        sample
        for sample in navigation_samples(flight)
        if sample.source not in _RTK or not LOST_S <= (sample.stamp_ns - start_ns) * 1e-9 < FOUND_S
    ]
    return both(flight, samples, (LOST_S, FOUND_S))[0]


def fly_hidden(path: Path) -> dict[str, list[Miss]]:
    """Return a recorded flight's errors at the last fix of each time for which RTK is hidden."""
    samples = samples_of(path)
    config = config_of(samples, {})
    return {
        kind: [misses[-1] for misses in hidden_fixes(config, samples, smooth=kind == SMOOTHER)]
        for kind in KINDS
    }


#: Largest rms of the smoother: roll, pitch, heading in deg; position by axis in cm.
ASKED_ERRORS = (0.025, 0.025, 0.035, 0.6, 0.6, 0.6)
ASKED_RATIO = (0.8, 1.25)
#: In an outage: distance in m, heading in deg.
ASKED_OUTAGE = (0.06, 0.08)
#: At hidden fixes: median distance in m, share within 3 sigma.
ASKED_HIDDEN_M, ASKED_WITHIN = 0.5, 0.9
_NOTHING = (math.inf,) * 6


def shapes(table: MarkedTable, pairs: Sequence[Pair]) -> Iterator[str]:
    """Yield the errors over the flights of three shapes."""
    yield f"rms error later than {SETTLED_S:g} s, and up to {END_S:g} s before the end"
    yield from error_head(table, "asked of the smoother", ASKED_ERRORS)
    for kind, asked in ((FILTER, _NOTHING), (SMOOTHER, ASKED_ERRORS)):
        yield error_row(table, kind, [pair.inner[kind] for pair in pairs], asked)
    for kind in KINDS:
        squares = [pair.whole[kind] for pair in pairs]
        yield error_row(table, f"{kind}, to the end", squares, _NOTHING)


def ratios(table: MarkedTable, pairs: Sequence[Pair]) -> Iterator[str]:
    """Yield error over sigma by state, over all flights, to their ends."""
    low, high = ASKED_RATIO
    yield f"error over sigma, rms, to the end (asked of the smoother: {low:g} to {high:g})"
    yield ratio_head(table)
    for kind, bounds in ((FILTER, (-math.inf, math.inf)), (SMOOTHER, ASKED_RATIO)):
        yield ratio_row(table, kind, [pair.whole[kind] for pair in pairs], bounds)


def outages(table: MarkedTable, flights: Sequence[dict[str, Squares]]) -> Iterator[str]:
    """Yield the errors during the outages."""
    yield f"12 s without RTK and heading at 4 m/s, {len(flights)} flights: rms"
    yield table.row("", ["distance", "heading"])
    yield table.row("", ["m", "deg"])
    yield table.row("asked of the smoother", [f"{limit:.3f} " for limit in ASKED_OUTAGE])
    for kind, (most_m, most_deg) in ((FILTER, _NOTHING[:2]), (SMOOTHER, ASKED_OUTAGE)):
        squares = [flight[kind] for flight in flights]
        distance_m = float(np.linalg.norm(rms_of(squares, "position")))
        heading_deg = math.degrees(float(rms_of(squares, "rpy")[2]))
        cells = [table.cell(distance_m, high=most_m, digits=3)]
        yield table.row(kind, [*cells, table.cell(heading_deg, high=most_deg, digits=3)])


def hidden(table: MarkedTable, flights: Sequence[dict[str, list[Miss]]]) -> Iterator[str]:
    """Yield the errors at the last fix of each cut."""
    yield f"recorded flights, RTK hidden for {CUT_S:g} s: distance to the last hidden fix"
    yield table.row("", ["fixes ", "median ", "sigma ", "<3 sigma "])
    yield table.row("", ["", "m ", "m ", "% "])
    asked = [f"<={ASKED_HIDDEN_M:g} ", "", f">={100 * ASKED_WITHIN:g} "]
    yield table.row("asked of the smoother", ["", *asked])
    limits = (-math.inf, math.inf), (100 * ASKED_WITHIN, ASKED_HIDDEN_M)
    for kind, (least, most_m) in zip(KINDS, limits, strict=True):
        misses = [miss for flight in flights for miss in flight[kind]]
        within = 100 * float(np.mean([miss.within(3) for miss in misses]))
        cells = [
            f"{len(misses)} ",
            table.cell(median([miss.error_m for miss in misses]), high=most_m),
            table.cell(median([miss.sigma_m for miss in misses])),
            table.cell(within, least, digits=1),
        ]
        yield table.row(kind, cells)


def main(argv: Sequence[str] | None = None) -> int:
    """Fly everything and print the report."""
    parser = argparse.ArgumentParser(prog="python -m dev.smoothing")
    parser.add_argument("folder", type=Path, nargs="?", help="bags (*.mcap) of recorded flights")
    parser.add_argument("--seeds", type=int, default=10, help="flights of each kind")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    args = parser.parse_args(argv)
    if args.seeds < 1 or args.workers < 1:
        parser.error("at least one seed and one worker")
    return exit_code("smoothing", lambda: _run(args.folder, args.seeds, args.workers))


def _run(folder: Path | None, seeds: int, workers: int) -> int:
    table = MarkedTable(26, 9)
    with Progress("three shapes", "flights") as bar:
        pairs = in_processes(fly_pair, cases(seeds, (100.0,), 107.0), workers, bar)
    lines = [*shapes(table, pairs), "", *ratios(table, pairs), ""]
    with Progress("outages", "flights") as bar:
        lost = in_processes(fly_outage, range(1, 1 + seeds), workers, bar)
    lines += outages(table, lost)
    if folder is not None:
        with Progress("hidden fixes", "bags") as bar:
            bags = in_processes(fly_hidden, bags_in(folder), workers, bar)
        lines += ["", *hidden(table, bags)]
    return print_report(lines, table.missed)


if __name__ == "__main__":
    sys.exit(main())
