"""Judge the filter on a folder of recorded flights: ``make real-flights``.

Each bag is flown as it is, with RTK hidden for some seconds again and again, and with positions
that are wrong for a second (see ``real_flights``). Prints the results by bag and by group: bags of
one carrier (their name up to the first ``_``) with the same kinds of RTK data. If a figure is
missed, it is marked and the exit code is 1.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from dev.judging import MarkedTable, exit_code, print_report
from dev.real_flights import (
    CUT_S,
    MOVED_AT_SHARES,
    MOVED_FOR_S,
    MOVED_M,
    SETTLED_S,
    Judged,
    Miss,
    beyond,
    groups,
    judge_all,
    mean_nis,
    mean_tilt_deg,
    median,
    used_of,
)
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.types.errors import ConfigError, TirgeoError
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.presentation.progress import Progress

#: Least share of fixes used in each bag and in all; least share of the time with a pose.
#: Largest share of poses beyond 5 sigma, in all bags; largest move by a wrong position, m.
ASKED_USED_EACH, ASKED_USED, ASKED_POSE = 0.94, 0.97, 0.95
ASKED_BEYOND, ASKED_MOVED_M = 0.01, 0.5


_NIS = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)
_TIMES = 1 + len(MOVED_AT_SHARES)


@dataclass(frozen=True)
class Asked:
    """Hold the required figures of a group: means and medians over its bags."""

    used: float = 0.0  # share
    roll_pitch_deg: tuple[float, float] = (math.inf, math.inf)
    nis: tuple[float, float] = (0.0, math.inf)  # of positions, over degrees of freedom
    cut_m: float = math.inf
    within: float = 0.0  # share of the cuts within 3 sigma
    sigma_m: float = math.inf


#: Groups with figures of their own: the recordings of ../shared/real_flights.
ASKED = {
    "p4rtk, positions": Asked(0.0, (1.3, 1.6), (0.5, 1.5), 2.0, 0.95, 3.2),
    "walk, positions, velocities": Asked(0.98, cut_m=0.4),
}


def report(judged: Sequence[Judged]) -> tuple[list[str], int]:
    """Return the lines of the report and the number of missed figures."""
    table = MarkedTable(46, 10)
    lines = [*_fixes(table, judged), "", *_tilt(table, judged), "", *_cuts(table, judged)]
    return lines, table.missed


def _fixes(table: MarkedTable, judged: Sequence[Judged]) -> Iterator[str]:
    yield f"fixes and poses later than {SETTLED_S:g} s; moved: the largest change of a pose by"
    yield f"positions that are {MOVED_M:g} m wrong for {MOVED_FOR_S:g} s ({_TIMES} times a flight)"
    yield table.row("", ["used ", "lost ", "resets ", "pose ", ">5 sigma ", "moved "])
    yield table.row("", ["% ", "s ", "", "% ", "% ", "m "])
    asked = [f">={100 * ASKED_USED_EACH:g} ", "0 ", "0 ", f">={100 * ASKED_POSE:g} ", ""]
    yield table.row("asked of each bag", [*asked, f"<={ASKED_MOVED_M:g} "])
    for each in judged:
        yield table.row(each.name, _of_bag(table, each))
    for name, bags in groups(judged).items():
        least = ASKED.get(name, Asked()).used or -math.inf
        yield table.row(_asked(name, least=least), _together(table, bags, least, math.inf))
    yield table.row(
        f"all (>={100 * ASKED_USED:g} %, >5 sigma <={100 * ASKED_BEYOND:g} %)",
        _together(table, judged, ASKED_USED, ASKED_BEYOND),
    )


def _asked(name: str, *, least: float) -> str:
    return name if math.isinf(least) else f"{name} (>={100 * least:g} %)"


def _of_bag(table: MarkedTable, each: Judged) -> list[str]:
    flown = each.flown
    return [
        table.cell(100 * each.used, 100 * ASKED_USED_EACH, digits=1),
        table.cell(flown.lost_s, high=0.0, digits=1),
        table.cell(flown.resets, high=0, digits=0),
        table.cell(100 * flown.pose, 100 * ASKED_POSE, digits=1),
        table.cell(100 * beyond([each])),
        table.cell(max(each.moved_m), high=ASKED_MOVED_M),
    ]


def _together(table: MarkedTable, bags: Sequence[Judged], used: float, most: float) -> list[str]:
    share = used_of(bags)
    cells = [table.cell(100 * share, 100 * used, digits=1), "", "", ""]
    return [*cells, table.cell(100 * beyond(bags), high=100 * most)]


def _tilt(table: MarkedTable, judged: Sequence[Judged]) -> Iterator[str]:
    yield "roll and pitch less the autopilot's, rms; NIS over its degrees of freedom"
    yield table.row("", ["roll ", "pitch ", *("NIS " for _ in _NIS)])
    yield table.row("", ["deg ", "deg ", "position ", "velocity ", "heading "])
    for each in judged:
        values = [*each.tilt_deg, *(each.nis(source) for source in _NIS)]
        yield table.row(each.name, [table.cell(value) for value in values])
    for name, bags in groups(judged).items():
        asked = ASKED.get(name, Asked())
        if any(_asked_tilt(asked)):
            yield table.row(f"asked, {name}", _asked_tilt(asked))
        tilt_deg, nis = mean_tilt_deg(bags), [mean_nis(bags, source) for source in _NIS]
        cells = [
            table.cell(value, high=most)
            for value, most in zip(tilt_deg, asked.roll_pitch_deg, strict=True)
        ]
        low, high = asked.nis
        first = table.cell(nis[0], low, high) if math.isfinite(high) else table.cell(nis[0])
        yield table.row(f"mean, {name}", [*cells, first, *map(table.cell, nis[1:])])


def _asked_tilt(asked: Asked) -> list[str]:
    cells = [f"<={deg:g} " if math.isfinite(deg) else "" for deg in asked.roll_pitch_deg]
    low, high = asked.nis
    return [*cells, f"{low:g}..{high:g} " if math.isfinite(high) else ""]


def _cuts(table: MarkedTable, judged: Sequence[Judged]) -> Iterator[str]:
    yield f"RTK hidden for {CUT_S:g} s: the pose at the last hidden fix, medians, horizontal"
    yield table.row("", ["cuts ", "error ", "<3 sigma ", "sigma "])
    yield table.row("", ["", "m ", "% ", "m "])
    for each in judged:
        yield table.row(each.name, _of_cuts(table, each.cuts, Asked()))
    for name, bags in groups(judged).items():
        asked = ASKED.get(name, Asked())
        if any(_asked_cuts(asked)):
            yield table.row(f"asked, {name}", _asked_cuts(asked))
        cuts = [cut for each in bags for cut in each.cuts]
        yield table.row(f"all, {name}", _of_cuts(table, cuts, asked))


def _asked_cuts(asked: Asked) -> list[str]:
    error = f"<={asked.cut_m:g} " if math.isfinite(asked.cut_m) else ""
    within = f">={100 * asked.within:g} " if asked.within else ""
    sigma = f"<={asked.sigma_m:g} " if math.isfinite(asked.sigma_m) else ""
    return ["", error, within, sigma]


def _of_cuts(table: MarkedTable, cuts: Sequence[Miss], asked: Asked) -> list[str]:
    within = np.mean([cut.within(3) for cut in cuts]) if cuts else math.nan
    return [
        f"{len(cuts)} ",
        table.cell(median([cut.error_m for cut in cuts]), high=asked.cut_m),
        table.cell(100 * float(within), 100 * asked.within or -math.inf, digits=1),
        table.cell(median([cut.sigma_m for cut in cuts]), high=asked.sigma_m),
    ]


def values_from(pairs: Sequence[Sequence[str]]) -> dict[str, object]:
    """Return parameters from pairs of name and YAML value. Raises ConfigError."""
    values = {name: _read(name, text) for name, text in pairs}
    config_from(EkfConfig, values)
    return values


def _read(name: str, text: str) -> object:
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        raise ConfigError(f"parameter {name}: {text!r} is not YAML") from None


def bags_in(folder: Path) -> list[Path]:
    """Return the bags of a folder that have an IMU, sorted. Raises TirgeoError where none has."""
    paths = sorted(folder.glob("*.mcap"))
    bags = [path for path in paths if "/imu/data" in BagReader(path).topics()]
    if not bags:
        raise TirgeoError(f"{folder}: no bags (*.mcap) with /imu/data in it")
    return bags


def main(argv: Sequence[str] | None = None) -> int:
    """Fly all bags and print the report."""
    parser = argparse.ArgumentParser(prog="python -m dev.real_flights_table")
    parser.add_argument("folder", type=Path, help="bags (*.mcap) of recorded flights")
    parser.add_argument(
        "--set",
        nargs=2,
        action="append",
        default=[],
        metavar=("NAME", "VALUE"),
        help="a parameter of ekf_node, its value as YAML writes it; may be repeated",
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    args = parser.parse_args(argv)
    if args.workers < 1:
        parser.error("at least one worker")
    return exit_code("real_flights_table", lambda: _run(args))


def _run(args: argparse.Namespace) -> int:
    values, bags = values_from(args.set), bags_in(args.folder)
    with Progress("flying", "bags") as bar:
        judged = judge_all(bags, values, args.workers, bar)
    return print_report(*report(judged))


if __name__ == "__main__":
    sys.exit(main())
