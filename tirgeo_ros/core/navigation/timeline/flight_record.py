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
"""Record the filter's steps of a run in compact arrays, as they become final, for the smoother."""

from __future__ import annotations

from array import array

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus
from tirgeo_ros.core.navigation.ins.kalman import Change, Correction
from tirgeo_ros.core.navigation.ins.propagation import Epoch
from tirgeo_ros.core.types.arrays import Array, Vector

#: Kinds of a change: how the error after it follows from the error before it.
SAME, MOVED, CORRECTED = range(3)
#: Rows of a recorded measurement; a smaller one is filled up with zeros.
MOST_ROWS = 3
_NO_STEP = (0.0, 0.0, 0.0)
#: Number of values of an epoch (see ``_epoch_values``).
EPOCH_NUMBERS = 33


class FlightRecord:
    """Hold the changes of the covariance and the states of one run: 0.6 GB an hour at 100 Hz."""

    def __init__(self, states: int) -> None:
        self.states = states
        self.lower = np.tril_indices(states)
        self.kinds = array("b")
        self.steps_s = array("d")
        self.stamps_ns = array("q")  # of each epoch
        self.marks = array("q")  # number of each epoch's newest change
        self._covariances, self._transitions = array("d"), array("d")
        self._corrections, self._epochs = array("d"), array("d")

    def keep(self, epoch: Epoch, aids: AidStatus, white_b: Vector) -> None:
        """Record the next final epoch; ``white_b``: variances of its angular rate, (rad/s)^2."""
        newest = mark = epoch.propagated.trail
        assert newest is not None
        new = []
        while mark is not None and mark.number < 0:
            new.append(mark)
            mark = mark.before
        for mark in reversed(new):
            mark.number = len(self.kinds)
            self.add(mark.change)
            mark.before = None  # recorded marks can be discarded
        self.stamps_ns.append(epoch.stamp_ns)
        self.marks.append(newest.number)
        self._epochs.extend(_epoch_values(epoch, aids, white_b))

    def add(self, change: Change) -> None:
        """Record a change; ``keep`` calls this for each change of an epoch."""
        self._covariances.frombytes(change.covariance[self.lower].tobytes())
        self.steps_s.append(change.step_s)
        kind = SAME
        if change.transition is not None:
            kind = MOVED
            self._transitions.frombytes(change.transition.tobytes())
        elif change.correction is not None:
            kind = CORRECTED
            self._corrections.frombytes(_whitened(change.correction).tobytes())
        self.kinds.append(kind)

    @property
    def covariances(self) -> Array:
        """Return the lower triangles of the covariances (changes, n (n + 1) / 2), as a view."""
        return _rows(self._covariances, len(self.lower[0]))

    @property
    def square(self) -> npt.NDArray[np.intp]:
        """Return the indices (n, n) of a symmetric matrix's entries in its lower triangle."""
        places = np.zeros((self.states, self.states), np.intp)
        places[self.lower] = places.T[self.lower] = range(len(self.lower[0]))
        return places

    @property
    def transitions(self) -> Array:
        """Return the transitions (moves, n, n), as a view."""
        return _rows(self._transitions, self.states**2).reshape(-1, self.states, self.states)

    @property
    def corrections(self) -> Array:
        """Return the whitened measurements (corrections, 3, n + 1), as a view."""
        width = self.states + 1
        return _rows(self._corrections, MOST_ROWS * width).reshape(-1, MOST_ROWS, width)

    @property
    def epochs(self) -> Array:
        """Return the values of the epochs (epochs, EPOCH_NUMBERS), as a view."""
        return _rows(self._epochs, EPOCH_NUMBERS)


def _rows(numbers: array[float], width: int) -> Array:
    return np.frombuffer(numbers).reshape(-1, width)


def _whitened(correction: Correction) -> Array:
    """Return H and innovation, side by side (3, n + 1), scaled so that the weight is identity."""
    design, weight, innovation = correction
    root = np.linalg.cholesky(weight).T
    rows = np.zeros((MOST_ROWS, design.shape[1] + 1))
    rows[: len(design), :-1] = root @ design
    rows[: len(design), -1] = root @ innovation
    return rows


def _epoch_values(epoch: Epoch, aids: AidStatus, white_b: Vector) -> tuple[float, ...]:
    """Return an epoch's lag, state, readings and the other values that a solution needs."""
    state = epoch.propagated.state
    return (
        epoch.propagated.lag_s,
        *state.q_nb,
        *state.velocity_n,
        state.latitude_rad,
        state.longitude_rad,
        state.height_m,
        *state.gyro_bias_b,
        *state.accel_bias_b,
        *epoch.force_b,
        *epoch.rate_b,
        *white_b,
        *aids.receivers.antenna_b,
        aids.receivers.imu_delay_s,
        *(aids.pending_step or _NO_STEP),
    )
