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
"""Define the filter's estimate, and ``Aid``, the base class of the filter's aids.

Each aid is a subclass of ``Aid`` in the module of its subject.
"""

from __future__ import annotations

import math
import operator
from typing import Any, ClassVar, NamedTuple

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid_status import STEPPED_S, AidStatus, AidTrack
from tirgeo_ros.core.navigation.ins.error_states import DELAY, feedback, states_of
from tirgeo_ros.core.navigation.ins.kalman import (
    Change,
    Measurement,
    Update,
    chi_square_limit,
    cut,
    update,
)
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    AutopilotHeading,
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    PressureSample,
    Rest,
    SetHeading,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: Longest contradiction that a reset needs. Repeated values always need it: most likely the
#: receiver is frozen, and the aircraft hovers.
LONGEST_PATIENCE_S = 60.0
#: Least heading sigma of a lost state, over the autopilot's sigma: with a margin above the ratio
#: at which the autopilot's heading is used (``nose_heading``).
_LOST_SIGMAS = 3.5
#: While RTK is used, errors of other aids are learned at this interval: a second less jitter.
_LEARNING_NS = 950_000_000

Aiding = PositionSample | VelocitySample | HeadingSample | PressureSample | SetHeading
#: ``Aiding``, and what the filter takes from the IMU's messages.
AidSample = Aiding | AutopilotHeading | Rest


class StateEstimate(NamedTuple):
    """Hold the state, the covariance (n, n) of its error, and the records of the aids.

    ``changes`` are those of the covariance that the newest measurement caused.
    """

    state: NavState
    covariance: Array
    aids: AidStatus
    changes: tuple[Change, ...] = ()

    def corrected(self, error: Array, changes: tuple[Change, ...]) -> StateEstimate:
        """Return the estimate with the state and the receivers corrected by an error (n,)."""
        aids = self.aids._replace(receivers=self.aids.receivers.changed(error))
        state, changes = feedback(self.state, error), (*self.changes, *changes)
        return StateEstimate(state, changes[-1].covariance, aids, changes)

    def without_delay(self) -> StateEstimate:
        """Return the estimate under the condition that the IMU's delay is the configured one."""
        design = np.zeros((1, len(self.covariance)))
        design[0, DELAY] = 1.0
        off = np.array((-self.aids.receivers.imu_delay_s,))
        exact = Measurement(off, design, np.zeros((1, 1)), math.inf)
        _, error, covariance, _, correction = update(self.covariance, exact)
        assert error is not None
        assert covariance is not None
        covariance = uncorrelated(covariance, slice(DELAY, DELAY + 1))  # zero but for rounding
        return self.corrected(error, (Change(covariance, correction=correction),))


class Fused(NamedTuple):
    """Hold the verdict on a sample and the estimate after it."""

    verdict: Verdict
    estimate: StateEstimate


class AidMeasurement(NamedTuple):
    """Hold a measurement for the update, and numbers to compare its refusal with earlier ones."""

    source: Source
    stamp_ns: int
    measurement: Measurement
    invariant: tuple[float, ...]  # innovation, in a form that motion does not change
    expected: tuple[float, ...]  # the invariant of an innovation of zero
    slack: float  # largest difference of two invariants that have the same cause
    stale: bool = False  # the sample repeats the value of the previous one
    autopilot_q_nb: Array | None = None  # (4,) wxyz, consulted if headings contradict the state

    def verdict(self, outcome: Outcome, reason: str, ratio: float) -> Verdict:
        """Return the verdict on the measurement, with its numbers; ``ratio`` is the test ratio."""
        innovation = tuple(self.measurement.innovation.tolist())
        degrees = len(innovation)
        limit = chi_square_limit(self.measurement.gate_sigma, degrees)
        return Verdict(self.source, outcome, reason, ratio, innovation, ratio * limit / degrees)


#: A measurement, or the verdict on a sample that is not used; and the estimate.
Modelled = tuple[AidMeasurement | Verdict, StateEstimate]
Corrected = tuple[Array, tuple[Change, ...]]  # see ``Aid.correction``


def not_fixed(source: Source, status: FixStatus) -> Verdict:
    """Return the verdict on a sample of a receiver without a good enough fix."""
    return Verdict(source, Outcome.NOT_FIXED, f"status {status.name.lower()}")


def added(a: Vector, b: Vector) -> Vector:
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def floored(covariance: Array, sigma: float) -> Array:
    """Return a covariance (3, 3) with sigmas >= ``sigma``; diagonal if a variance is absent."""
    a, b, c = covariance[0, 0], covariance[1, 1], covariance[2, 2]
    least = sigma * sigma
    if a >= least and b >= least and c >= least:
        return covariance
    if a <= 0 or b <= 0 or c <= 0:
        return np.diag(np.maximum((a, b, c), least))
    return np.asarray(covariance + np.diag(np.maximum((least - a, least - b, least - c), 0.0)))


class Aid:
    """Declare one aid: its measurement, noise, gate and resets. ``fusion.AIDS`` lists the aids."""

    source: ClassVar[Source]
    #: The parameter that holds its delay: stamp minus time of measurement.
    delay: ClassVar[str] = ""
    #: The parameters to check if innovations are much larger than their sigma.
    look_at: ClassVar[str] = ""
    unit: ClassVar[str] = "m"
    #: Words that describe a reset to this aid; its size follows them.
    moved: ClassVar[str] = ""
    #: Whether a step of the innovation, unlike a drift, counts as a fault of this aid.
    steps: ClassVar[bool] = False
    #: Whether it is eased in after a silence, so that the map does not move in one step.
    eased: ClassVar[bool] = False
    #: The error states that a reset sets as measured, after a long contradiction.
    resets: ClassVar[slice | None] = None
    #: Whether a delay of the IMU's stamps matters to it: not to what the IMU itself measures.
    by_delay: ClassVar[bool] = True
    #: Whether its samples are taken from the IMU's messages (``of_imu``).
    in_imu: ClassVar[bool] = False

    def __init__(self, config: EkfConfig) -> None:
        """Take the parameters. Raises ConfigError if they cannot be used."""
        self._config = config
        self._states = states_of(config)
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)

    @classmethod
    def delay_s(cls, config: EkfConfig) -> float:
        """Return stamp minus time of measurement, s; 0 without a parameter."""
        return float(operator.attrgetter(cls.delay)(config)) if cls.delay else 0.0

    @classmethod
    def useless(cls, _sample: Any, _config: EkfConfig) -> Verdict | None:
        """Return the verdict on a sample that can improve no state, else None."""
        return None

    def of_imu(self, _imu: ImuSample, _covariance: Array) -> AidSample | None:
        """Return the aid's sample in an IMU message; None if it is absent or not needed."""
        return None

    def learned(self, sample: Aiding, aids: AidStatus) -> bool:
        """Return whether RTK is fixed and used, and taught this aid's error within a second."""
        now_ns, own, rtk = (
            sample.stamp_ns,
            aids.track(self.source),
            aids.track(Source.RTK_POSITION),
        )
        in_use = aids.rtk.status is FixStatus.FIXED and rtk.recent(now_ns, self._timeout_ns)
        return in_use and own.recent(now_ns, _LEARNING_NS)

    def spare(self, _sample: Any, _aids: AidStatus) -> bool:
        """Return whether a sample changes nothing and can be skipped (verdict STANDBY)."""
        return False

    def measured(self, sample: Any, estimate: StateEstimate, angular_rate_b: Vector) -> Modelled:
        """Return the measurement, or the verdict on a sample that is not used, and the estimate.

        ``angular_rate_b`` (rad/s) has its bias removed. Only the records in the estimate may
        change.
        """
        raise NotImplementedError

    def widened(
        self, sample: Aiding, estimate: StateEstimate, block: slice, beyond: Array, time_s: float
    ) -> StateEstimate:
        """Return the estimate with reported variances beyond the state's in a slow error.

        Of ``beyond`` (3,) it gets what a Gauss-Markov process takes up since the last sample.
        """
        if not beyond.any():
            return estimate
        since_ns = sample.stamp_ns - estimate.aids.track(self.source).judged_ns
        covariance = estimate.covariance.copy()
        share = -math.expm1(-2e-9 * max(since_ns, 0) / time_s)
        covariance[block, block] += np.diag(share * beyond)
        return StateEstimate(estimate.state, covariance, estimate.aids, (Change(covariance),))

    def averaged(
        self, track: AidTrack, _measurement: Measurement, _predicted: Array, reason: str
    ) -> tuple[AidTrack, str]:
        """Return the record with one more innovation, and why that is refused, or ""."""
        return track, reason

    def correction(self, _measurement: Measurement, result: Update) -> Corrected:
        """Return the error (n,) to correct by, and the changes of the covariance."""
        assert result.error is not None
        assert result.covariance is not None
        return result.error, (Change(result.covariance, correction=result.correction),)

    def off(self, aid: AidMeasurement, track: AidTrack) -> str:
        """Describe how far a measurement is off; after a step, how large the step is."""
        size = math.hypot(*track.step) or float(np.linalg.norm(aid.measurement.innovation))
        return f"{size:.1f} {self.unit} off"

    def refused(self, aid: AidMeasurement, track: AidTrack) -> AidTrack:
        """Return the record after a refusal."""
        step = self.step(aid, track)
        return track.refused(aid.stamp_ns, aid.invariant, aid.slack, stale=aid.stale, step=step)

    def step(self, aid: AidMeasurement, track: AidTrack) -> tuple[float, ...]:
        """Return the innovation's step that led to a refusal; empty if the innovation drifted.

        After a silence the state has drifted: a difference from it is no step of the aid.
        """
        lately = track.step or track.denied or track.recent(aid.stamp_ns, self._timeout_ns)
        return track.stepped(aid.invariant, aid.expected) if self.steps and lately else ()

    def after_step(
        self, _aid: AidMeasurement, _estimate: StateEstimate, _track: AidTrack
    ) -> Fused | None:
        """Return the result of a measurement while its aid has stepped; None: gate it narrowly."""
        return None

    def after_refusal(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate | None:
        """Return the estimate reset to a measurement that was refused for long; None: too early.

        Only measurements that agree with each other count. A single position that jumps has no
        effect; positions of a receiver that is frozen while the aircraft moves never agree.
        """
        run = estimate.aids.track(aid.source).run
        if run is None:
            return None
        lasts = run.lasts(LONGEST_PATIENCE_S if aid.stale else self.patience_s(aid, estimate))
        return self.reset(aid, estimate) if lasts else None

    def patience_s(self, aid: AidMeasurement, estimate: StateEstimate) -> float:
        """Return how long a run of refusals must last; infinite if it must not cause a reset."""
        reset_after_s = self._config.rtk.reset_after_s
        stepped = estimate.aids.track(aid.source).step
        return max(STEPPED_S, reset_after_s) if stepped else reset_after_s

    def reset(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate | None:
        """Return the estimate with only the states of ``resets`` set as measured."""
        if self.resets is None:
            return None
        innovation = aid.measurement.innovation
        covariance = uncorrelated(estimate.covariance, self.resets)
        covariance[self.resets, self.resets] = aid.measurement.noise
        error = np.zeros(len(covariance))
        error[self.resets] = innovation
        aids = self.with_reset(estimate.aids, aid.stamp_ns, float(np.linalg.norm(innovation)))
        changes = (Change(covariance, cut(len(covariance), self.resets)),)
        return StateEstimate(feedback(estimate.state, error), covariance, aids, changes)

    def blamed(
        self, aid: AidMeasurement, estimate: StateEstimate, own: slice, of: slice, sign: float
    ) -> StateEstimate:
        """Return the estimate with the aid's own error set as measured; the state stays.

        What is measured is the states ``of`` plus ``sign`` times the states ``own``, so an error
        in one is that of the other, times ``-sign``.
        """
        innovation = aid.measurement.innovation
        covariance = uncorrelated(estimate.covariance, own)
        transition, error = cut(len(covariance), own), np.zeros(len(covariance))
        covariance[own, own] = aid.measurement.noise
        covariance[own, :] -= sign * covariance[of, :]
        covariance[:, own] -= sign * covariance[:, of]
        transition[own, of] = -sign * np.eye(len(innovation))
        error[own] = sign * innovation
        aids = estimate.aids._replace(receivers=estimate.aids.receivers.changed(error))
        aids = self.with_reset(aids, aid.stamp_ns, float(np.linalg.norm(innovation)))
        return StateEstimate(estimate.state, covariance, aids, (Change(covariance, transition),))

    def with_reset(self, aids: AidStatus, now_ns: int, size: float) -> AidStatus:
        """Return the records after a reset by ``size``."""
        return aids.with_reset(self.source, now_ns, self.reset_text(size))

    def reset_text(self, size: float) -> str:
        """Describe a reset; ``size`` in m, m/s or rad."""
        return f"{self.moved} {size:.2f} {self.unit}"


def lost_heading_rad(config: EkfConfig) -> float:
    """Return the standard deviation of the heading, rad, beyond which a state is lost."""
    least_deg = _LOST_SIGMAS * config.autopilot.attitude_sigma_deg[2]
    return math.radians(max(config.trust.lost_heading_sigma_deg, least_deg))


def uncorrelated(covariance: Array, block: slice) -> Array:
    """Return a copy with all variances and covariances of the block's states set to zero."""
    covariance = covariance.copy()
    covariance[block, :] = 0.0
    covariance[:, block] = 0.0
    return covariance
