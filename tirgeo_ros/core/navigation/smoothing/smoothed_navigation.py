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
"""Smooth a flight: run the estimator twice, to record it and to publish smoothed solutions.

The second run is the filter again, with its verdicts, states and plane; only the solutions are
replaced. So code that takes the filter's poses takes the smoothed ones, too.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid_status import Receivers
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.ins.error_states import feedback, states_of
from tirgeo_ros.core.navigation.ins.strapdown import NavState
from tirgeo_ros.core.navigation.timeline.ekf import Readings, SolutionMaker, with_pending_step
from tirgeo_ros.core.navigation.timeline.flight_record import CORRECTED, MOVED, FlightRecord
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import NavigationInput
from tirgeo_ros.core.types.poses import NavSolution

#: Number of changes computed together: their matrices take 20 MB.
_BLOCK = 4096


class BackwardPass:
    """Go back through the record of a run, from its last change to the first."""

    def __init__(self, record: FlightRecord) -> None:
        n = record.states
        self._lower, self._square = record.lower, record.square
        self._covariances = record.covariances
        self._transitions, self._corrections = record.transitions, record.corrections
        self._kinds = np.frombuffer(record.kinds, np.int8)
        moved, corrected = self._kinds == MOVED, self._kinds == CORRECTED
        self._places = np.where(moved, np.cumsum(moved), np.cumsum(corrected)) - 1
        self._vector, self._matrix = np.zeros(n), np.zeros((n, n))

    def smoothed(self) -> Array:
        """Return the smoothed errors (changes, n) of the state after each change of the run.

        The record's covariances are replaced by those of the smoothed errors.
        """
        count, n = len(self._covariances), len(self._vector)
        rows, columns = self._lower
        possible = np.isfinite(self._covariances).all(axis=1)
        possible &= (self._covariances[:, rows == columns] >= 0).all(axis=1)
        sound = count if possible.all() else int(np.argmin(possible))  # until a filter is lost
        errors = np.zeros((count, n))
        vectors, matrices = np.zeros((_BLOCK, n)), np.zeros((_BLOCK, n, n))
        for begin in reversed(range(0, sound, _BLOCK)):
            end = min(begin + _BLOCK, sound)
            for number in reversed(range(begin, end)):
                vectors[number - begin] = self._vector
                matrices[number - begin] = self._matrix
                self._step_back(number)
            covariance = self._covariances[begin:end][:, self._square]
            errors[begin:end] = (covariance @ vectors[: end - begin, :, None])[:, :, 0]
            removed = covariance @ matrices[: end - begin] @ covariance
            covariance -= 0.5 * (removed + removed.swapaxes(1, 2))
            self._covariances[begin:end] = covariance[:, rows, columns]
        return errors

    def _step_back(self, number: int) -> None:
        """Go back from after a change to before it; for an update, ``A = I - (H P)^T H``."""
        kind, place = self._kinds[number], self._places[number]
        if kind == MOVED:
            back = self._transitions[place].T
            self._vector = back.dot(self._vector)
            self._matrix = back.dot(self._matrix).dot(back.T)
        if kind != CORRECTED:
            return
        whitened = self._corrections[place]  # so that the weight is identity
        design, innovation = whitened[:, :-1], whitened[:, -1]
        cross = design.dot(self._covariances[number - 1].take(self._square))
        self._vector = self._vector + design.T.dot(innovation - cross.dot(self._vector))
        half = self._matrix - self._matrix.dot(cross.T).dot(design)
        matrix = half + design.T.dot(design - cross.dot(half))
        self._matrix = 0.5 * (matrix + matrix.T)


class SmoothedRun:
    """Make the smoothed solution at any IMU sample of a run; smooths the record in place."""

    def __init__(self, config: EkfConfig, record: FlightRecord) -> None:
        self._maker = SolutionMaker(config)
        self._square, self._errors = record.square, BackwardPass(record).smoothed()
        # Keep parts only: the record's transitions and measurements are not needed any more.
        self._covariances, self._kinds = record.covariances, record.kinds
        self._steps_s, self._epochs = record.steps_s, record.epochs
        self._stamps_ns, self._marks = record.stamps_ns, record.marks

    def at(self, stamp_ns: int) -> NavSolution:
        """Return the solution at an IMU sample's stamp. Raise KeyError if there is none."""
        place = bisect.bisect_left(self._stamps_ns, stamp_ns)
        if place == len(self._stamps_ns) or self._stamps_ns[place] != stamp_ns:
            raise KeyError(stamp_ns)
        numbers = self._epochs[place].tolist()
        error, covariance = self._error(self._marks[place], numbers[0])
        vectors = [tuple(numbers[at : at + 3]) for at in range(5, 29, 3)]
        velocity_n, (latitude, longitude, height), gyro, accel, *readings = vectors
        q_nb, delay_s, step = tuple(numbers[1:5]), numbers[29], tuple(numbers[30:])
        before = NavState(q_nb, velocity_n, latitude, longitude, height, gyro, accel)
        state = feedback(before, error)
        *readings, antenna_b = readings
        receivers = Receivers(stamp_ns, antenna_b=antenna_b, imu_delay_s=delay_s).changed(error)
        solution = self._maker.make(stamp_ns, state, covariance, Readings(*readings), receivers)
        return with_pending_step(solution, step if any(step) else ())

    def _error(self, mark: int, lag_s: float) -> tuple[Array, Array]:
        """Return the smoothed error (n,) and its covariance (n, n), ``lag_s`` after a change.

        Between the ends of a step of the covariance both are interpolated linearly.
        """
        error, lower = self._errors[mark], self._covariances[mark]
        later = mark + 1
        if lag_s and later < len(self._kinds) and self._kinds[later] == MOVED:
            share = lag_s / self._steps_s[later]
            error = error + share * (self._errors[later] - error)
            lower = lower + share * (self._covariances[later] - lower)
        return error, lower.take(self._square)


class RecordingNavigation(Navigation):
    """Run the filter and record each of its runs; a new run begins with each alignment."""

    def __init__(self, config: EkfConfig) -> None:
        self._records: list[FlightRecord] = []
        super().__init__(config)

    def smoothed(self) -> list[SmoothedRun]:
        """Return the smoothed runs. Call it once, after all samples have been processed."""
        self._end_run()
        records, self._records = self._records, []
        return [SmoothedRun(self._config, record) for record in records if record.kinds]

    def _begin(self, *args: Any, **kwargs: Any) -> None:
        self._end_run()
        super()._begin(*args, **kwargs)
        self._records.append(FlightRecord(states_of(self._config)))
        self._start_up.record = self._records[-1]

    def _end_run(self) -> None:
        if self._ekf is not None:
            self._ekf.finish()


class SmoothedNavigation(Navigation):
    """Run the filter again over the recorded samples, and publish the smoothed solutions."""

    def __init__(self, config: EkfConfig, runs: Sequence[SmoothedRun]) -> None:
        self._runs = runs
        self._run = -1
        super().__init__(config)

    def _align(self, sample: NavigationInput) -> None:
        super()._align(sample)
        self._run += self._ekf is not None

    def _due_solution(self, stamp_ns: int) -> NavSolution | None:
        solution = super()._due_solution(stamp_ns)
        if solution is not None:
            solution = self._newest = self._runs[self._run].at(solution.stamp_ns)
        return solution


def smoothed(config: EkfConfig, samples: Iterable[NavigationInput]) -> SmoothedNavigation:
    """Return the estimator for the second run over samples, in order of their arrival."""
    first = RecordingNavigation(config)
    for sample in samples:
        first.process(sample)
    return SmoothedNavigation(config, first.smoothed())
