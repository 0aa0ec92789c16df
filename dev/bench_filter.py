"""Measure the filter's CPU time per IMU sample: beside pyins, and over an hour."""

from __future__ import annotations

import itertools
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from dev.bench_pyins import pyins_is_installed, pyins_run
from dev.flight_errors import Errors, errors, fitting_config, navigation_samples
from dev.looped_flight import LoopedFlight
from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.types.measurements import NavigationInput
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

_Result = TypeVar("_Result")

#: 4000 IMU samples at 100 Hz, 200 epochs of RTK; pyins takes some 10 s for them.
_FLIGHT_S = 40.0
_SETTLED_S = 20.0
_SEED = 3
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


def filter_times() -> tuple[FilterTimes, FilterTimes | None]:
    """Measure our filter and pyins in turn on the same flight; None if pyins is not installed.

    Our cost includes everything: ``process()`` of every sample, ordinary GPS too, with checks and
    verdicts, and a solution with covariance at every IMU sample. The cost of pyins is the call of
    its filter alone.
    """
    flight = bench_flight()
    samples, config = navigation_samples(flight), fitting_config(flight)
    rival = pyins_run(flight) if pyins_is_installed() else None
    own_s, rival_s = [], []
    for _ in range(_RUNS):  # in turn: if the machine is slow for a while, both are
        cost_s, found = timed(lambda: flown(Navigation(config), samples))
        own_s.append(cost_s)
        if rival is not None:
            cost_s, table = timed(rival.run)
            rival_s.append(cost_s)
    count = len(flight.truth.stamp_ns)
    own = times_of(min(own_s) / count, errors(flight, found))
    if rival is None:
        return own, None
    return own, times_of(min(rival_s) / count, rival.errors(table))


def bench_flight() -> SimulatedFlight:
    """Return the flight on which filters are compared."""
    return fly(scenario_from({"duration_s": _FLIGHT_S}), _SEED)


def flown(navigation: Navigation, samples: Sequence[NavigationInput]) -> list[NavSolution]:
    """Return the solutions that the filter publishes on samples."""
    steps = [navigation.process(sample) for sample in samples]
    return [step.solution for step in steps if step.solution is not None]


def timed(work: Callable[[], _Result]) -> tuple[float, _Result]:
    """Return the CPU time that some work takes, s, and its result."""
    begun = time.process_time()
    result = work()
    return time.process_time() - begun, result


def times_of(cost_s: float, found: Errors) -> FilterTimes:
    """Return a cost with the rms errors later than 20 s."""
    late = found.after(_SETTLED_S)
    roll, pitch, heading = np.degrees(rms(late.rpy)).tolist()
    return FilterTimes(cost_s, max(roll, pitch), heading, float(rms(late.state[:, :3]).max()))


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
        costs.append(timed(partial(flown, navigation, samples))[0])
        sizes.append(_resident_bytes())
    return LongTimes(
        min(costs[:_COMPARED_MINUTES]) / flight.imu_samples,
        min(costs[-_COMPARED_MINUTES:]) / flight.imu_samples,
        sizes[-1] - sizes[_COMPARED_MINUTES - 1],
    )


def _resident_bytes() -> int:
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * resource.getpagesize()
