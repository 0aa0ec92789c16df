"""Measure the smoother: beside one on pyins' matrices, and its cost over an hour of flight."""

from __future__ import annotations

import argparse
import itertools
import math
import os
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dev.bench_filter import FilterTimes, bench_flight, flown, timed, times_of
from dev.bench_pyins import pyins_is_installed, pyins_run
from dev.bench_pyins_smoother import pyins_smoother_errors, smoothed_pyins
from dev.flight_errors import errors, fitting_config, navigation_samples
from dev.judging import MarkedTable, in_processes
from dev.looped_flight import LoopedFlight
from dev.monte_carlo import SETTLED_S, Case, flight_of
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import (
    RecordingNavigation,
    SmoothedNavigation,
    smoothed,
)
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.presentation.progress import Progress

_RUNS = 2
_HOUR_MINUTES = 60
#: Of each flight whose accuracy is compared.
_COMPARED_S = 60.0
_COLUMNS = ("roll deg ", "pitch deg ", "yaw deg ", "north cm ", "east cm ", "down cm ")


def smoother_times() -> tuple[FilterTimes, FilterTimes | None]:
    """Measure our smoother and pyins' on the flight of the filters; None without pyins.

    Both costs are those of all passes, the filter's own included.
    """
    flight = bench_flight()
    samples, config = navigation_samples(flight), fitting_config(flight)
    count = len(flight.truth.stamp_ns)
    runs = [timed(lambda: flown(smoothed(config, samples), samples)) for _ in range(_RUNS)]
    own = times_of(min(cost_s for cost_s, _ in runs) / count, errors(flight, runs[0][1]))
    if not pyins_is_installed():
        return own, None
    rival = pyins_run(flight)
    cost_s, table = timed(lambda: smoothed_pyins(rival))
    return own, times_of(cost_s / count, pyins_smoother_errors(rival, table))


@dataclass(frozen=True)
class HourCost:
    """Hold the cost of smoothing an hour of flight at 100 Hz."""

    filter_s: float  # CPU of the filter alone
    first_s: float  # of the pass that records it
    backward_s: float
    second_s: float  # of the pass that publishes the smoothed poses
    peak_bytes: int  # resident memory of the process

    @property
    def ratio(self) -> float:
        """Return all of it over the filter alone."""
        return (self.first_s + self.backward_s + self.second_s) / self.filter_s


def hour_cost() -> HourCost:
    """Measure in a process of its own, for its memory."""
    (found,) = in_processes(_hour_cost, [_HOUR_MINUTES], 1)
    return found


def _hour_cost(minutes: int) -> HourCost:
    flight = LoopedFlight()
    filter_s = _passed_s(Navigation(flight.config), flight, minutes)
    recording = RecordingNavigation(flight.config)
    first_s = _passed_s(recording, flight, minutes)
    backward_s, runs = timed(recording.smoothed)
    second_s = _passed_s(SmoothedNavigation(flight.config, runs), flight, minutes)
    peak_bytes = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return HourCost(filter_s, first_s, backward_s, second_s, peak_bytes)


def _passed_s(navigation: Navigation, flight: LoopedFlight, minutes: int) -> float:
    """Return the CPU time of one pass; making the samples is not counted."""
    total_s = 0.0
    for samples in itertools.islice(flight.minutes(), minutes):
        begun_s = time.process_time()
        flown(navigation, samples)
        total_s += time.process_time() - begun_s
    return total_s


def squares_of(seed: int) -> Array:
    """Return mean squares (2, 6) of one flight, ours and pyins': attitude, position."""
    flight = flight_of(Case("lawnmower", 100.0, seed, _COMPARED_S))
    config, samples = fitting_config(flight), navigation_samples(flight)
    rival = pyins_run(flight)
    found = (
        errors(flight, flown(smoothed(config, samples), samples)),
        pyins_smoother_errors(rival, smoothed_pyins(rival)),
    )
    late = [one.after(SETTLED_S) for one in found]
    return np.array([np.mean(np.hstack([e.rpy, e.state[:, :3]]) ** 2, axis=0) for e in late])


def main(argv: Sequence[str] | None = None) -> int:
    """Compare the accuracy of the two over seeded flights; one flight alone says little."""
    parser = argparse.ArgumentParser(prog="python -m dev.bench_smoother")
    parser.add_argument("--seeds", type=int, default=16, help="flights")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    args = parser.parse_args(argv)
    if not pyins_is_installed():
        sys.stderr.write("bench_smoother: pyins is not installed: make bench does\n")
        return 1
    with Progress("flying", "flights") as bar:
        found = in_processes(squares_of, range(1, 1 + args.seeds), args.workers, bar)
    rms = np.sqrt(np.mean(found, axis=0)) * np.repeat([math.degrees(1.0), 100.0], 3)
    table = MarkedTable(26, 11)
    lines = [
        table.row(f"rms later than {SETTLED_S:g} s", _COLUMNS),
        *(
            table.row(name, [table.cell(value, digits=3) for value in row])
            for name, row in zip(("smoother", "pyins and RTS"), rms, strict=True)
        ),
    ]
    sys.stdout.write("\n".join([*lines, ""]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
