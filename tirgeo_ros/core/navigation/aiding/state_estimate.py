"""Define the filter's estimate, and a measurement of an aid as it is applied to it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus
from tirgeo_ros.core.navigation.ins.ins_error_model import (
    ANTENNA,
    GPS_ERROR,
    feedback,
    has_antenna,
    heading_error,
)
from tirgeo_ros.core.navigation.ins.kalman import Change, Measurement, chi_square_limit
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    AutopilotHeading,
    FixStatus,
    HeadingSample,
    PositionSample,
    PressureSample,
    SetHeading,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

Aiding = PositionSample | VelocitySample | HeadingSample | PressureSample | SetHeading
#: The same, and the heading that the filter takes from the IMU's messages.
AidSample = Aiding | AutopilotHeading


class StateEstimate(NamedTuple):
    """Hold the state, the covariance (n, n) of its error, and the records of the aids.

    ``changes`` are those by which a measurement has led to it.
    """

    state: NavState
    covariance: Array
    aids: AidStatus
    changes: tuple[Change, ...] = ()

    def corrected(self, error: Array, changes: tuple[Change, ...]) -> StateEstimate:
        """Return the estimate with the state and the receivers corrected by an error (n,)."""
        at = heading_error(len(error))
        turned = 0.0 if at is None else float(error[at])
        moved = error[ANTENNA].tolist() if has_antenna(len(error)) else (0.0, 0.0, 0.0)
        receivers = self.aids.receivers.changed(error[GPS_ERROR].tolist(), turned, moved)
        aids = self.aids.changed(receivers)
        return StateEstimate(feedback(self.state, error), changes[-1].covariance, aids, changes)


class Fused(NamedTuple):
    """Hold the verdict on a sample and the estimate after it."""

    verdict: Verdict
    estimate: StateEstimate


class AidMeasurement(NamedTuple):
    """Hold a measurement for the update, with the numbers by which its refusals are compared."""

    source: Source
    stamp_ns: int
    measurement: Measurement
    invariant: tuple[float, ...]  # innovation, in a form that motion does not change
    expected: tuple[float, ...]  # the same for an innovation of zero
    slack: float  # by which two of them with one cause may differ
    stale: bool = False  # the sample repeats the value of the one before

    def verdict(self, outcome: Outcome, reason: str, ratio: float) -> Verdict:
        """Return the verdict on it, with its numbers; ``ratio`` is that of its test."""
        innovation = tuple(self.measurement.innovation.tolist())
        degrees = len(innovation)
        limit = chi_square_limit(self.measurement.gate_sigma, degrees)
        return Verdict(self.source, outcome, reason, ratio, innovation, ratio * limit / degrees)


#: A measurement, or the verdict on a sample that is not used; and the estimate.
Modelled = tuple[AidMeasurement | Verdict, StateEstimate]


def not_fixed(source: Source, status: FixStatus) -> Verdict:
    """Return the verdict on a sample of a receiver without a good enough fix."""
    return Verdict(source, Outcome.NOT_FIXED, f"status {status.name.lower()}")


def added(a: Vector, b: Vector) -> Vector:
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def floored(covariance: Array, sigma: float) -> Array:
    """Return a covariance (3, 3) with standard deviations of at least ``sigma`` on its axes.

    Where a variance is absent (zero or negative) the floor replaces it, and the result is
    diagonal.
    """
    a, b, c = covariance[0, 0], covariance[1, 1], covariance[2, 2]
    least = sigma * sigma
    if a >= least and b >= least and c >= least:
        return covariance
    if a <= 0 or b <= 0 or c <= 0:
        return np.diag(np.maximum((a, b, c), least))
    return np.asarray(covariance + np.diag(np.maximum((least - a, least - b, least - c), 0.0)))
