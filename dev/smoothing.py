"""Compare the smoother with the filter: ``make smoothing``.

Prints errors over seeded flights of three shapes, over outages of RTK, and at fixes that are
hidden from recorded flights, the smoother's beside the required figures. If a figure is missed,
it is marked and the exit code is 1. ``--plot`` draws one outage: ``docs/smoothing.png``.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dev.consistency import (
    SETTLED_S,
    Case,
    cases,
    error_head,
    error_limits,
    error_row,
    flight_of,
    ratio_head,
    ratio_row,
)
from dev.flight_errors import (
    Errors,
    Squares,
    errors,
    fitting_config,
    navigation_samples,
    published,
    rms_of,
)
from dev.judging import MarkedTable, exit_code, in_processes, print_report
from dev.real_flights import CUT_S, Miss, config_of, hidden_fixes, median, samples_of
from dev.real_flights_table import bags_in
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import smoothed
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import NavigationInput, Source
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, png
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import Scenario

FILTER, SMOOTHER = "filter", "smoother"
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
    by_kind = both(flight, fitting_config(flight), navigation_samples(flight))
    spans = ((SETTLED_S, math.inf), (SETTLED_S, case.duration_s - END_S))
    whole, inner = (
        {name: Squares.of(one, *span) for name, one in by_kind.items()} for span in spans
    )
    return Pair(case, whole, inner)


def both(
    flight: SimulatedFlight, config: EkfConfig, samples: Sequence[NavigationInput]
) -> dict[str, Errors]:
    """Return the errors of the filter and of the smoother."""
    return {
        FILTER: errors(flight, published(Navigation(config), samples)),
        SMOOTHER: errors(flight, published(smoothed(config, samples), samples)),
    }


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


def outage_errors(seed: int) -> dict[str, Errors]:
    """Return the errors of a flight with RTK lost from LOST_S to FOUND_S."""
    flight = outage_flight(seed)
    start_ns = flight.truth.stamp_ns[0]
    samples = [
        sample
        for sample in navigation_samples(flight)
        if sample.source not in _RTK or not LOST_S <= (sample.stamp_ns - start_ns) * 1e-9 < FOUND_S
    ]
    return both(flight, fitting_config(flight), samples)


def fly_outage(seed: int) -> dict[str, Squares]:
    """Return the errors during the outage of a seeded flight."""
    by_kind = outage_errors(seed)
    return {name: Squares.of(one, LOST_S, FOUND_S) for name, one in by_kind.items()}


@dataclass(frozen=True)
class Hidden:
    """Hold the errors at the fixes that were hidden from a recorded flight, by cut."""

    name: str
    misses: dict[str, list[list[Miss]]]

    def last(self, kind: str) -> Iterator[Miss]:
        """Yield the miss at the last hidden fix of each cut: where the filter has drifted most."""
        return (misses[-1] for misses in self.misses[kind])

    def worst(self, kind: str) -> Iterator[Miss]:
        """Yield the largest miss of each cut: a smoother's is in its middle."""
        return (max(misses, key=lambda one: one.error_m) for misses in self.misses[kind])

    def every(self, kind: str) -> Iterator[Miss]:
        """Yield the misses at all hidden fixes."""
        return (one for misses in self.misses[kind] for one in misses)


def fly_hidden(path: Path) -> Hidden:
    """Fly a recorded flight with RTK hidden again and again."""
    samples = samples_of(path)
    config = config_of(samples, {})
    kinds = {FILTER: False, SMOOTHER: True}
    misses = {name: hidden_fixes(config, samples, smooth=smooth) for name, smooth in kinds.items()}
    return Hidden(path.stem, misses)


#: Largest rms of the smoother: roll, pitch, heading in deg; position by axis in m.
ASKED_RPY_DEG, ASKED_POSITION_M = (0.025, 0.025, 0.035), 0.006
ASKED_RATIO = (0.8, 1.25)
#: In an outage: distance in m, heading in deg.
ASKED_OUTAGE = (0.06, 0.08)
#: At hidden fixes: median distance in m, share within 3 sigma.
ASKED_HIDDEN_M, ASKED_WITHIN = 0.5, 0.9
KINDS = (FILTER, SMOOTHER)


def shapes(table: MarkedTable, pairs: Sequence[Pair]) -> Iterator[str]:
    """Yield the lines of the flights of three shapes."""
    yield f"rms error later than {SETTLED_S:g} s and up to {END_S:g} s before the end"
    yield from error_head(table)
    limits = error_limits(ASKED_RPY_DEG, ASKED_POSITION_M)
    yield table.row("asked of the smoother", [f"{limit:.3f} " for limit in limits])
    names = list(dict.fromkeys(pair.case.shape for pair in pairs))
    for name in (*names, "all"):
        flights = [pair for pair in pairs if name in {"all", pair.case.shape}]
        for kind in KINDS:
            asked = limits if kind == SMOOTHER and name == "all" else [math.inf] * 6
            yield error_row(
                table, f"{name}, {kind}", [pair.inner[kind] for pair in flights], asked
            )
    for kind in KINDS:
        squares = [pair.whole[kind] for pair in pairs]
        yield error_row(table, f"all to the end, {kind}", squares, [math.inf] * 6)


def ratios(table: MarkedTable, pairs: Sequence[Pair]) -> Iterator[str]:
    """Yield error over sigma by state, over all flights, to their ends."""
    low, high = ASKED_RATIO
    yield f"error over sigma, rms, to the end (asked of the smoother: {low:g} to {high:g})"
    yield ratio_head(table)
    for kind in KINDS:
        bounds = ASKED_RATIO if kind == SMOOTHER else (-math.inf, math.inf)
        yield ratio_row(table, kind, [pair.whole[kind] for pair in pairs], *bounds)


def outages(table: MarkedTable, flights: Sequence[dict[str, Squares]]) -> Iterator[str]:
    """Yield the errors during the outages."""
    yield f"12 s without RTK and heading at 4 m/s, {len(flights)} flights: rms, and median largest"
    yield table.row("", ["distance", "heading", "largest", "heading"])
    yield table.row("", ["m", "deg"] * 2)
    yield table.row("asked of the smoother", [f"{limit:.3f} " for limit in ASKED_OUTAGE])
    for kind in KINDS:
        asked = ASKED_OUTAGE if kind == SMOOTHER else (math.inf, math.inf)
        squares = [one[kind] for one in flights]
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


def hidden(table: MarkedTable, flights: Sequence[Hidden]) -> Iterator[str]:
    """Yield the errors at hidden fixes."""
    yield f"recorded flights, RTK hidden for {CUT_S:g} s: distance to hidden fixes, horizontal"
    yield table.row("", ["fixes ", "median ", "sigma ", "<3 sigma "])
    yield table.row("", ["", "m ", "m ", "% "])
    asked = [f"<={ASKED_HIDDEN_M:g} ", "", f">={100 * ASKED_WITHIN:g} "]
    yield table.row("asked of the smoother", ["", *asked])
    for name, of in _AT:
        for kind in KINDS:
            misses = [one for flight in flights for one in of(flight, kind)]
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


_FROM_S, _TO_S = 16.0, 42.0
_PLOTTED_SEED = 1
#: Title, unit of the axis, and error and sigma in that unit.
_PANELS: tuple[tuple[str, Callable[[Errors], Array], Callable[[Errors], Array]], ...] = (
    ("north, cm", lambda e: 100 * e.state[:, 0], lambda e: 100 * e.sigma[:, 0]),
    ("east, cm", lambda e: 100 * e.state[:, 1], lambda e: 100 * e.sigma[:, 1]),
    ("heading, deg", lambda e: np.degrees(e.rpy[:, 2]), lambda e: np.degrees(e.sigma[:, 5])),
)


def outage_png(by_kind: dict[str, Errors]) -> bytes:
    """Return a PNG: errors as lines in bands of two sigmas, filter and smoother."""
    made, panels = figure(8.0, 6.4, len(_PANELS), 1, sharex=True)
    for panel, (title, error, sigma) in zip(panels, _PANELS, strict=True):
        panel.axvspan(LOST_S, FOUND_S, color="#f0f0f0", zorder=0)
        for name, colour in zip((FILTER, SMOOTHER), COLOURS[1::-1], strict=True):
            _draw(panel, by_kind[name], error, sigma, name, colour)
        panel.set_ylabel(f"error {title}")
    panels[0].set_title(f"RTK and heading are missing from {LOST_S:g} to {FOUND_S:g} s (grey)")
    panels[0].legend(loc="upper left", ncols=2)
    panels[-1].set_xlabel("time, s; bands: two sigmas")
    return png(made)


def _draw(
    panel: Any,
    flight_errors: Errors,
    error: Callable[[Errors], Array],
    sigma: Callable[[Errors], Array],
    name: str,
    colour: str,
) -> None:
    inside = (flight_errors.t_s >= _FROM_S) & (flight_errors.t_s <= _TO_S)
    t_s, two = flight_errors.t_s[inside], 2 * sigma(flight_errors)[inside]
    panel.fill_between(t_s, -two, two, color=colour, alpha=0.18, linewidth=0)
    panel.plot(t_s, error(flight_errors)[inside], color=colour, label=name)


def main(argv: Sequence[str] | None = None) -> int:
    """Fly everything and print the report, or draw one outage."""
    parser = argparse.ArgumentParser(prog="python -m dev.smoothing")
    parser.add_argument("folder", type=Path, nargs="?", help="bags (*.mcap) of recorded flights")
    parser.add_argument("--seeds", type=int, default=10, help="flights of each kind")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="only draw one outage")
    args = parser.parse_args(argv)
    if args.seeds < 1 or args.workers < 1:
        parser.error("at least one seed and one worker")
    if args.plot is not None:
        args.plot.write_bytes(outage_png(outage_errors(_PLOTTED_SEED)))
        return 0
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
