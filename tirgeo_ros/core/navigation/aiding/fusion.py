"""Fuse a sample into the filter's estimate: measure it by its aid, gate it, give the verdict.

The aids (``aids``) hold what differs between sources; records, easing, steps and resets are the
same for all.
"""

from __future__ import annotations

import operator

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid_status import EASE_STEPS, AidStatus, AidTrack
from tirgeo_ros.core.navigation.aiding.aids import AIDS
from tirgeo_ros.core.navigation.aiding.state_estimate import (
    AidMeasurement,
    AidSample,
    Fused,
    StateEstimate,
    added,
)
from tirgeo_ros.core.navigation.aiding.state_reset import Resets
from tirgeo_ros.core.navigation.ins.ins_error_model import (
    ANTENNA,
    GPS_ERROR,
    POSITION,
    feedback,
    has_antenna,
    heading_error,
)
from tirgeo_ros.core.navigation.ins.kalman import Measurement, chi_square_limit, update
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.navigation.ins.trail import Change, cut
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import PositionSample, Source, VelocitySample
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: Gate of a heading or velocity that has stepped: it passes only if the state may be off by as
#: much.
_STEPPED_GATE_SIGMA = 2.0


class Fusion:
    """Convert samples to measurements and fuse them."""

    def __init__(self, config: EkfConfig) -> None:
        self._models = {source: aid(config) for source, aid in AIDS.items()}
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)
        self._direct = config.position_update == "rtk_direct"
        self._resets = Resets(config)
        self._gps_time_s = config.gps.position_time_s
        self._heading_time_s = config.heading.bias_time_s

    def spare(self, sample: AidSample, aids: AidStatus) -> bool:
        """Return whether a sample would change nothing."""
        return self._models[sample.source].spare(sample, aids)

    def fuse(
        self,
        sample: AidSample,
        estimate: StateEstimate,
        angular_rate_b: Vector,
        *,
        stale: bool = False,
        autopilot_q_nb: Array | None = None,
    ) -> Fused:
        """Return the estimate with a sample in it, and the verdict.

        ``angular_rate_b`` (rad/s) has its bias removed. A ``stale`` sample repeats the value of
        the one before, so its refusal proves less against the state. The autopilot's attitude
        (4,), wxyz, is consulted where the headings contradict the state.
        """
        if self.spare(sample, estimate.aids):
            return Fused(Verdict(sample.source, Outcome.STANDBY, "not needed"), estimate)
        aids = estimate.aids
        receivers = aids.receivers.at(sample.stamp_ns, self._gps_time_s, self._heading_time_s)
        aids = aids._replace(receivers=receivers)
        estimate = StateEstimate(estimate.state, estimate.covariance, aids)
        aid, estimate = self._models[sample.source].measured(sample, estimate, angular_rate_b)
        if isinstance(aid, Verdict):
            return Fused(aid, estimate)
        aid = aid._replace(stale=stale)
        estimate, reason = _checked_rtk(sample, aid, estimate)
        if reason:
            return Fused(Verdict(sample.source, Outcome.GATED, reason), estimate)
        return self._judged(aid, estimate, autopilot_q_nb)

    def _judged(
        self, aid: AidMeasurement, estimate: StateEstimate, autopilot_q_nb: Array | None
    ) -> Fused:
        """Return the estimate with a measurement in it, or without it where the gates refuse."""
        model = self._models[aid.source]
        aids, measurement = estimate.aids, aid.measurement
        track = aids.track(aid.source).followed(aid.invariant, aid.expected)
        if model.eased and not track.recent(aid.stamp_ns, self._timeout_ns):
            track = track._replace(ease=EASE_STEPS)
        if track.ease > 1:
            measurement = measurement._replace(ease=track.ease - 1.0)
        if track.step and aid.source is Source.RTK_POSITION:
            return self._with_motion_alone(aid, estimate, track)
        if track.step:
            gate_sigma = min(measurement.gate_sigma, _STEPPED_GATE_SIGMA)
            measurement = measurement._replace(gate_sigma=gate_sigma)
            aid = aid._replace(measurement=measurement)
        ratio, error, updated, predicted, correction = update(estimate.covariance, measurement)
        reason = "refused" if error is None else ""
        track, reason = model.averaged(track, measurement, predicted, reason)
        if reason or error is None or updated is None:
            track = self._refused(aid, track)
            reason = model.off(aid, track) if error is None else reason
            estimate = estimate._replace(aids=aids.with_track(aid.source, track))
            reset = model.after_refusal(aid, estimate) or self._resets.after_refusal(
                aid, estimate, model.resets, autopilot_q_nb
            )
            if reset is None:
                return Fused(_verdict(aid, Outcome.GATED, reason, ratio), estimate)
            return Fused(_verdict(aid, Outcome.RESET, str(reset.aids.last_reset), ratio), reset)
        changes: tuple[Change, ...] = (Change(updated, correction=correction),)
        if self._direct and aid.source is Source.RTK_POSITION:
            error, updated = _with_rtk_position(error, updated, measurement)
            changes = (*changes, Change(updated, cut(len(error), POSITION)))
        track = track.used(aid.stamp_ns, self._timeout_ns, aid.invariant)
        estimate = estimate._replace(aids=aids.with_track(aid.source, track))
        return Fused(_verdict(aid, Outcome.USED, "", ratio), _corrected(estimate, error, changes))

    def _refused(self, aid: AidMeasurement, track: AidTrack) -> AidTrack:
        """Return the record after a refusal.

        A position that returns after a silence meets a state that has drifted, so its difference
        is no step. A heading that returns is compared with the gyroscopes, which drift little: its
        difference is a step.
        """
        step: tuple[float, ...] = ()
        seen = track.step or track.denied or track.recent(aid.stamp_ns, self._timeout_ns)
        if seen and self._models[aid.source].steps:
            step = track.stepped(aid.invariant, aid.expected)
        elif not seen and aid.source is Source.RTK_HEADING and track.newest:
            step = tuple(map(operator.sub, aid.invariant, aid.expected))
        return track.refused(aid.stamp_ns, aid.invariant, aid.slack, stale=aid.stale, step=step)

    def _with_motion_alone(
        self, aid: AidMeasurement, estimate: StateEstimate, track: AidTrack
    ) -> Fused:
        """Return the estimate after a position that has stepped: only its motion is used.

        The motion that a receiver reports stays right when its solution jumps. After a while
        without a step back the place becomes as uncertain as the step is large, and the next
        position decides; a large step resets the position instead.
        """
        plain = aid.measurement
        ratio = update(estimate.covariance, plain).test_ratio
        track = self._refused(aid, track)
        off = self._models[aid.source].off(aid, track)
        aids = estimate.aids.with_track(aid.source, track)
        estimate = estimate._replace(aids=aids)
        accepted = self._resets.after_step(aid, estimate)
        if accepted is None:
            innovation = plain.innovation - np.array(track.step)
            _, error, updated, _, correction = update(
                estimate.covariance, plain._replace(innovation=innovation)
            )
            if error is not None and updated is not None:
                estimate = _corrected(estimate, error, (Change(updated, correction=correction),))
        elif accepted.aids.resets != aids.resets:
            reason = str(accepted.aids.last_reset)
            return Fused(_verdict(aid, Outcome.RESET, reason, ratio), accepted)
        return Fused(_verdict(aid, Outcome.GATED, off, ratio), accepted or estimate)


def _checked_rtk(
    sample: AidSample, aid: AidMeasurement, estimate: StateEstimate
) -> tuple[StateEstimate, str]:
    """Compare RTK positions and velocities; return the estimate and why one is refused."""
    rtk, (innovation, _, noise, *_) = estimate.aids.rtk, aid.measurement
    if aid.source is Source.RTK_POSITION and isinstance(sample, PositionSample):
        rtk = rtk.with_fix(sample, noise)
    elif aid.source is Source.RTK_VELOCITY and isinstance(sample, VelocitySample):
        against_imu_n = added(innovation.tolist(), estimate.state.push_n)
        rtk = rtk.with_velocity(sample, noise, against_imu_n)
    else:
        return estimate, ""
    return estimate._replace(aids=estimate.aids._replace(rtk=rtk)), rtk.reason(aid.source)


def _corrected(
    estimate: StateEstimate, error: Array, changes: tuple[Change, ...]
) -> StateEstimate:
    """Return the estimate after a correction of the state and the receivers by an error (n,)."""
    at = heading_error(len(error))
    turned = 0.0 if at is None else float(error[at])
    moved = error[ANTENNA].tolist() if has_antenna(len(error)) else (0.0, 0.0, 0.0)
    receivers = estimate.aids.receivers.changed(error[GPS_ERROR].tolist(), turned, moved)
    aids = estimate.aids._replace(receivers=receivers)
    state = feedback(estimate.state, error)
    return StateEstimate(state, changes[-1].covariance, aids, changes)


def _verdict(aid: AidMeasurement, outcome: Outcome, reason: str, ratio: float) -> Verdict:
    """Return the verdict on a measurement, with its numbers."""
    innovation = tuple(aid.measurement.innovation.tolist())
    degrees = len(innovation)
    limit = chi_square_limit(aid.measurement.gate_sigma, degrees)
    return Verdict(aid.source, outcome, reason, ratio, innovation, ratio * limit / degrees)


def _with_rtk_position(
    error: Array, covariance: Array, measurement: Measurement
) -> tuple[Array, Array]:
    """Replace the position by that of RTK as it is; the other states are filtered.

    This is the cycle of Ren et al. 2022 (section 3.3), ``position_update: rtk_direct``.
    """
    error, covariance = error.copy(), covariance.copy()
    error[POSITION] = measurement.innovation
    covariance[POSITION, :] = 0.0
    covariance[:, POSITION] = 0.0
    covariance[POSITION, POSITION] = measurement.noise
    return error, covariance
