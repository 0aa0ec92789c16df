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
heading is added as its documentation describes for new measurements. The antenna's lever arm and
the sensors' noise are those of the scenario; the rest are pyins' defaults.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dev.flight_errors import Errors, States, errors_of_states, navigation_samples
from tirgeo_ros.core.frames.rotations import euler_from_quat, quat_from_euler, wrap_pi
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.tools.simulate.flight import SimulatedFlight

#: Sigmas of the initial state, as pyins takes them: m, m/s, degrees of tilt and of heading.
_START_SIGMA = (0.1, 0.1, 0.5, 1.0)
_LLA = ("lat", "lon", "alt")
_VELOCITY = ("VN", "VE", "VD")
_RPH = ("roll", "pitch", "heading")
_IMU = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")


def pyins_is_installed() -> bool:
    """Return whether the comparison can be made."""
    return importlib.util.find_spec("pyins") is not None


@dataclass(frozen=True)
class PyinsRun:
    """Hold a flight in the form that pyins takes; ``run`` calls its filter and nothing else."""

    flight: SimulatedFlight
    stamp_ns: list[int]
    run: Callable[[], Any]

    def errors(self, result: Any) -> Errors:
        """Return the errors of a result at every IMU sample."""
        table = result.trajectory
        euler = np.radians(table[list(_RPH)].to_numpy())
        place = table[list(_LLA)].to_numpy()
        states = States(
            self.stamp_ns,
            *(np.radians(place[:, 0]), np.radians(place[:, 1]), place[:, 2]),
            table[list(_VELOCITY)].to_numpy(),
            quat_from_euler(*euler.T),
        )
        return errors_of_states(self.flight.truth, states)


def pyins_run(flight: SimulatedFlight) -> PyinsRun:
    """Convert a flight's IMU and RTK samples, so that ``run`` only filters."""
    pyins = importlib.import_module("pyins")
    samples = navigation_samples(flight)
    imu = [s for s in samples if isinstance(s, ImuSample)]
    zero_ns = imu[0].stamp_ns
    readings = [np.concatenate([s.angular_rate_b, s.specific_force_b]) for s in imu]
    table = _table(_IMU, _seconds(imu, zero_ns), readings)
    increments = pyins.strapdown.compute_increments_from_imu(table, "rate")
    measurements = _measurements(flight, zero_ns)
    gyro, accel = _sensor_models(flight)
    start = _start(flight)

    def run() -> Any:
        return pyins.filters.run_feedback_filter(
            start, *_START_SIGMA, increments, gyro, accel, measurements
        )

    return PyinsRun(flight, [s.stamp_ns for s in imu], run)


def _seconds(samples: Sequence[Any], zero_ns: int) -> list[float]:
    return [(sample.stamp_ns - zero_ns) * 1e-9 for sample in samples]


def _table(columns: Sequence[str], times_s: Sequence[float], rows: Any) -> Any:
    pandas = importlib.import_module("pandas")
    return pandas.DataFrame(np.array(rows), index=times_s, columns=list(columns))


def _sensor_models(flight: SimulatedFlight) -> tuple[Any, Any]:
    """Return models of white noise, turn-on bias and its walk; pyins has no Gauss-Markov bias."""
    model = importlib.import_module("pyins").inertial_sensor.EstimationModel
    imu = flight.scenario.imu
    walks = [
        np.array(std) * np.sqrt(2 / np.array(time_s))
        for std, time_s in (
            (imu.noise.gyro_bias_instability, imu.noise.gyro_bias_time_s),
            (imu.noise.accel_bias_instability, imu.noise.accel_bias_time_s),
        )
    ]
    return (
        model(imu.gyro_turn_on_bias_rad_s, imu.noise.angle_random_walk, walks[0]),
        model(imu.accel_turn_on_bias_m_s2, imu.noise.velocity_random_walk, walks[1]),
    )


def _start(flight: SimulatedFlight) -> Any:
    """Return the truth at the first IMU sample: pyins has no alignment."""
    truth = flight.truth
    place = [*np.degrees([truth.latitude_rad[0], truth.longitude_rad[0]]), truth.height_m[0]]
    rph = np.degrees(euler_from_quat(truth.q_nb[0]))
    pandas = importlib.import_module("pandas")
    return pandas.Series(
        np.concatenate([place, truth.velocity_n[0], rph]),
        index=[*_LLA, *_VELOCITY, *_RPH],
        name=0.0,
    )


def _measurements(flight: SimulatedFlight, zero_ns: int) -> list[Any]:
    """Return the RTK receiver's measurements after its first epoch, which is the initial state."""
    pyins = importlib.import_module("pyins")
    samples = [s for s in navigation_samples(flight) if s.stamp_ns > zero_ns]
    fixes = [
        s for s in samples if isinstance(s, PositionSample) and s.source is Source.RTK_POSITION
    ]
    velocities = [
        s for s in samples if isinstance(s, VelocitySample) and s.source is Source.RTK_VELOCITY
    ]
    headings = [s for s in samples if isinstance(s, HeadingSample)]
    places = [[*np.degrees([s.latitude_rad, s.longitude_rad]), s.height_m] for s in fixes]
    arm_b = flight.scenario.aircraft.rtk_lever_b
    sigmas = [np.sqrt(s.covariance_n.diagonal()) for s in (fixes[0], velocities[0])]
    return [
        pyins.measurements.Position(
            _table(_LLA, _seconds(fixes, zero_ns), places), sigmas[0], arm_b
        ),
        pyins.measurements.NedVelocity(
            _table(_VELOCITY, _seconds(velocities, zero_ns), [s.velocity_n for s in velocities]),
            sigmas[1],
            arm_b,
        ),
        _heading_measurement(headings, zero_ns),
    ]


def _heading_measurement(headings: Sequence[HeadingSample], zero_ns: int) -> Any:
    """Return headings as a new kind of pyins measurement: a class with ``compute_matrices``."""
    pyins = importlib.import_module("pyins")
    noise = np.array([[headings[0].variance_rad2]])

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
