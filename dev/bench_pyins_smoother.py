"""Smooth the filter of pyins by its own matrices, as a reference for our smoother.

pyins has had no smoother of its own since its version 1.0. Here its feedback filter is run as it
is, its covariances and transitions are noted on the way, and its states are smoothed backwards in
time by the recursion of Rauch, Tung and Striebel.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np

from dev.bench_pyins import PyinsRun, errors_of_pyins
from dev.flight_errors import Errors
from tirgeo_ros.core.types.arrays import Array


class _Notes:
    """Hold what pyins computes at each of its instants: there it corrects, then propagates."""

    def __init__(self) -> None:
        self.predicted: list[Array] = []  # covariances before and after the corrections
        self.corrected: list[Array] = []
        self.error: list[Array] = []  # fed back
        self.transition: list[Array] = []  # to the next instant

    def begin(self, covariance: Array) -> None:
        """Note the covariance of an instant, nothing corrected yet."""
        self.predicted.append(covariance)
        self.corrected.append(covariance)
        self.error.append(np.zeros(len(covariance)))

    def smoothed(self) -> list[Array]:
        """Return the errors of the states after the corrections, smoothed."""
        found = [np.zeros_like(self.error[-1])]
        for number in reversed(range(len(self.transition) - 1)):
            later = number + 1
            cross = self.transition[number] @ self.corrected[number]
            gain = np.linalg.solve(self.predicted[later], cross).T
            found.append(gain @ (self.error[later] + found[-1]))
        return found[::-1]


@contextmanager
def _noting() -> Iterator[_Notes]:
    """Note the matrices of a filter that is run inside."""
    filters: Any = importlib.import_module("pyins.filters")
    notes = _Notes()
    begin, correct, move = (
        filters._initialize_covariance,  # noqa: SLF001 there is no public way to its matrices
        filters.kalman.correct,
        filters._compute_error_propagation_matrices,  # noqa: SLF001 the same
    )

    def begun(*args: Any) -> Array:
        covariance: Array = begin(*args)
        notes.begin(covariance)
        return covariance

    def corrected(*args: Any) -> Any:
        found = correct(*args)
        notes.error[-1], notes.corrected[-1] = found[0], found[1]
        return found

    def moved(*args: Any) -> Any:
        transition, noise = move(*args)
        notes.transition.append(transition)
        notes.begin(transition @ notes.corrected[-1] @ transition.T + noise)
        return transition, noise

    with (
        patch.object(filters, "_initialize_covariance", begun),
        patch.object(filters.kalman, "correct", corrected),
        patch.object(filters, "_compute_error_propagation_matrices", moved),
    ):
        yield notes


def smoothed_pyins(run: PyinsRun) -> Any:
    """Run the filter and smooth it; return the trajectory (a table) at the filter's instants."""
    pandas = importlib.import_module("pandas")
    error_model = importlib.import_module("pyins.error_model")
    with _noting() as notes:
        result = run.run()
    model = error_model.InsErrorModel()
    rows = result.trajectory.loc[result.gyro.index]
    found = [
        model.correct_pva(row, error[: model.n_states])
        for (_, row), error in zip(rows.iterrows(), notes.smoothed(), strict=True)
    ]
    return pandas.DataFrame(found, index=rows.index)


def pyins_smoother_errors(run: PyinsRun, table: Any) -> Errors:
    """Return the errors of a smoothed trajectory, at pyins' own instants of ten a second."""
    stamps = np.array(run.stamp_ns)
    wanted = stamps[0] + np.round(np.asarray(table.index) * 1e9).astype(np.int64)
    nearest = np.abs(stamps[:, None] - wanted).argmin(axis=0)
    return errors_of_pyins(run.flight, stamps[nearest].tolist(), table)
