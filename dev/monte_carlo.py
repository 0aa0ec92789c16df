"""Fly many seeded flights through the filter; find its errors and whether its covariance fits.

Three measures of consistency, as in Bar-Shalom, Li and Kirubarajan, Estimation with Applications
to Tracking and Navigation, section 5.4:

error over sigma
    By state; its rms over time and flights is 1 for a consistent filter.
NEES
    The normalised estimation error squared, ``e^T P^-1 e`` of the nine states together. Errors of
    one flight are correlated over tens of seconds (biases are learned once), so each flight gives
    one value, at its end. Flights have no random number in common, so N flights give N times 9
    degrees of freedom.
NIS
    The normalised innovation squared of every measurement that reached a gate. The innovations
    of a consistent filter are independent of each other, so each counts.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dev.flight_errors import errors, fitting_config, navigation_samples
from dev.judging import in_processes
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.ins.kalman import chi_square_limit
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.measurements import HeadingSample, NavigationInput, Source
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import Outcome, Verdict
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import scenario_from
from tirgeo_ros.tools.simulate.scenario_aircraft import SHAPES

#: Errors count from here on, when the filter has learned its biases.
SETTLED_S = 20.0
_FIRST_HEADING_DEG = 20.0
#: Headings are reported in whole degrees, and their error depends on the fraction of a degree of
#: the true one. The first headings of the flights therefore cover a degree evenly.
_GOLDEN = 0.5 * (math.sqrt(5) - 1)
_END_NS = 100_000_000
_JUDGED = (Outcome.USED, Outcome.GATED)
_SOURCES = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)


@dataclass(frozen=True)
class Case:
    """Hold the settings of one flight."""

    shape: str
    imu_rate_hz: float
    seed: int
    duration_s: float = 107.0


@dataclass(frozen=True)
class Nis:
    """Sum the normalised innovations of one source."""

    squares: float = 0.0  # their sum
    expected: float = 0.0  # of the sum, for the measurements' true noise
    degrees: int = 0  # of freedom

    def __add__(self, other: Nis) -> Nis:
        return Nis(
            self.squares + other.squares,
            self.expected + other.expected,
            self.degrees + other.degrees,
        )

    @property
    def ratio(self) -> float:
        """Return the sum over its expectation: 1 for a consistent filter."""
        return self.squares / self.expected


@dataclass(frozen=True)
class Flown:
    """Hold the results of one flight, later than SETTLED_S."""

    case: Case
    rpy_ms: Array  # (3,) mean squares of roll, pitch, heading, rad2
    position_ms: Array  # (3,) north, east, down, m2
    ratio_ms: Array  # (9,) mean squares of error over sigma
    nees: float  # at the end
    nis: dict[Source, Nis]


def cases(seeds: int, rates_hz: Sequence[float], duration_s: float) -> list[Case]:
    """Return ``seeds`` flights of each shape and IMU rate, no two with the same random numbers."""
    kinds = [(shape, rate_hz) for rate_hz in rates_hz for shape in SHAPES]
    return [
        Case(*kind, 1 + seeds * number + k, duration_s)
        for number, kind in enumerate(kinds)
        for k in range(seeds)
    ]


def fly_case(case: Case, **values: object) -> Flown:
    """Fly one case, with the filter's defaults but for ``values`` (``rtk__delay_s=0.1``).

    Raises TirgeoError if the filter has no solution at the end.
    """
    flight = flight_of(case)
    config = fitting_config(flight, **values)
    found, nis = _filtered(config, navigation_samples(flight), flight.scenario.start_ns)
    if not found or found[-1].stamp_ns < flight.truth.stamp_ns[-1] - _END_NS:
        raise TirgeoError(
            f"{case.shape}, {case.imu_rate_hz:g} Hz, seed {case.seed}: the filter has no "
            "solution at the end of the flight"
        )
    late = errors(flight, found).after(SETTLED_S)
    last = late.state[-1]
    return Flown(
        case,
        np.mean(late.rpy**2, axis=0),
        np.mean(late.state[:, :3] ** 2, axis=0),
        np.mean((late.state / late.sigma) ** 2, axis=0),
        float(last @ np.linalg.solve(found[-1].covariance, last)),
        nis,
    )


def flight_of(case: Case) -> SimulatedFlight:
    """Return the flight of a case."""
    return fly(
        scenario_from(
            {
                "route.shape": case.shape,
                "route.heading_deg": _FIRST_HEADING_DEG + case.seed * _GOLDEN % 1.0,
                "imu.rate_hz": case.imu_rate_hz,
                "duration_s": case.duration_s,
            }
        ),
        case.seed,
    )


def fly_all(wanted: Sequence[Case], workers: int, progress: Report = silent) -> list[Flown]:
    """Fly cases in ``workers`` processes; return the results in the order of the cases."""
    return in_processes(fly_case, wanted, workers, progress)


def _filtered(
    config: EkfConfig, samples: Iterable[NavigationInput], start_ns: int
) -> tuple[list[NavSolution], dict[Source, Nis]]:
    navigation = Navigation(config)
    found: list[NavSolution] = []
    nis: defaultdict[Source, Nis] = defaultdict(Nis)
    settled_ns = start_ns + round(SETTLED_S * 1e9)
    for sample in samples:
        verdict, solution = (step := navigation.process(sample)).verdict, step.solution
        if solution is not None:
            found.append(solution)
        judged = verdict.outcome in _JUDGED and verdict.source in _SOURCES
        if judged and sample.stamp_ns > settled_ns:
            nis[verdict.source] += _nis(config, sample, verdict, found[-1])
    return found, dict(nis)


def _nis(config: EkfConfig, sample: NavigationInput, verdict: Verdict, newest: NavSolution) -> Nis:
    """Return one measurement's NIS; its test ratio is the NIS over the gate's limit."""
    degrees = len(verdict.innovation)
    if not isinstance(sample, HeadingSample):
        squares = verdict.test_ratio * chi_square_limit(config.rtk.gate_sigma, degrees)
        return Nis(squares, degrees, degrees)
    squares = verdict.test_ratio * chi_square_limit(config.heading.gate_sigma, degrees)
    # The floor is above the true noise, so less than 1 is expected.
    predicted = newest.covariance[5, 5]
    believed = max(sample.variance_rad2, math.radians(config.heading.sigma_floor_deg) ** 2)
    return Nis(squares, (predicted + sample.variance_rad2) / (predicted + believed), degrees)


def pooled(found: Iterable[Flown], name: str) -> Array:
    """Return the root of the mean over flights of one of their mean squares."""
    return np.asarray(np.sqrt(np.mean([getattr(each, name) for each in found], axis=0)))


def pooled_nis(found: Iterable[Flown]) -> dict[Source, Nis]:
    """Return sums over flights, by source."""
    total: dict[Source, Nis] = {}
    for each in found:
        for source, nis in each.nis.items():
            total[source] = total.get(source, Nis()) + nis
    return total


def chi_square_bounds(degrees: int, sigma: float = 3.29) -> tuple[float, float]:
    """Return the bounds of 99.9 % (3.29 sigma) of a chi-square variable over its degrees.

    By Wilson and Hilferty's cube root, good to 1 % of the interval from 30 degrees on.
    """
    spread = 2 / (9 * degrees)
    low, high = (1 - spread + side * sigma * math.sqrt(spread) for side in (-1, 1))
    return low**3, high**3
