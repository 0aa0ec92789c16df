"""A sample into the belief: the right measurement, its gate, its verdict.

RTK positions are used from float on and RTK velocities with them, headings only while the
position is fixed. The ordinary GPS steps in where RTK is gone.
"""

from __future__ import annotations

from tirgeo_ros.core.aiding.belief import Aid, Aiding, Belief, Fused, not_fixed, refused
from tirgeo_ros.core.aiding.control import EASE_STEPS, Control, Track
from tirgeo_ros.core.aiding.gps import GpsPosition
from tirgeo_ros.core.aiding.heading import Headings
from tirgeo_ros.core.aiding.position import RtkPosition
from tirgeo_ros.core.aiding.resets import Resets
from tirgeo_ros.core.aiding.velocity import Velocities
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.error_state import GPS_ERROR, HEADING_ERROR, POSITION, feedback, states_of
from tirgeo_ros.core.kalman import Measurement, update
from tirgeo_ros.core.samples import (
    Array,
    FixStatus,
    HeadingSample,
    Outcome,
    PositionSample,
    Source,
    VelocitySample,
    Verdict,
)
from tirgeo_ros.core.strapdown import Vector

#: Aids that move the map where they come back at once.
_EASED = (Source.RTK_POSITION, Source.RTK_VELOCITY)


class Fusion:
    """Turns samples into measurements and fuses them, as the parameters say."""

    def __init__(self, config: EkfConfig) -> None:
        states = states_of(config)
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)
        self._direct = config.position_update == "rtk_direct"
        self._rtk_position = RtkPosition(config)
        self._rtk_velocity = Velocities(states, config.rtk)
        self._gps_velocity = Velocities(states, config.gps)
        self._gps_position = GpsPosition(config)
        self._headings = Headings(config)
        self._resets = Resets(config)
        self._gps_time_s = config.gps.position_time_s
        self._heading_time_s = config.heading.bias_time_s

    def spare(self, sample: Aiding, control: Control) -> bool:
        """Whether a sample of the ordinary GPS is not needed, since RTK is there."""
        return self._gps_position.spare(sample, control)

    def fuse(
        self, sample: Aiding, belief: Belief, angular_rate_b: Vector, *, stale: bool = False
    ) -> Fused:
        """The belief with a sample in it.

        ``angular_rate_b`` (rad/s) has its bias removed; a ``stale`` sample says what the one
        before said: its refusal proves less against the state.
        """
        if self.spare(sample, belief.control):
            return refused(sample, belief, Outcome.STANDBY, "RTK is there")
        belief = belief._replace(control=self._faded(belief.control, sample.stamp_ns))
        if isinstance(sample, HeadingSample):
            aid, belief = self._heading(sample, belief)
        elif isinstance(sample, VelocitySample):
            aid, belief = self._velocity(sample, belief, angular_rate_b)
        else:
            aid, belief = self._position(sample, belief)
        if isinstance(aid, Verdict):
            return Fused(aid, belief)
        return self._judged(aid._replace(stale=True) if stale else aid, belief)

    def _position(self, sample: PositionSample, belief: Belief) -> tuple[Aid | Verdict, Belief]:
        if sample.source is Source.GPS_POSITION:
            if sample.status < FixStatus.SINGLE:
                return not_fixed(sample.source, sample.status), belief
            return self._gps_position.aid(sample, belief), belief
        belief = belief._replace(control=self._heard(sample, belief.control))
        if sample.status < FixStatus.FLOAT:
            return not_fixed(sample.source, sample.status), belief
        return self._rtk_position.aid(sample, belief)

    def _heard(self, sample: PositionSample, control: Control) -> Control:
        return control.heard(sample.status, sample.stamp_ns, self._timeout_ns)

    def _velocity(
        self, sample: VelocitySample, belief: Belief, angular_rate_b: Vector
    ) -> tuple[Aid | Verdict, Belief]:
        if sample.source is Source.GPS_VELOCITY:
            return self._gps_velocity.aid(sample, belief, angular_rate_b), belief
        status = belief.control.status_at(sample.stamp_ns, self._timeout_ns)
        if status is not None and status < FixStatus.FLOAT:
            return not_fixed(sample.source, status), belief
        return self._rtk_velocity.aid(sample, belief, angular_rate_b), belief

    def _heading(self, sample: HeadingSample, belief: Belief) -> tuple[Aid | Verdict, Belief]:
        reason = self._headings.obstacle(sample, belief.control)
        if reason:
            return Verdict(Source.RTK_HEADING, Outcome.NOT_FIXED, reason), belief
        aid = self._headings.aid(sample, belief)
        if aid is None:
            reason = "the antenna baseline stands upright"
            return Verdict(Source.RTK_HEADING, Outcome.INVALID, reason), belief
        return aid, belief

    def _judged(self, aid: Aid, belief: Belief) -> Fused:
        """The belief with a measurement in it, or without where the gates refuse."""
        state, covariance, control = belief
        track = self._eased(aid, control.track(aid.source))
        measurement = aid.measurement
        if track.ease > 1:
            measurement = measurement._replace(ease=track.ease - 1.0)
        ratio, error, updated, predicted = update(covariance, measurement)
        reason = "innovation" if error is None else ""
        if aid.source is Source.RTK_HEADING:
            track, reason = self._headings.averaged(track, measurement, predicted, reason)
        if reason or error is None or updated is None:
            track = track.refused(aid.stamp_ns, aid.invariant, aid.slack, stale=aid.stale)
            belief = belief._replace(control=control.with_track(aid.source, track))
            return self._after_refusal(aid, belief, ratio, reason)
        if self._direct and aid.source is Source.RTK_POSITION:
            error, updated = _position_taken(error, updated, measurement)
        track = track.used(aid.stamp_ns, self._timeout_ns)
        receivers = control.receivers.changed(error[GPS_ERROR].tolist(), _heading_error(error))
        control = control.with_track(aid.source, track, receivers)
        belief = Belief(feedback(state, error), updated, control)
        return Fused(_verdict(aid, Outcome.USED, "", ratio), belief)

    def _after_refusal(self, aid: Aid, belief: Belief, ratio: float, reason: str) -> Fused:
        reset = self._resets.after_refusal(aid, belief)
        if reset is None:
            return Fused(_verdict(aid, Outcome.GATED, reason, ratio), belief)
        return Fused(_verdict(aid, Outcome.RESET, str(reset.control.last_reset), ratio), reset)

    def _eased(self, aid: Aid, track: Track) -> Track:
        """An aid that was silent for long does not move the state in one step."""
        if aid.source not in _EASED or track.recent(aid.stamp_ns, self._timeout_ns):
            return track
        return track._replace(ease=EASE_STEPS)

    def _faded(self, control: Control, stamp_ns: int) -> Control:
        """With the receivers' errors at a sample's time."""
        receivers = control.receivers.at(stamp_ns, self._gps_time_s, self._heading_time_s)
        return control if receivers is control.receivers else control._replace(receivers=receivers)


def _heading_error(error: Array) -> float:
    return float(error[HEADING_ERROR]) if len(error) > HEADING_ERROR else 0.0


def _verdict(aid: Aid, outcome: Outcome, reason: str, ratio: float) -> Verdict:
    innovation = tuple(aid.measurement.innovation.tolist())
    return Verdict(aid.source, outcome, reason, ratio, innovation)


def _position_taken(
    error: Array, covariance: Array, measurement: Measurement
) -> tuple[Array, Array]:
    """The paper's cycle (section 3.3): RTK's position as it stands, the rest filtered."""
    error, covariance = error.copy(), covariance.copy()
    error[POSITION] = measurement.innovation
    covariance[POSITION, :] = 0.0
    covariance[:, POSITION] = 0.0
    covariance[POSITION, POSITION] = measurement.noise
    return error, covariance
