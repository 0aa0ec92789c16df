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
"""Run the filter over a simulated flight and compare its solutions with the truth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.frames.rotations import (
    euler_from_quat,
    quat_conjugate,
    quat_multiply,
    rotvec_from_quat,
    wrap_pi,
)
from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic, rotation_ecef_from_ned
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
    PressureSample,
    VelocitySample,
)
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, Truth

NAVIGATION_SAMPLES = (ImuSample, PositionSample, VelocitySample, HeadingSample, PressureSample)
#: The nine states of a solution, in the order of its covariance.
STATE_NAMES = tuple(
    f"{quantity} {axis}"
    for quantity in ("position", "attitude", "velocity")
    for axis in ("north", "east", "down")
)


def navigation_samples(flight: SimulatedFlight) -> list[NavigationInput]:
    """Return every sample for the filter, in order of arrival."""
    return [sample for _, sample in flight.samples if isinstance(sample, NAVIGATION_SAMPLES)]


def fitting_config(flight: SimulatedFlight, **values: object) -> EkfConfig:
    """Return the filter's defaults with the flight's antennas and values (``rtk__delay_s=1``)."""
    fitting: dict[str, object] = dict(values_of(flight.scenario.aircraft, "aircraft."))
    dotted = {key.replace("__", "."): value for key, value in values.items()}
    return config_from(EkfConfig, fitting | dotted)


def solutions(
    flight: SimulatedFlight, config: EkfConfig, samples: Iterable[NavigationInput] | None = None
) -> list[NavSolution]:
    """Return what the filter publishes over a flight, or over ``samples`` if given."""
    fed = navigation_samples(flight) if samples is None else samples
    return published(Navigation(config), fed)


def published(navigation: Navigation, samples: Iterable[NavigationInput]) -> list[NavSolution]:
    """Return what a filter publishes over samples."""
    steps = [navigation.process(sample) for sample in samples]
    return [step.solution for step in steps if step.solution is not None]


@dataclass(frozen=True)
class States:
    """Hold navigation states at N instants."""

    stamp_ns: list[int]
    latitude_rad: Array  # (N,)
    longitude_rad: Array  # (N,)
    height_m: Array  # (N,)
    velocity_n: Array  # (N, 3) m/s
    q_nb: Array  # (N, 4) wxyz


@dataclass(frozen=True)
class Errors:
    """Hold errors at N instants: truth minus estimate."""

    t_s: Array  # (N,) from the start of the flight
    state: Array  # (N, 9) position NED m, attitude phi_n rad, velocity NED m/s
    sigma: Array  # (N, 9) the filter's own; nan where it gives none
    rpy: Array  # (N, 3) roll, pitch, heading, rad

    def after(self, t_s: float) -> Errors:
        """Return the errors later than ``t_s``."""
        keep = self.t_s > t_s
        return Errors(self.t_s[keep], self.state[keep], self.sigma[keep], self.rpy[keep])


@dataclass(frozen=True)
class Squares:
    """Hold mean squares of a flight's errors between two times."""

    rpy: Array  # (3,) roll, pitch, heading, rad2
    position: Array  # (3,) north, east, down, m2
    ratio: Array  # (9,) error over sigma

    @classmethod
    def of(cls, every: Errors, begin_s: float, end_s: float = math.inf) -> Squares:
        """Return those of the errors from ``begin_s`` to ``end_s``."""
        inside = (every.t_s > begin_s) & (every.t_s < end_s)
        rpy, state, sigma = every.rpy[inside], every.state[inside], every.sigma[inside]
        return cls(
            np.mean(rpy**2, axis=0),
            np.mean(state[:, :3] ** 2, axis=0),
            np.mean((state / sigma) ** 2, axis=0),
        )


def rms_of(flights: Sequence[Squares], name: str) -> Array:
    """Return the root of the mean over flights of one of their mean squares."""
    return np.asarray(np.sqrt(np.mean([getattr(squares, name) for squares in flights], axis=0)))


def errors(flight: SimulatedFlight, solutions: Sequence[NavSolution]) -> Errors:
    """Return the errors of solutions; each stamp must be one of the flight's IMU samples."""
    states = States(
        [s.stamp_ns for s in solutions],
        np.array([s.latitude_rad for s in solutions]),
        np.array([s.longitude_rad for s in solutions]),
        np.array([s.height_m for s in solutions]),
        np.array([s.velocity_n for s in solutions]).reshape(-1, 3),
        np.array([s.q_nb for s in solutions]).reshape(-1, 4),
    )
    variances = [s.covariance.diagonal() for s in solutions]
    return errors_of_states(flight.truth, states, np.sqrt(variances).reshape(-1, 9))


def errors_of_states(truth: Truth, states: States, sigma: Array | None = None) -> Errors:
    """Return the errors of any estimator's states at stamps of the truth; ``sigma`` is (N, 9)."""
    index = {stamp: row for row, stamp in enumerate(truth.stamp_ns)}
    rows = np.array([index[stamp] for stamp in states.stamp_ns], np.intp)
    turned = quat_multiply(truth.q_nb[rows], quat_conjugate(states.q_nb))
    state = np.concatenate(
        [
            _apart_n(truth, rows, states),
            rotvec_from_quat(turned),
            truth.velocity_n[rows] - states.velocity_n,
        ],
        axis=-1,
    )
    return Errors(
        truth.t_s[rows],
        state,
        np.full_like(state, np.nan) if sigma is None else sigma,
        wrap_pi(euler_from_quat(truth.q_nb[rows]) - euler_from_quat(states.q_nb)),
    )


def _apart_n(truth: Truth, rows: npt.NDArray[np.intp], states: States) -> Array:
    """Return truth minus estimate, (N, 3), NED, m; by ECEF positions, so valid anywhere."""
    true_e = ecef_from_geodetic(
        truth.latitude_rad[rows], truth.longitude_rad[rows], truth.height_m[rows]
    )
    places = states.latitude_rad, states.longitude_rad, states.height_m
    apart_e = true_e - ecef_from_geodetic(*places)
    turns = [rotation_ecef_from_ned(lat, lon) for lat, lon in zip(*places[:2], strict=True)]
    return np.asarray(np.einsum("nji,nj->ni", np.array(turns).reshape(-1, 3, 3), apart_e))
