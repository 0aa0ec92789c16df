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
"""A faulty flight through the filter, and what it says of itself and of the truth meanwhile."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from unittest import mock

import numpy as np
from flights import GPS, NAVIGATION_SAMPLES, RTK, Errors, config_for, errors

from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.types.measurements import ImuSample, NavigationInput, PositionSample, Source
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.tools.simulate import flight as simulated
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import Scenario
from tirgeo_ros.tools.simulate.trajectory import Trajectory

ALL = (Source.IMU, *RTK, *GPS)


@dataclass(frozen=True, slots=True)
class Delivery:
    """A sample as the filter gets it."""

    arrival_ns: int
    sample: NavigationInput
    true_ns: int  # of the measurement, whatever its stamp says
    clock_ns: int = 0  # how far the clock of stamps is ahead of the truth's

    @property
    def source(self) -> Source:
        return self.sample.source

    def with_sample(self, **values: object) -> Delivery:
        return replace(self, sample=replace(self.sample, **values))


@dataclass(frozen=True, slots=True)
class Interval:
    """When a fault lasts, in the time of measurement."""

    start_ns: int
    end_ns: int

    def holds(self, delivery: Delivery) -> bool:
        return self.start_ns <= delivery.true_ns < self.end_ns


Deliveries = list[Delivery]
#: What a fault makes of a flight's deliveries.
Fault = Callable[[Deliveries, Interval], Deliveries]


def deliveries(flown: SimulatedFlight) -> Deliveries:
    """All that a flight sends the filter, as it should be."""
    return [
        Delivery(arrival_ns, sample, sample.stamp_ns)
        for arrival_ns, sample in flown.samples
        if isinstance(sample, NAVIGATION_SAMPLES)
    ]


def in_order(samples: Iterable[Delivery]) -> Deliveries:
    """Sorted by arrival; those of one instant stay in their order."""
    return sorted(samples, key=lambda delivery: delivery.arrival_ns)


def each(sources: tuple[Source, ...], change: Callable[[Delivery], Deliveries]) -> Fault:
    """What a change makes of each delivery of some sources in the interval."""

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        out: Deliveries = []
        for delivery in result:
            hit = delivery.source in sources and interval.holds(delivery)
            out += change(delivery) if hit else [delivery]
        return in_order(out)

    return fault


DURATION_S = 50.0
SHEAR_S = (25.0, 25.3)  # the first and the last instant of the wind's change
SHEAR_DEG = 15.0


@dataclass(frozen=True)
class Run:
    """What came of a flight. Solutions have the stamps of the flight's own clock."""

    published: list[NavSolution]
    astray: list[NavSolution]  # stamped with instants at which the IMU measured nothing
    errors: Errors
    changes: list[tuple[float, FilterState]]  # true time (s from the start), state from then on
    status: NavigationStatus  # at the end
    flown_s: float

    def states_from(self, t_s: float) -> tuple[FilterState, ...]:
        """The state at ``t_s`` and those after it."""
        before = [state for t, state in self.changes if t < t_s]
        return (*before[-1:], *(state for t, state in self.changes if t >= t_s))

    @property
    def resets(self) -> int:
        return sum(self.status.resets.values())


def run(flown: SimulatedFlight, fed: Deliveries, **values: object) -> Run:
    """Feed the filter; its state is asked for with every fix and every tenth IMU sample."""
    navigation = Navigation(config_for(flown, **values))
    published: list[NavSolution] = []
    changes: list[tuple[float, FilterState]] = []
    start_ns = flown.truth.stamp_ns[0]
    for number, delivery in enumerate(fed):
        solution = navigation.process(delivery.sample).solution
        if solution is not None:
            assert isinstance(delivery.sample, ImuSample), "published with something else"
            stamp_ns = solution.stamp_ns - delivery.clock_ns
            published.append(solution._replace(stamp_ns=stamp_ns))
        if number % 10 == 0 or isinstance(delivery.sample, PositionSample):
            state = navigation.status().state
            if not changes or changes[-1][1] is not state:
                changes.append(((delivery.true_ns - start_ns) * 1e-9, state))
    measured_ns = set(flown.truth.stamp_ns)
    at_home = [solution for solution in published if solution.stamp_ns in measured_ns]
    return Run(
        at_home,
        [solution for solution in published if solution.stamp_ns not in measured_ns],
        errors(flown, at_home),
        changes,
        navigation.status(),
        flown.scenario.duration_s,
    )


def sizes(done: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heading error (deg), the larger of roll's and pitch's (deg), position error in space (m)."""
    rpy_deg = np.abs(np.degrees(done.errors.rpy))
    return (
        rpy_deg[:, 2],
        rpy_deg[:, :2].max(axis=1),
        np.linalg.norm(done.errors.state[:, :3], axis=1),
    )


def faulty(flown: SimulatedFlight, fault: Fault, start_s: float, end_s: float) -> Deliveries:
    """A flight's deliveries with a fault from ``start_s`` to ``end_s`` after its start."""
    first_ns = flown.truth.stamp_ns[0]
    interval = Interval(first_ns + round(start_s * 1e9), first_ns + round(end_s * 1e9))
    return fault(deliveries(flown), interval)


@functools.cache
def calm() -> SimulatedFlight:
    """The paper's flight, cut short."""
    return fly(replace(Scenario(), duration_s=DURATION_S))


@functools.cache
def hovering() -> SimulatedFlight:
    """The same place and air, but the aircraft stands and turns."""
    base = Scenario()
    return fly(replace(base, duration_s=DURATION_S, route=replace(base.route, shape="hover")))


@functools.cache
def sheared() -> SimulatedFlight:
    """The same flight, but the wind turns: the aircraft has to lean over to stay on its way."""
    with mock.patch.object(simulated, "Trajectory", _ShearedTrajectory):
        return calm.__wrapped__()


#: The flights of the table.
FLIGHTS: dict[str, Callable[[], SimulatedFlight]] = {
    "lawnmower": calm,
    "hover": hovering,
    "shear": sheared,
}


class _ShearedTrajectory(Trajectory):
    """A trajectory through a wind that changes by what it takes to lean by ``SHEAR_DEG``."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        super().__init__(scenario, seed)
        change_m_s = 9.8 * np.tan(np.radians(SHEAR_DEG)) / scenario.wind.drag_1_s
        across = self.motion(SHEAR_S[0]).heading_rad[0] + np.pi / 2  # so that it rolls
        step = change_m_s * np.array([np.cos(across), np.sin(across), 0.0])
        gust = self._gust
        self._gust = lambda t_s, derivative=0: (  # type: ignore[assignment]
            gust(t_s, derivative) + _ramp(np.asarray(t_s), derivative)[..., None] * step
        )


def _ramp(t_s: np.ndarray, derivative: int) -> np.ndarray:
    """From 0 to 1 within ``SHEAR_S``, or its rate (1/s): the polynomial with no corner in either.

    10 u^3 - 15 u^4 + 6 u^5: its first and second derivatives are zero at both ends.
    """
    length_s = SHEAR_S[1] - SHEAR_S[0]
    u = np.clip((t_s - SHEAR_S[0]) / length_s, 0.0, 1.0)
    if derivative == 0:
        return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))
    return np.asarray(30 * u**2 * (1 - u) ** 2 / length_s)
