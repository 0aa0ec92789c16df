"""Measure the smoother: beside one on pyins' matrices, and its cost over an hour of flight."""

from __future__ import annotations

import itertools
import resource
import time
from dataclasses import dataclass

from dev.bench_filter import FilterTimes, bench_flight, flown, timed, times_of
from dev.bench_pyins import pyins_is_installed, pyins_run
from dev.bench_pyins_smoother import pyins_smoother_errors, smoothed_pyins
from dev.flight_errors import errors, fitting_config, navigation_samples
from dev.judging import in_processes
from dev.looped_flight import LoopedFlight
from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import (
    RecordingNavigation,
    SmoothedNavigation,
    smoothed,
)

_RUNS = 2
_HOUR_MINUTES = 60


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
