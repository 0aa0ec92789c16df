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
"""Flights for tests of the filter; what is done with them is in ``dev/flight_errors.py``."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import NamedTuple

from dev.flight_errors import (
    NAVIGATION_SAMPLES,
    Errors,
    errors,
    fitting_config as config_for,
    navigation_samples,
    solutions,
)
from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import Scenario

__all__ = (
    "NAVIGATION_SAMPLES",
    "Errors",
    "config_for",
    "errors",
    "filtered",
    "flight",
    "navigation_samples",
    "rms",
    "solutions",
)

RTK = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)
GPS = (Source.GPS_POSITION, Source.GPS_VELOCITY)


@functools.lru_cache(maxsize=8)
def flight(
    seed: int | None = None, duration_s: float = 107.0, shape: str = "lawnmower"
) -> SimulatedFlight:
    """A flight of the paper's scenario, cut short."""
    base = Scenario()
    return fly(replace(base, duration_s=duration_s, route=replace(base.route, shape=shape)), seed)


class Filtered(NamedTuple):
    """Hold what the filter made of a flight."""

    errors: Errors | None  # of its solutions, if there is one
    states: list[tuple[float, FilterState]]  # at each IMU sample, with its seconds
    navigation: Navigation

    @property
    def status(self):
        return self.navigation.status()


def filtered(flown, change=None, *, watched=False, config=None, **values) -> Filtered:
    """Run the filter over a flight; ``change(sample, t_s)`` spoils a sample, or drops it (None).

    ``watched`` asks for the states; ``values`` are parameters.
    """
    start_ns = flown.truth.stamp_ns[0]
    navigation, result, states = Navigation(config or config_for(flown, **values)), [], []
    for given in navigation_samples(flown):
        t_s = (given.stamp_ns - start_ns) * 1e-9
        sample = given if change is None else change(given, t_s)
        if sample is None:
            continue
        solution = navigation.process(sample).solution
        if solution is not None:
            result.append(solution)
        if watched and isinstance(sample, ImuSample):
            states.append((t_s, navigation.status().state))
    return Filtered(errors(flown, result) if result else None, states, navigation)


def without(*sources, begin_s=-1.0, end_s=1e9):
    """A change for ``filtered``: samples of some sources are lost between two times."""
    return lambda s, t_s: None if s.source in sources and begin_s < t_s < end_s else s
