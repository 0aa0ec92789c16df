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
import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from dev.bench.pyins import pyins_is_installed, pyins_run
from dev.flight_errors import fitting_config, navigation_samples, published
from dev.flights import LoopedFlight
from dev.judging import Figure, in_processes
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import (
    RecordingNavigation,
    SmoothedNavigation,
)
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

_Result = TypeVar("_Result")

#: 4000 IMU samples at 100 Hz, 200 epochs of RTK; pyins takes some 10 s for them.
_FLIGHT_S = 40.0
_SEED = 3
#: The fastest of several runs is the one least slowed by other processes.
_RUNS = 3
_HOUR_MINUTES = 60


def filter_figures() -> Iterator[Figure]:
    """Yield the cost of our filter and of pyins, measured in turn on the same flight.

    Our cost includes everything: ``process()`` of every sample, ordinary GPS too, with checks and
    verdicts, and a solution with covariance at every IMU sample. The cost of pyins is the call of
    its filter alone.
    """
    flight = fly(scenario_from({"duration_s": _FLIGHT_S}), _SEED)
    samples, config = navigation_samples(flight), fitting_config(flight)
    pyins = pyins_run(flight).run if pyins_is_installed() else None
    own_s, pyins_s = [], []
    for _ in range(_RUNS):  # in turn: if the machine is slow for a while, both are
        own_s.append(_timed(partial(published, Navigation(config), samples))[0])
        if pyins is not None:
            pyins_s.append(_timed(pyins)[0])
    us_a_sample = 1e6 / len(flight.truth.stamp_ns)
    yield Figure("filter, CPU per IMU sample", min(own_s) * us_a_sample, "us", "<= 60")
    if pyins_s:
        name = "pyins on the same flight, per IMU sample"
        yield Figure(name, min(pyins_s) * us_a_sample, "us")
        yield Figure("pyins over filter", min(pyins_s) / min(own_s), "ratio", ">= 20")


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
