"""Fuse a sample into the filter's estimate: measure it by its aid, gate it, give the verdict.

The aids (``aids``) hold what differs between them; records, easing and gates are the same for all.
"""

from __future__ import annotations

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid_status import EASE_STEPS, AidStatus
from tirgeo_ros.core.navigation.aiding.aids import AIDS
from tirgeo_ros.core.navigation.aiding.state_estimate import (
    AidMeasurement,
    AidSample,
    Fused,
    StateEstimate,
)
from tirgeo_ros.core.navigation.ins.kalman import update
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: Gate of an aid that has stepped: it passes only if the state may be off by as much.
_STEPPED_GATE_SIGMA = 2.0


class Fusion:
    """Convert samples to measurements and fuse them."""

    def __init__(self, config: EkfConfig) -> None:
        self._models = {source: aid(config) for source, aid in AIDS.items()}
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)
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
        (4,), wxyz, is consulted where headings contradict the state.
        """
        if self.spare(sample, estimate.aids):
            return Fused(Verdict(sample.source, Outcome.STANDBY, "not needed"), estimate)
        aids = estimate.aids
        receivers = aids.receivers.at(sample.stamp_ns, self._gps_time_s, self._heading_time_s)
        aids = aids.changed(receivers)
        estimate = StateEstimate(estimate.state, estimate.covariance, aids)
        aid, estimate = self._models[sample.source].measured(sample, estimate, angular_rate_b)
        if isinstance(aid, Verdict):
            return Fused(aid, estimate)
        return self._judged(aid._replace(stale=stale), estimate, autopilot_q_nb)

    def _judged(
        self, aid: AidMeasurement, estimate: StateEstimate, autopilot_q_nb: Array | None
    ) -> Fused:
        """Return the estimate with a measurement in it, or without it where the gates refuse."""
        model, aids, measurement = self._models[aid.source], estimate.aids, aid.measurement
        track = aids.track(aid.source).followed(aid.invariant, aid.expected)
        if model.eased and not track.recent(aid.stamp_ns, self._timeout_ns):
            track = track._replace(ease=EASE_STEPS)
        if track.ease > 1:
            measurement = measurement._replace(ease=track.ease - 1.0)
        if track.step:
            stepped = model.after_step(aid, estimate, track)
            if stepped is not None:
                return stepped
            gate_sigma = min(measurement.gate_sigma, _STEPPED_GATE_SIGMA)
            measurement = measurement._replace(gate_sigma=gate_sigma)
            aid = aid._replace(measurement=measurement)
        result = update(estimate.covariance, measurement)
        track, reason = model.averaged(
            track, measurement, result.predicted, "refused" if result.error is None else ""
        )
        if not reason and result.error is not None:
            error, changes = model.correction(measurement, result)
            track = track.used(aid.stamp_ns, self._timeout_ns, aid.invariant)
            estimate = estimate._replace(aids=aids.with_track(aid.source, track))
            verdict = aid.verdict(Outcome.USED, "", result.test_ratio)
            return Fused(verdict, estimate.corrected(error, changes))
        track = model.refused(aid, track)
        reason = model.off(aid, track) if result.error is None else reason
        estimate = estimate._replace(aids=aids.with_track(aid.source, track))
        reset = model.after_refusal(aid, estimate, autopilot_q_nb)
        if reset is None:
            return Fused(aid.verdict(Outcome.GATED, reason, result.test_ratio), estimate)
        reason = str(reset.aids.last_reset)
        return Fused(aid.verdict(Outcome.RESET, reason, result.test_ratio), reset)
