"""Fly seeded and recorded flights through the filter and through the smoother, side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dev.flight_errors import Errors, errors, fitting_config, navigation_samples
from dev.monte_carlo import SETTLED_S, Case, flight_of
from dev.real_flights import Miss, hidden_fixes, samples_of
from dev.real_flights_judged import config_of
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import smoothed
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import NavigationInput, Source
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import Scenario

FILTER, SMOOTHER = "filter", "smoother"
#: Before the end of a flight a smoother, too, has measurements from one side only.
END_S = 10.0
#: Twelve seconds without RTK's position, velocity and heading; ordinary GPS goes on.
LOST_S, FOUND_S, OUTAGE_FLIGHT_S = 22.0, 34.0, 50.0
_RTK = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)


@dataclass(frozen=True)
class Squares:
    """Hold mean squares of a flight's errors between two times."""

    rpy: Array  # (3,) roll, pitch, heading, rad2
    position: Array  # (3,) north, east, down, m2
    ratio: Array  # (9,) error over sigma
    largest: tuple[float, float]  # distance, m, and heading error, rad

    @classmethod
    def of(cls, found: Errors, begin_s: float, end_s: float) -> Squares:
        """Return those of the errors from ``begin_s`` to ``end_s``."""
        inside = (found.t_s > begin_s) & (found.t_s < end_s)
        rpy, state, sigma = found.rpy[inside], found.state[inside], found.sigma[inside]
        largest_m = float(np.linalg.norm(state[:, :3], axis=1).max())
        return cls(
            np.mean(rpy**2, axis=0),
            np.mean(state[:, :3] ** 2, axis=0),
            np.mean((state / sigma) ** 2, axis=0),
            (largest_m, float(np.abs(rpy[:, 2]).max())),
        )


def rms_of(squares: Sequence[Squares], name: str) -> Array:
    """Return the root of the mean over flights of one of their mean squares."""
    return np.asarray(np.sqrt(np.mean([getattr(one, name) for one in squares], axis=0)))


@dataclass(frozen=True)
class Pair:
    """Hold a flight's errors under both."""

    case: Case
    whole: dict[str, Squares]  # later than SETTLED_S
    inner: dict[str, Squares]  # the same up to END_S before the end


def fly_pair(case: Case) -> Pair:
    """Fly one case with the defaults."""
    flight = flight_of(case)
    found = both(flight, fitting_config(flight), navigation_samples(flight))
    spans = ((SETTLED_S, math.inf), (SETTLED_S, case.duration_s - END_S))
    whole, inner = (
        {name: Squares.of(one, *span) for name, one in found.items()} for span in spans
    )
    return Pair(case, whole, inner)


def both(
    flight: SimulatedFlight, config: EkfConfig, samples: Sequence[NavigationInput]
) -> dict[str, Errors]:
    """Return the errors of the filter and of the smoother."""
    makers: dict[str, Callable[[], Navigation]] = {
        FILTER: lambda: Navigation(config),
        SMOOTHER: lambda: smoothed(config, samples),
    }
    found = {}
    for name, make in makers.items():
        navigation = make()
        steps = [navigation.process(sample) for sample in samples]
        found[name] = errors(flight, [one.solution for one in steps if one.solution is not None])
    return found


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
    found = outage_errors(seed)
    return {name: Squares.of(one, LOST_S, FOUND_S) for name, one in found.items()}


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
