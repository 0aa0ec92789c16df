"""What the filter believes, and what a measurement asks of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.navigation.aiding.aid_status import Control
from tirgeo_ros.core.navigation.kalman import Measurement
from tirgeo_ros.core.navigation.strapdown import NavState, Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    AutopilotHeading,
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

Aiding = PositionSample | VelocitySample | HeadingSample
#: With what the filter has from the IMU's own messages.
Aidlike = Aiding | AutopilotHeading


class Belief(NamedTuple):
    """State, covariance (n, n) of its error, and what the aids have done."""

    state: NavState
    covariance: Array
    control: Control


class Fused(NamedTuple):
    """The belief after a sample, changed or not, and why."""

    verdict: Verdict
    belief: Belief


class Aid(NamedTuple):
    """A measurement that fits the belief, with what its refusal would be judged by."""

    source: Source
    stamp_ns: int
    measurement: Measurement
    invariant: tuple[float, ...]  # the innovation in a form that motion does not change
    expected: tuple[float, ...]  # the same of an innovation of zero
    slack: float  # by which such innovations of one cause may differ
    stale: bool = False  # the sample says what the one before said


def refused(sample: Aidlike, belief: Belief, outcome: Outcome, reason: str) -> Fused:
    """The same belief after a sample that is not for use now."""
    return Fused(Verdict(source_of(sample), outcome, reason), belief)


def not_fixed(source: Source, status: FixStatus) -> Verdict:
    """The verdict on a sample of a receiver without a good enough fix."""
    return Verdict(source, Outcome.NOT_FIXED, f"status {status.name.lower()}")


def source_of(sample: Aidlike) -> Source:
    """Where an aiding sample comes from."""
    if isinstance(sample, AutopilotHeading):
        return Source.AUTOPILOT_HEADING
    return Source.RTK_HEADING if isinstance(sample, HeadingSample) else sample.source


def added(a: Vector, b: Vector) -> Vector:
    """The sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def floored(covariance: Array, sigma: float) -> Array:
    """A covariance (3, 3) whose axes are believed no better than ``sigma``.

    Where variances are absent (zero or negative) the floor stands for them.
    """
    a, b, c = covariance[0, 0], covariance[1, 1], covariance[2, 2]
    least = sigma * sigma
    if a >= least and b >= least and c >= least:
        return covariance
    if a <= 0 or b <= 0 or c <= 0:
        return np.diag(np.maximum((a, b, c), least))
    return np.asarray(covariance + np.diag(np.maximum((least - a, least - b, least - c), 0.0)))
