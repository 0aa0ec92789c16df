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
"""Measure filter and smoother: the filter beside pyins, and the smoother over an hour."""

from __future__ import annotations

import itertools
import math
import resource
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from dev.bench.pyins import pyins_is_installed, pyins_run
from dev.flight_errors import (
    Errors,
    Squares,
    errors,
    fitting_config,
    navigation_samples,
    published,
)
from dev.flights import LoopedFlight
from dev.judging import Figure, in_processes, percentile
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import (
    RecordingNavigation,
    SmoothedNavigation,
    smoothed,
)
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

_Result = TypeVar("_Result")

#: 6000 IMU samples at 100 Hz, 300 epochs of RTK; pyins takes some 15 s for them.
_FLIGHT_S = 60.0
_SEEDS = range(1, 13)
#: The faster of two runs is the one less slowed by other processes.
_RUNS = 2
#: Errors count when biases are learned, and where a smoother has measurements from both sides.
_FROM_S, _END_S = 20.0, 10.0
_HOUR_MINUTES = 60


@dataclass(frozen=True)
class Compared:
    """Hold a flight's costs, us of CPU per IMU sample, and rms heading errors, deg."""

    own_us: float
    own_deg: tuple[float, float]  # filtered, smoothed
    pyins_us: float = math.nan
    pyins_deg: tuple[float, float] = (math.nan, math.nan)


def compared(seed: int) -> Compared:
    """Fly one flight through our filter and, if it is installed, through pyins.

    Our cost includes everything: ``process()`` of every sample, ordinary GPS too, with checks and
    verdicts, and a solution with covariance at every IMU sample. The cost of pyins is the call of
    its filter alone.
    """
    flight = fly(scenario_from({"duration_s": _FLIGHT_S}), seed)
    samples = navigation_samples(flight)
    config = fitting_config(flight, imu__delay_sigma_s=0.0)  # pyins has no state of the delay
    rival = None
    own_s, pyins_s = [], []
    for _ in range(_RUNS):  # in turn: if the machine is slow for a while, both are
        seconds, found = _timed(partial(published, Navigation(config), samples))
        own_s.append(seconds)
        if pyins_is_installed():
            rival = pyins_run(flight, config, found[0])
            seconds, result = _timed(rival.run)
            pyins_s.append(seconds)
    later = published(smoothed(config, samples), samples)
    own_us = 1e6 * min(own_s) / len(flight.truth.stamp_ns)
    own_deg = _heading_deg(errors(flight, found)), _heading_deg(errors(flight, later))
    if rival is None:
        return Compared(own_us, own_deg)
    pyins_us = 1e6 * min(pyins_s) / rival.samples
    pyins_deg = _heading_deg(rival.errors(result)), _heading_deg(rival.smoothed_errors(result))
    return Compared(own_us, own_deg, pyins_us, pyins_deg)


def _heading_deg(every: Errors) -> float:
    squares = Squares.of(every, _FROM_S, _FLIGHT_S - _END_S)
    return math.degrees(math.sqrt(squares.rpy[2]))


def filter_figures() -> Iterator[Figure]:
    """Yield costs and heading errors of our filter and of pyins, medians over seeded flights.

    Behind each are the quartiles; the ratios are those of each flight.
    """
    rows = []
    with Progress("filter and pyins", "flights") as bar:
        for seed in _SEEDS:
            rows.append(compared(seed))
            bar(len(rows), len(_SEEDS))
    yield _median("filter, CPU per IMU sample", [row.own_us for row in rows], "us", "<= 60")
    kinds = tuple(enumerate(("filtered", "smoothed")))
    for k, kind in kinds:
        yield _median(f"heading, {kind}", [row.own_deg[k] for row in rows], "deg")
    if not pyins_is_installed():
        return
    yield _median("pyins, per IMU sample", [row.pyins_us for row in rows], "us")
    ratios = [row.pyins_us / row.own_us for row in rows]
    yield _median("pyins over filter", ratios, "ratio", ">= 18")
    for k, kind in kinds:
        yield _median(f"heading by pyins, {kind}", [row.pyins_deg[k] for row in rows], "deg")
        errors_over = [row.own_deg[k] / row.pyins_deg[k] for row in rows]
        yield _median(f"heading, {kind}: ours over pyins'", errors_over, "ratio", "<= 1.03")


def _median(what: str, values: Sequence[float], unit: str, wanted: str = "") -> Figure:
    low, high = (percentile(values, share) for share in (25, 75))
    digits = 3 if high < 10 else 1
    span = f"{unit}, quartiles {low:.{digits}f} to {high:.{digits}f}"
    return Figure(what, percentile(values, 50), f"{span}  ", wanted)


def smoother_figures() -> Iterator[Figure]:
    """Yield the smoother's cost over an hour."""
    (hour,) = in_processes(hour_cost, [_HOUR_MINUTES], 1)  # a process of its own, for its memory
    yield Figure("an hour smoothed: all passes over filter", hour.ratio, "ratio", "<= 3")
    yield Figure("an hour smoothed: the backward pass", hour.backward_s, "s")
    yield Figure("an hour smoothed: peak memory", hour.peak_bytes * 2**-20, "MiB", "<= 2048")


def _timed(work: Callable[[], _Result]) -> tuple[float, _Result]:
    """Return the CPU time that some work takes, s, and its result."""
    begun = time.process_time()
    result = work()
    return time.process_time() - begun, result


@dataclass(frozen=True)
class HourCost:
    """Hold the cost of smoothing an hour of flight at 100 Hz."""

    ratio: float  # of the CPU of all passes to that of the filter alone
    backward_s: float
    peak_bytes: int  # resident memory of the process


def hour_cost(minutes: int) -> HourCost:
    """Measure the smoother over a long flight, in this process."""
    flight = LoopedFlight()
    filter_s = _pass_s(Navigation(flight.config), flight, minutes)
    recording = RecordingNavigation(flight.config)
    first_s = _pass_s(recording, flight, minutes)
    backward_s, runs = _timed(recording.smoothed)
    second_s = _pass_s(SmoothedNavigation(flight.config, runs), flight, minutes)
    peak_bytes = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return HourCost((first_s + backward_s + second_s) / filter_s, backward_s, peak_bytes)


def _pass_s(navigation: Navigation, flight: LoopedFlight, minutes: int) -> float:
    """Return the CPU time of one pass; making the samples is not counted."""
    each = itertools.islice(flight.minutes(), minutes)
    return sum(_timed(partial(published, navigation, samples))[0] for samples in each)
