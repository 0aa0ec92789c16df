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
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from dev.flight_errors import STATE_NAMES
from dev.judging import MarkedTable, in_processes
from dev.monte_carlo import SETTLED_S, cases
from dev.real_flights import CUT_S, Miss
from dev.real_flights_judged import median
from dev.real_flights_table import bags_in
from dev.smoothed_flights import (
    END_S,
    FILTER,
    SMOOTHER,
    Hidden,
    Pair,
    Squares,
    fly_hidden,
    fly_outage,
    fly_pair,
    rms_of,
)
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.tools.presentation.progress import Progress

#: Largest rms of the smoother: roll, pitch, heading in deg; position by axis in m.
ASKED_RPY_DEG, ASKED_POSITION_M = (0.025, 0.025, 0.035), 0.006
ASKED_RATIO = (0.8, 1.25)
#: In an outage: distance in m, heading in deg.
ASKED_OUTAGE = (0.06, 0.08)
#: At hidden fixes: median distance in m, share within 3 sigma.
ASKED_HIDDEN_M, ASKED_WITHIN = 0.5, 0.9
KINDS = (FILTER, SMOOTHER)


def shapes(table: MarkedTable, found: Sequence[Pair]) -> Iterator[str]:
    """Yield the lines of the flights of three shapes."""
    yield f"rms error later than {SETTLED_S:g} s and up to {END_S:g} s before the end"
    yield table.row("", ["roll", "pitch", "heading", "north", "east", "down"])
    yield table.row("", ["deg"] * 3 + ["cm"] * 3)
    limits = [*ASKED_RPY_DEG, *(100 * ASKED_POSITION_M for _ in range(3))]
    yield table.row("asked of the smoother", [f"{limit:.3f} " for limit in limits])
    names = list(dict.fromkeys(one.case.shape for one in found))
    for name in (*names, "all"):
        flights = [one for one in found if name in {"all", one.case.shape}]
        for kind in KINDS:
            asked = limits if kind == SMOOTHER and name == "all" else [math.inf] * 6
            yield _rms(table, f"{name}, {kind}", [one.inner[kind] for one in flights], asked)
    for kind in KINDS:
        squares = [one.whole[kind] for one in found]
        yield _rms(table, f"all to the end, {kind}", squares, [math.inf] * 6)


def _rms(table: MarkedTable, name: str, squares: Sequence[Squares], asked: Sequence[float]) -> str:
    values = [*np.degrees(rms_of(squares, "rpy")), *(100 * rms_of(squares, "position"))]
    cells = zip(values, asked, strict=True)
    return table.row(name, [table.cell(value, high=limit, digits=3) for value, limit in cells])


def ratios(table: MarkedTable, found: Sequence[Pair]) -> Iterator[str]:
    """Yield error over sigma by state, over all flights, to their ends."""
    low, high = ASKED_RATIO
    yield f"error over sigma, rms, to the end (asked of the smoother: {low:g} to {high:g})"
    yield table.row(
        "", [f"{what[:3]} {axis[0].upper()} " for what, axis in map(str.split, STATE_NAMES)]
    )
    for kind in KINDS:
        bounds = ASKED_RATIO if kind == SMOOTHER else (-math.inf, math.inf)
        values = rms_of([one.whole[kind] for one in found], "ratio")
        yield table.row(kind, [table.cell(value, *bounds) for value in values])


def outages(table: MarkedTable, found: Sequence[dict[str, Squares]]) -> Iterator[str]:
    """Yield the errors during the outages."""
    yield f"12 s without RTK and heading at 4 m/s, {len(found)} flights: rms, and median largest"
    yield table.row("", ["distance", "heading", "largest", "heading"])
    yield table.row("", ["m", "deg"] * 2)
    yield table.row("asked of the smoother", [f"{limit:.3f} " for limit in ASKED_OUTAGE])
    for kind in KINDS:
        asked = ASKED_OUTAGE if kind == SMOOTHER else (math.inf, math.inf)
        squares = [one[kind] for one in found]
        distance_m = float(np.linalg.norm(rms_of(squares, "position")))
        heading_deg = math.degrees(float(rms_of(squares, "rpy")[2]))
        values = zip((distance_m, heading_deg), asked, strict=True)
        most_m, most_rad = np.median([one.largest for one in squares], axis=0).tolist()
        cells = [table.cell(value, high=limit, digits=3) for value, limit in values]
        cells += [table.cell(most_m, digits=3), table.cell(math.degrees(most_rad), digits=3)]
        yield table.row(kind, cells)


_AT: tuple[tuple[str, Callable[[Hidden, str], Iterator[Miss]]], ...] = (
    ("last fix", Hidden.last),
    ("worst fix", Hidden.worst),
    ("all fixes", Hidden.every),
)


def hidden(table: MarkedTable, found: Sequence[Hidden]) -> Iterator[str]:
    """Yield the errors at hidden fixes."""
    yield f"recorded flights, RTK hidden for {CUT_S:g} s: distance to hidden fixes, horizontal"
    yield table.row("", ["fixes ", "median ", "sigma ", "<3 sigma "])
    yield table.row("", ["", "m ", "m ", "% "])
    asked = [f"<={ASKED_HIDDEN_M:g} ", "", f">={100 * ASKED_WITHIN:g} "]
    yield table.row("asked of the smoother", ["", *asked])
    for name, of in _AT:
        for kind in KINDS:
            misses = [one for flight in found for one in of(flight, kind)]
            judged = kind == SMOOTHER and name == _AT[0][0]
            yield table.row(f"{name}, {kind}", _misses(table, misses, judged=judged))


def _misses(table: MarkedTable, misses: Sequence[Miss], *, judged: bool) -> list[str]:
    most_m, least = (ASKED_HIDDEN_M, 100 * ASKED_WITHIN) if judged else (math.inf, -math.inf)
    within = 100 * float(np.mean([one.within(3) for one in misses]))
    return [
        f"{len(misses)} ",
        table.cell(median([one.error_m for one in misses]), high=most_m),
        table.cell(median([one.sigma_m for one in misses])),
        table.cell(within, least, digits=1),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Fly everything and print the report."""
    parser = argparse.ArgumentParser(prog="python -m dev.smoothing")
    parser.add_argument("folder", type=Path, nargs="?", help="bags (*.mcap) of recorded flights")
    parser.add_argument("--seeds", type=int, default=10, help="flights of each kind")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    args = parser.parse_args(argv)
    if args.seeds < 1 or args.workers < 1:
        parser.error("at least one seed and one worker")
    table, lines = MarkedTable(26, 9), []
    try:
        with Progress("three shapes", "flights") as bar:
            pairs = in_processes(fly_pair, cases(args.seeds, (100.0,), 107.0), args.workers, bar)
        lines += [*shapes(table, pairs), "", *ratios(table, pairs), ""]
        with Progress("outages", "flights") as bar:
            lost = in_processes(fly_outage, range(1, 1 + args.seeds), args.workers, bar)
        lines += [*outages(table, lost), ""]
        if args.folder is not None:
            with Progress("hidden fixes", "bags") as bar:
                bags = in_processes(fly_hidden, bags_in(args.folder), args.workers, bar)
            lines += [*hidden(table, bags), ""]
    except TirgeoError as error:
        sys.stderr.write(f"smoothing: {error}\n")
        return 1
    sys.stdout.write("\n".join(lines))
    if table.missed:
        sys.stdout.write(f"{table.missed} figures are missed: marked with !\n")
    return 1 if table.missed else 0


if __name__ == "__main__":
    sys.exit(main())
