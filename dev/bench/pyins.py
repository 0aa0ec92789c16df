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
"""Run pyins, a filter of the same kind, on a simulated flight as a reference for ours.

pyins (PyPI: python-ins) is not a dependency; ``make bench`` installs it. Its feedback filter takes
the whole flight at once, in degrees and pandas tables. It knows positions and velocities; the
heading is added as its documentation describes for new measurements. It starts from our first
solution and has our parameters: turn-on biases, noise, and the sigmas of the measurements. Only
its covariance step stays its own, 0.1 s. It has no smoother for feedback: Rauch, Tung and
Striebel's recursion goes back through its steps.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest import mock

import numpy as np

from dev.flight_errors import Errors, States, errors_of_states, navigation_samples
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import euler_from_quat, quat_from_euler, wrap_pi
from tirgeo_ros.core.navigation.aiding.aid import floored
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.tools.simulate.flight import SimulatedFlight

_LLA = ("lat", "lon", "alt")
_VELOCITY = ("VN", "VE", "VD")
_RPH = ("roll", "pitch", "heading")
_IMU = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")


def pyins_is_installed() -> bool:
    """Return whether the comparison can be made."""
    return importlib.util.find_spec("pyins") is not None


@dataclass
class Steps:
    """Record what a smoother needs of a run of pyins: K epochs of n error states."""

    covariances: Array = field(default_factory=lambda: np.empty(0))  # (K, n, n) after the update
    moves: list[tuple[Array, Array]] = field(default_factory=list)  # Phi, Q after each epoch
    corrections: dict[int, Array] = field(default_factory=dict)  # (n,) by epoch

    @contextmanager
    def recorded(self) -> Iterator[None]:
        """Record a run that is made inside; the filter's own functions tell the matrices."""
        filters = importlib.import_module("pyins").filters
        names = "_compute_error_propagation_matrices", "_compute_sd"
        correct, propagate, make_sigmas = filters.kalman.correct, *map(vars(filters).get, names)

        def corrected(*args: Any) -> Any:
            result = correct(*args)
            self.corrections[len(self.moves)] = result[0]
            return result

        def propagated(*args: Any) -> Any:
            self.moves.append(propagate(*args))
            return self.moves[-1]

        def with_sigmas(covariances: Array, *args: Any) -> Any:
            self.covariances = covariances
            return make_sigmas(covariances, *args)

        with (
            mock.patch.object(filters.kalman, "correct", corrected),
            mock.patch.object(filters, names[0], propagated),
            mock.patch.object(filters, names[1], with_sigmas),
        ):
            yield

    def smoothed(self) -> Array:
        """Return the smoothed errors (K, n) of the state after each update."""
        errors = np.zeros(self.covariances.shape[:2])
        for k in reversed(range(len(errors) - 1)):
            transition, noise = self.moves[k]
            moved = transition @ self.covariances[k]
            later = errors[k + 1] + self.corrections.get(k + 1, 0.0)
            errors[k] = moved.T @ np.linalg.solve(moved @ transition.T + noise, later)
        return errors


@dataclass(frozen=True)
class PyinsRun:
    """Hold a flight in the form that pyins takes; ``run`` calls its filter and nothing else."""

    flight: SimulatedFlight
    zero_ns: int
    samples: int  # of the IMU
    run: Callable[[], Any]
    steps: Steps

    def errors(self, result: Any) -> Errors:
        """Return the errors of a result at every IMU sample."""
        return self._errors(result.trajectory)

    def smoothed_errors(self, result: Any) -> Errors:
        """Return the errors of a recorded result, smoothed, at the ends of pyins' steps."""
        model = importlib.import_module("pyins").error_model.InsErrorModel()
        rows = result.trajectory.loc[result.trajectory_sd.index]
        errors = self.steps.smoothed()[:, : model.n_states]
        pairs = zip(rows.iterrows(), errors, strict=True)
        table = [model.correct_pva(row, error) for (_, row), error in pairs]
        return self._errors(_table(rows.columns, list(rows.index), table))

    def _errors(self, table: Any) -> Errors:
        euler = np.radians(table[list(_RPH)].to_numpy())
        place = table[list(_LLA)].to_numpy()
        states = States(
            [self.zero_ns + round(t_s * 1e9) for t_s in table.index],
            *(np.radians(place[:, 0]), np.radians(place[:, 1]), place[:, 2]),
            table[list(_VELOCITY)].to_numpy(),
            quat_from_euler(*euler.T),
        )
        return errors_of_states(self.flight.truth, states)


def pyins_run(flight: SimulatedFlight, config: EkfConfig, start: NavSolution) -> PyinsRun:
    """Convert a flight's IMU and RTK samples from ``start`` on, so that ``run`` only filters."""
    pyins, zero_ns = importlib.import_module("pyins"), start.stamp_ns
    samples = [s for s in navigation_samples(flight) if s.stamp_ns >= zero_ns]
    imu = [s for s in samples if isinstance(s, ImuSample)]
    readings = [np.concatenate([s.angular_rate_b, s.specific_force_b]) for s in imu]
    table = _table(_IMU, _seconds(imu, zero_ns), readings)
    increments = pyins.strapdown.compute_increments_from_imu(table, "rate")
    later = [s for s in samples if s.stamp_ns > zero_ns]
    measurements = _measurements(later, config, zero_ns)
    models, steps = _sensor_models(config), Steps()

    def run() -> Any:
        with steps.recorded():
            return pyins.filters.run_feedback_filter(
                _start(start), *_start_sigmas(start), increments, *models, measurements
            )

    return PyinsRun(flight, zero_ns, len(imu), run, steps)


def _seconds(samples: Sequence[Any], zero_ns: int) -> list[float]:
    return [(sample.stamp_ns - zero_ns) * 1e-9 for sample in samples]


def _table(columns: Sequence[str], times_s: Sequence[float], rows: Any) -> Any:
    pandas = importlib.import_module("pandas")
    return pandas.DataFrame(np.array(rows), index=times_s, columns=list(columns))


def _sensor_models(config: EkfConfig) -> tuple[Any, Any]:
    """Return models of white noise, turn-on bias and its walk; ours decays in some minutes."""
    model = importlib.import_module("pyins").inertial_sensor.EstimationModel
    imu = config.imu
    gyro = np.array(imu.gyro_bias_instability), np.array(imu.gyro_bias_time_s)
    accel = np.array(imu.accel_bias_instability), np.array(imu.accel_bias_time_s)
    return tuple(
        model(np.hypot(turn_on, sigma), white, sigma * np.sqrt(2 / time_s))
        for turn_on, white, (sigma, time_s) in (
            (imu.gyro_turn_on_bias, imu.angle_random_walk, gyro),
            (imu.accel_turn_on_bias, imu.velocity_random_walk, accel),
        )
    )


def _start(start: NavSolution) -> Any:
    place = [*np.degrees([start.latitude_rad, start.longitude_rad]), start.height_m]
    rph = np.degrees(euler_from_quat(start.q_nb))
    pandas = importlib.import_module("pandas")
    return pandas.Series(
        np.concatenate([place, start.velocity_n, rph]), index=[*_LLA, *_VELOCITY, *_RPH], name=0.0
    )


def _start_sigmas(start: NavSolution) -> tuple[float, float, float, float]:
    """Return sigmas as pyins takes them: m, m/s, degrees of tilt and of heading."""
    variance = start.covariance.diagonal()
    position, tilt, velocity = (
        float(np.sqrt(variance[rows].mean())) for rows in (slice(3), slice(3, 5), slice(6, 9))
    )
    return position, velocity, math.degrees(tilt), math.degrees(math.sqrt(variance[5]))


def _measurements(samples: Sequence[Any], config: EkfConfig, zero_ns: int) -> list[Any]:
    """Return the RTK receiver's measurements, with the sigmas that our filter takes."""
    pyins, rtk = importlib.import_module("pyins"), config.rtk
    fixes = [
        s for s in samples if isinstance(s, PositionSample) and s.source is Source.RTK_POSITION
    ]
    velocities = [
        s for s in samples if isinstance(s, VelocitySample) and s.source is Source.RTK_VELOCITY
    ]
    headings = [s for s in samples if isinstance(s, HeadingSample)]
    places = [[*np.degrees([s.latitude_rad, s.longitude_rad]), s.height_m] for s in fixes]
    arm_b = config.aircraft.rtk_lever_b
    sigmas = [
        np.sqrt(floored(sample.covariance_n, floor).diagonal())
        for sample, floor in (
            (fixes[0], rtk.position_sigma_floor_m),
            (velocities[0], rtk.velocity_sigma_floor_m_s),
        )
    ]
    least_rad2 = math.radians(config.heading.sigma_floor_deg) ** 2
    return [
        pyins.measurements.Position(
            _table(_LLA, _seconds(fixes, zero_ns), places), sigmas[0], arm_b
        ),
        pyins.measurements.NedVelocity(
            _table(_VELOCITY, _seconds(velocities, zero_ns), [s.velocity_n for s in velocities]),
            sigmas[1],
            arm_b,
        ),
        _heading_measurement(headings, max(headings[0].variance_rad2, least_rad2), zero_ns),
    ]


def _heading_measurement(
    headings: Sequence[HeadingSample], variance_rad2: float, zero_ns: int
) -> Any:
    """Return headings as a new kind of pyins measurement: a class with ``compute_matrices``."""
    pyins = importlib.import_module("pyins")
    noise = np.array([[variance_rad2]])

    class Heading(pyins.measurements.Measurement):  # type: ignore[misc, name-defined]
        """Measure the heading in degrees; ``z`` is predicted minus measured, in radians."""

        def compute_matrices(
            self, time: float, pva: Any, error_model: Any
        ) -> tuple[Array, Array, Array] | None:
            if time not in self.data.index:
                return None
            z = wrap_pi(math.radians(pva["heading"] - self.data.loc[time, "heading"]))
            # The last row of the outputs is the heading, in degrees a radian.
            design = np.radians(error_model.transform_to_output(pva)[-1:])
            return np.atleast_1d(z), design, noise

    values = [[math.degrees(s.heading_rad)] for s in headings]
    return Heading(_table(["heading"], _seconds(headings, zero_ns), values))
