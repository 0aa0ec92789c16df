"""Fuse a sample into the filter's belief: measure it by its aid, gate it, give the verdict.

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
        self._aids = {source: aid(config) for source, aid in AIDS.items()}
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)
        self._direct = config.position_update == "rtk_direct"
        self._resets = Resets(config)
        self._gps_time_s = config.gps.position_time_s
        self._heading_time_s = config.heading.bias_time_s

    def spare(self, sample: AidSample, control: AidStatus) -> bool:
        """Return whether a sample would change nothing."""
        return self._aids[sample.source].spare(sample, control)

    def fuse(
        self,
        sample: AidSample,
        belief: StateEstimate,
        angular_rate_b: Vector,
        *,
        stale: bool = False,
        autopilot_q_nb: Array | None = None,
    ) -> Fused:
        """Return the belief with a sample in it, and the verdict.

        ``angular_rate_b`` (rad/s) has its bias removed. A ``stale`` sample repeats the value of
        the one before, so its refusal proves less against the state. The autopilot's attitude
        (4,), wxyz, is consulted where the headings contradict the state.
        """
        if self.spare(sample, belief.control):
            return Fused(Verdict(sample.source, Outcome.STANDBY, "not needed"), belief)
        control = belief.control
        receivers = control.receivers.at(sample.stamp_ns, self._gps_time_s, self._heading_time_s)
        control = control._replace(receivers=receivers)
        belief = StateEstimate(belief.state, belief.covariance, control)
        aid, belief = self._aids[sample.source].measured(sample, belief, angular_rate_b)
        if isinstance(aid, Verdict):
            return Fused(aid, belief)
        aid = aid._replace(stale=stale)
        belief, reason = _checked_rtk(sample, aid, belief)
        if reason:
            return Fused(Verdict(sample.source, Outcome.GATED, reason), belief)
        return self._judged(aid, belief, autopilot_q_nb)

    def _judged(
        self, aid: AidMeasurement, belief: StateEstimate, autopilot_q_nb: Array | None
    ) -> Fused:
        """Return the belief with a measurement in it, or without it where the gates refuse."""
        model = self._aids[aid.source]
        control, measurement = belief.control, aid.measurement
        track = control.track(aid.source).followed(aid.invariant, aid.expected)
        if model.eased and not track.recent(aid.stamp_ns, self._timeout_ns):
            track = track._replace(ease=EASE_STEPS)
        if track.ease > 1:
            measurement = measurement._replace(ease=track.ease - 1.0)
        if track.step and aid.source is Source.RTK_POSITION:
            return self._with_motion_alone(aid, belief, track)
        if track.step:
            gate_sigma = min(measurement.gate_sigma, _STEPPED_GATE_SIGMA)
            measurement = measurement._replace(gate_sigma=gate_sigma)
            aid = aid._replace(measurement=measurement)
        ratio, error, updated, predicted, correction = update(belief.covariance, measurement)
        reason = "refused" if error is None else ""
        track, reason = model.averaged(track, measurement, predicted, reason)
        if reason or error is None or updated is None:
            track = self._refused(aid, track)
            reason = model.off(aid, track) if error is None else reason
            belief = belief._replace(control=control.with_track(aid.source, track))
            reset = model.after_refusal(aid, belief) or self._resets.after_refusal(
                aid, belief, model.resets, autopilot_q_nb
            )
            if reset is None:
                return Fused(_verdict(aid, Outcome.GATED, reason, ratio), belief)
            return Fused(_verdict(aid, Outcome.RESET, str(reset.control.last_reset), ratio), reset)
        changes: tuple[Change, ...] = (Change(updated, correction=correction),)
        if self._direct and aid.source is Source.RTK_POSITION:
            error, updated = _with_rtk_position(error, updated, measurement)
            changes = (*changes, Change(updated, cut(len(error), POSITION)))
        track = track.used(aid.stamp_ns, self._timeout_ns, aid.invariant)
        belief = belief._replace(control=control.with_track(aid.source, track))
        return Fused(_verdict(aid, Outcome.USED, "", ratio), _corrected(belief, error, changes))

    def _refused(self, aid: AidMeasurement, track: AidTrack) -> AidTrack:
        """Return the record after a refusal.

        A position that returns after a silence meets a state that has drifted, so its difference
        is no step. A heading that returns is compared with the gyroscopes, which drift little: its
        difference is a step.
        """
        step: tuple[float, ...] = ()
        seen = track.step or track.denied or track.recent(aid.stamp_ns, self._timeout_ns)
        if seen and self._aids[aid.source].steps:
            step = track.stepped(aid.invariant, aid.expected)
        elif not seen and aid.source is Source.RTK_HEADING and track.newest:
            step = tuple(map(operator.sub, aid.invariant, aid.expected))
        return track.refused(aid.stamp_ns, aid.invariant, aid.slack, stale=aid.stale, step=step)

    def _with_motion_alone(
        self, aid: AidMeasurement, belief: StateEstimate, track: AidTrack
    ) -> Fused:
        """Return the belief after a position that has stepped: only its motion is used.

        The motion that a receiver reports stays right when its solution jumps. After a while
        without a step back the place becomes as uncertain as the step is large, and the next
        position decides; a large step resets the position instead.
        """
        plain = aid.measurement
        ratio = update(belief.covariance, plain).test_ratio
        track = self._refused(aid, track)
        off = self._aids[aid.source].off(aid, track)
        control = belief.control.with_track(aid.source, track)
        belief = belief._replace(control=control)
        accepted = self._resets.after_step(aid, belief)
        if accepted is None:
            innovation = plain.innovation - np.array(track.step)
            _, error, updated, _, correction = update(
                belief.covariance, plain._replace(innovation=innovation)
            )
            if error is not None and updated is not None:
                belief = _corrected(belief, error, (Change(updated, correction=correction),))
        elif accepted.control.resets != control.resets:
            reason = str(accepted.control.last_reset)
            return Fused(_verdict(aid, Outcome.RESET, reason, ratio), accepted)
        return Fused(_verdict(aid, Outcome.GATED, off, ratio), accepted or belief)


def _checked_rtk(
    sample: AidSample, aid: AidMeasurement, belief: StateEstimate
) -> tuple[StateEstimate, str]:
    """Compare RTK positions and velocities; return the belief and why one is refused."""
    rtk, (innovation, _, noise, *_) = belief.control.rtk, aid.measurement
    if aid.source is Source.RTK_POSITION and isinstance(sample, PositionSample):
        rtk = rtk.with_fix(sample, noise)
    elif aid.source is Source.RTK_VELOCITY and isinstance(sample, VelocitySample):
        against_imu_n = added(innovation.tolist(), belief.state.push_n)
        rtk = rtk.with_velocity(sample, noise, against_imu_n)
    else:
        return belief, ""
    return belief._replace(control=belief.control._replace(rtk=rtk)), rtk.reason(aid.source)


def _corrected(belief: StateEstimate, error: Array, changes: tuple[Change, ...]) -> StateEstimate:
    """Return the belief after a correction of the state and the receivers by an error (n,)."""
    at = heading_error(len(error))
    turned = 0.0 if at is None else float(error[at])
    moved = error[ANTENNA].tolist() if has_antenna(len(error)) else (0.0, 0.0, 0.0)
    receivers = belief.control.receivers.changed(error[GPS_ERROR].tolist(), turned, moved)
    control = belief.control._replace(receivers=receivers)
    state = feedback(belief.state, error)
    return StateEstimate(state, changes[-1].covariance, control, changes)


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
