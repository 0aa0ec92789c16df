"""Measure filter and smoother: the filter beside pyins, and the cost of both over an hour."""

from __future__ import annotations

import itertools
import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from dev.bench.pyins import pyins_is_installed, pyins_run
from dev.consistency import SETTLED_S
from dev.flight_errors import Errors, errors, fitting_config, navigation_samples, published
from dev.flights import LoopedFlight
from dev.judging import Figure, in_processes
from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import (
    RecordingNavigation,
    SmoothedNavigation,
    smoothed,
)
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

_Result = TypeVar("_Result")

#: 4000 IMU samples at 100 Hz, 200 epochs of RTK; pyins takes some 10 s for them.
_FLIGHT_S = 40.0
_SEED = 3
#: The fastest of several runs is the one least slowed by other processes.
_RUNS = 3
_HOUR_MINUTES = 60
_COMPARED_MINUTES = 5


@dataclass(frozen=True)
class FilterTimes:
    """Hold one filter's cost on the flight, and its rms errors later than 20 s."""

    cost_s: float  # CPU per IMU sample
    tilt_deg: float  # the worse of roll and pitch
    heading_deg: float
    position_m: float  # the worst of north, east, down

    @classmethod
    def of(cls, cost_s: float, every: Errors) -> FilterTimes:
        """Return a cost with the rms of errors."""
        late = every.after(SETTLED_S)
        roll, pitch, heading = np.degrees(rms(late.rpy)).tolist()
        position_m = float(rms(late.state[:, :3]).max())
        return cls(cost_s, max(roll, pitch), heading, position_m)

    def errors(self, name: str) -> Iterator[Figure]:
        """Yield the errors as lines of the table."""
        yield Figure(f"{name}: worse of roll and pitch, rms", self.tilt_deg, "deg")
        yield Figure(f"{name}: heading, rms", self.heading_deg, "deg")
        yield Figure(f"{name}: worst axis of position, rms", self.position_m * 1e2, "cm")


def filter_figures() -> Iterator[Figure]:
    """Yield cost and accuracy of the filter beside pyins, and its cost over an hour."""
    own, rival = filter_times()
    yield Figure("filter, CPU per IMU sample", own.cost_s * 1e6, "us", "<= 60")
    if rival is not None:
        yield Figure("pyins on the same flight, per IMU sample", rival.cost_s * 1e6, "us")
        yield Figure("pyins over filter", rival.cost_s / own.cost_s, "ratio", ">= 20")
    yield from own.errors("filter")
    yield from rival.errors("pyins") if rival else ()
    with Progress("an hour of flight", unit="min") as bar:
        times = long_times(bar)
    yield Figure("an hour of flight: filter, first 5 min", times.first_s * 1e6, "us")
    yield Figure("an hour of flight: last 5 min over first", times.last_s / times.first_s, "ratio")
    yield Figure("an hour of flight: memory grown since", times.grown_bytes * 2**-20, "MiB")


def smoother_figures() -> Iterator[Figure]:
    """Yield cost and accuracy of the smoother, and its cost over an hour."""
    own = smoother_times()
    yield Figure("smoother, CPU per IMU sample, all passes", own.cost_s * 1e6, "us")
    yield from own.errors("smoother")
    (hour,) = in_processes(hour_cost, [_HOUR_MINUTES], 1)  # a process of its own, for its memory
    yield Figure("an hour smoothed: all passes over filter", hour.ratio, "ratio", "<= 3")
    yield Figure("an hour smoothed: the backward pass", hour.backward_s, "s")
    yield Figure("an hour smoothed: peak memory", hour.peak_bytes * 2**-20, "MiB", "<= 2048")


def filter_times() -> tuple[FilterTimes, FilterTimes | None]:
    """Measure our filter and pyins in turn on the same flight; None if pyins is not installed.

    Our cost includes everything: ``process()`` of every sample, ordinary GPS too, with checks and
    verdicts, and a solution with covariance at every IMU sample. The cost of pyins is the call of
    its filter alone.
    """
    flight = fly(scenario_from({"duration_s": _FLIGHT_S}), _SEED)
    samples, config = navigation_samples(flight), fitting_config(flight)
    rival = pyins_run(flight) if pyins_is_installed() else None
    own_s, rival_s = [], []
    for _ in range(_RUNS):  # in turn: if the machine is slow for a while, both are
        cost_s, solutions = _timed(partial(published, Navigation(config), samples))
        own_s.append(cost_s)
        if rival is not None:
            cost_s, table = _timed(rival.run)
            rival_s.append(cost_s)
    count = len(flight.truth.stamp_ns)
    own = FilterTimes.of(min(own_s) / count, errors(flight, solutions))
    if rival is None:
        return own, None
    return own, FilterTimes.of(min(rival_s) / count, rival.errors(table))


def smoother_times() -> FilterTimes:
    """Measure our smoother on the flight of the filters, the filter's own passes included."""
    flight = fly(scenario_from({"duration_s": _FLIGHT_S}), _SEED)
    samples, config = navigation_samples(flight), fitting_config(flight)
    runs = [_timed(lambda: published(smoothed(config, samples), samples)) for _ in range(_RUNS)]
    cost_s = min(cost_s for cost_s, _ in runs) / len(flight.truth.stamp_ns)
    return FilterTimes.of(cost_s, errors(flight, runs[0][1]))


def _timed(work: Callable[[], _Result]) -> tuple[float, _Result]:
    """Return the CPU time that some work takes, s, and its result."""
    begun = time.process_time()
    result = work()
    return time.process_time() - begun, result


@dataclass(frozen=True)
class LongTimes:
    """Hold costs of the last five minutes of an hour beside the first five."""

    first_s: float  # CPU per IMU sample, of the fastest of the five minutes
    last_s: float
    grown_bytes: int  # resident memory after the hour, less that after the first five minutes


def long_times(progress: Report = silent) -> LongTimes:
    """Measure one filter over an hour of flight."""
    flight = LoopedFlight()
    navigation = Navigation(flight.config)
    costs, sizes = [], []
    for minute, samples in enumerate(itertools.islice(flight.minutes(), _HOUR_MINUTES)):
        progress(minute, _HOUR_MINUTES)
        costs.append(_timed(partial(published, navigation, samples))[0])
        sizes.append(_resident_bytes())
    return LongTimes(
        min(costs[:_COMPARED_MINUTES]) / flight.imu_samples,
        min(costs[-_COMPARED_MINUTES:]) / flight.imu_samples,
        sizes[-1] - sizes[_COMPARED_MINUTES - 1],
    )


def _resident_bytes() -> int:
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * resource.getpagesize()


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


def hour_cost(minutes: int) -> HourCost:
    """Measure the smoother over a long flight, in this process."""
    flight = LoopedFlight()
    filter_s = _pass_s(Navigation(flight.config), flight, minutes)
    recording = RecordingNavigation(flight.config)
    first_s = _pass_s(recording, flight, minutes)
    backward_s, runs = _timed(recording.smoothed)
    second_s = _pass_s(SmoothedNavigation(flight.config, runs), flight, minutes)
    peak_bytes = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return HourCost(filter_s, first_s, backward_s, second_s, peak_bytes)


def _pass_s(navigation: Navigation, flight: LoopedFlight, minutes: int) -> float:
    """Return the CPU time of one pass; making the samples is not counted."""
    each = itertools.islice(flight.minutes(), minutes)
    return sum(_timed(partial(published, navigation, samples))[0] for samples in each)
