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
"""Aid the filter with satellite positions: RTK's (Eq. 4 of Ren et al. 2022), and ordinary GPS's.

H includes the lever arm's partials in attitude, which the paper leaves out.

The solution of an RTK receiver may step, by a wrong fix or from float to fixed. After a step, only
the motion that the receiver reports is used; once the step has lasted, the position follows it.

The error of ordinary GPS, metres that vary over a minute, is a state of the filter. While RTK is
fixed it is learned from one position a second. Without RTK, positions less the estimated error
continue from where RTK stopped, and the covariance grows as the error wanders.
"""

from __future__ import annotations

import math
import operator

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid import (
    Aid,
    AidMeasurement,
    Corrected,
    Fused,
    Modelled,
    StateEstimate,
    added,
    floored,
    not_fixed,
)
from tirgeo_ros.core.navigation.aiding.aid_status import (
    EASE_STEPS,
    NEVER_NS,
    STEPPED_S,
    AidStatus,
    AidTrack,
)
from tirgeo_ros.core.navigation.aiding.rtk_consistency import path_n
from tirgeo_ros.core.navigation.ins.error_states import (
    ANTENNA,
    GPS_ERROR,
    POSITION,
    flat_memory,
    has_antenna,
)
from tirgeo_ros.core.navigation.ins.kalman import Change, Measurement, Update, cut, update
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Vector, matrix, rotate
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: An accepted step counts as a reset from this size on. A smaller step, which ordinary GPS cannot
#: confirm, is accepted after this time: a short fault of a receiver lasts for a second.
_COUNTED_STEP_M = 1.0
_SMALL_STEP_S = 1.2
#: Time over which positions are compared with the state.
_SLOW_NS = 10_000_000_000
#: Variation of a GPS error that still counts as the same error.
_SLACK_M = 2.0


def innovation_n(state: NavState, sample: PositionSample, lever_n: Vector) -> Vector:
    """Return measured less predicted antenna position (Eq. 5), NED m; ``lever_n``: ``R_nb l``."""
    north, east, down = path_n(state, sample)
    return north - lever_n[0], east - lever_n[1], down - lever_n[2]


def arm_design(states: int, arm_n: Vector, first: int) -> Array:
    """Return H (3, states) of ``R_true a = R a - [R a x] phi``, plus the states from ``first``."""
    design = np.zeros((3, states))
    x, y, z = arm_n
    flat = flat_memory(design)
    second, third = states, 2 * states
    flat[1], flat[2] = z, -y
    flat[second], flat[second + 2] = -z, x
    flat[third], flat[third + 1] = y, -x
    flat[first] = flat[second + first + 1] = flat[third + first + 2] = 1.0
    return design


def white_factor(time_s: float, step_ns: int) -> float:
    """Return the factor that converts the variance of a lasting error to one of white noise.

    Averaging positions does not remove a lasting error. White noise with the same power at low
    frequency has 2 tau / step times its variance, tau being the correlation time.
    """
    return max(2 * time_s / min(max(step_ns * 1e-9, 0.02), 1.0), 1.0)


class RtkPositionAid(Aid):
    """Use RTK positions that are float or fixed."""

    source = Source.RTK_POSITION
    delay = "rtk.delay_s"
    look_at = "aircraft.rtk_antenna_m, rtk.delay_s"
    moved = "position moved by"
    steps = True
    eased = True
    resets = POSITION

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._rtk = config.rtk
        self._direct = config.position_update == "rtk_direct"
        self._lever_b: Vector = tuple(config.aircraft.rtk_lever_b.tolist())

    def measured(
        self, sample: PositionSample, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement, and the estimate with its fix status and offset recorded."""
        state = estimate.state
        aids = estimate.aids.with_status(sample.status, sample.stamp_ns, self._timeout_ns)
        if sample.status < FixStatus.FLOAT:
            return not_fixed(self.source, sample.status), estimate._replace(aids=aids)
        rotation = rotation_of(state.q_nb)
        lever_n = rotate(rotation, added(self._lever_b, aids.receivers.antenna_b))
        innovation = innovation_n(state, sample, lever_n)
        offset = added(innovation, state.correction_n)
        if self._rtk.median_window > 1:
            innovation, aids = self._median(offset, state.correction_n, aids)
        noise, sigma_m = self._noise(sample, aids)
        consistency = aids.rtk.consistency.with_fix(sample, noise)
        aids = aids._replace(rtk=aids.rtk._replace(consistency=consistency))
        estimate = StateEstimate(state, estimate.covariance, aids)
        reason = consistency.reason(self.source)
        if reason:
            return Verdict(self.source, Outcome.GATED, reason), estimate
        gate_sigma = self._rtk.gate_sigma
        design = arm_design(self._states, lever_n, POSITION.start)
        if has_antenna(self._states):
            design[:, ANTENNA] = matrix(rotation)
        measurement = Measurement(np.array(innovation), design, noise, gate_sigma)
        slack = 1.5 * gate_sigma * sigma_m
        return AidMeasurement(
            sample.source, sample.stamp_ns, measurement, offset, state.correction_n, slack
        ), estimate

    def _median(
        self, offset: Vector, moved_n: Vector, aids: AidStatus
    ) -> tuple[Vector, AidStatus]:
        """Return the innovation of the median offset, NED m, and the records with ``offset``."""
        offsets = (*aids.rtk.offsets_n, offset)[-self._rtk.median_window :]
        north, east, down = np.median(offsets, axis=0).tolist()
        innovation = north - moved_n[0], east - moved_n[1], down - moved_n[2]
        return innovation, aids._replace(rtk=aids.rtk._replace(offsets_n=offsets))

    def _noise(self, sample: PositionSample, aids: AidStatus) -> tuple[Array, float]:
        """Return R (3, 3), and the scatter (m) between consecutive positions."""
        if sample.status is FixStatus.FIXED:
            noise = floored(sample.covariance_n, self._rtk.position_sigma_floor_m)
            return noise, math.sqrt(noise[0, 0] + noise[1, 1] + noise[2, 2])
        step_ns = sample.stamp_ns - aids.track(sample.source).used_ns
        noise = floored(sample.covariance_n, self._rtk.float_sigma_m)
        return noise * white_factor(self._rtk.float_time_s, step_ns), self._rtk.float_sigma_m

    def correction(self, measurement: Measurement, result: Update) -> Corrected:
        """Return the error to correct by; with ``rtk_direct`` the position is set to RTK's.

        Only the other states are filtered then, as in Ren et al. 2022, section 3.3.
        """
        error, changes = super().correction(measurement, result)
        if not self._direct:
            return error, changes
        error, covariance = error.copy(), changes[0].covariance.copy()
        error[POSITION] = measurement.innovation
        covariance[POSITION, :] = 0.0
        covariance[:, POSITION] = 0.0
        covariance[POSITION, POSITION] = measurement.noise
        return error, (*changes, Change(covariance, cut(len(error), POSITION)))

    def after_step(self, aid: AidMeasurement, estimate: StateEstimate, track: AidTrack) -> Fused:
        """Return the estimate after a position that has stepped: only its motion is used.

        The motion that a receiver reports stays right when its solution jumps. After some time
        without a step back, the position becomes as uncertain as the step is large, and the next
        measurement decides. A large step resets the position instead, and is counted.
        """
        plain = aid.measurement
        ratio = update(estimate.covariance, plain).test_ratio
        track = self.refused(aid, track)
        off = aid.verdict(Outcome.GATED, self.off(aid, track), ratio)
        estimate = estimate._replace(aids=estimate.aids.with_track(aid.source, track))
        if (aid.stamp_ns - track.denied_ns) * 1e-9 >= self._step_patience_s(aid, estimate.aids):
            if math.hypot(*track.step) < _COUNTED_STEP_M:
                return Fused(off, self._loosened(estimate, track))
            estimate = self.reset(aid, estimate)
            reason = str(estimate.aids.last_reset)
            return Fused(aid.verdict(Outcome.RESET, reason, ratio), estimate)
        innovation = plain.innovation - np.array(track.step)
        motion = update(estimate.covariance, plain._replace(innovation=innovation))
        if motion.error is not None and motion.covariance is not None:
            change = Change(motion.covariance, correction=motion.correction)
            estimate = estimate.corrected(motion.error, (change,))
        return Fused(off, estimate)

    def _loosened(self, estimate: StateEstimate, track: AidTrack) -> StateEstimate:
        """Return the estimate, made so uncertain that the next positions move it gradually."""
        covariance = estimate.covariance.copy()
        covariance[POSITION, POSITION] += np.outer(track.step, track.step)
        track = AidTrack(track.used_ns, track.agreed_ns, EASE_STEPS)
        aids = estimate.aids.with_track(self.source, track)
        return StateEstimate(estimate.state, covariance, aids, (Change(covariance),))

    def _step_patience_s(self, aid: AidMeasurement, aids: AidStatus) -> float:
        """Return how long a step must last: longer, or for ever, if the GPS contradicts it."""
        patience_s, track = self._rtk.reset_after_s, aids.track(aid.source)
        gps, last = aids.track(Source.GPS_POSITION), aids.last_reset
        if math.hypot(*track.step) < _COUNTED_STEP_M:
            return min(patience_s, _SMALL_STEP_S)  # too small for GPS to confirm
        if not gps.recent(aid.stamp_ns, self._timeout_ns):
            return patience_s
        if last and last.source is Source.GPS_POSITION and last.stamp_ns > track.denied_ns:
            return patience_s  # GPS has contradicted the state too
        sigmas = np.array(track.step) / np.array(self._config.gps.position_sigma_m)
        if np.linalg.norm(sigmas) > self._config.gps.gate_sigma:
            return math.inf
        return max(STEPPED_S, patience_s)

    def reset(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate:
        """Set the position; the ordinary GPS did not move, so its estimated error changes."""
        after = super().reset(aid, estimate)
        assert after is not None
        error = np.zeros(self._states)
        error[GPS_ERROR] = -aid.measurement.innovation
        receivers = after.aids.receivers.changed(error)
        return after._replace(aids=after.aids._replace(receivers=receivers))


class GpsPositionAid(Aid):
    """Use positions of the ordinary GPS, with their slow error as a state."""

    source = Source.GPS_POSITION
    delay = "gps.delay_s"
    look_at = "aircraft.gps_antenna_m, gps.delay_s"
    moved = "GPS error changed by"

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._gps = config.gps
        self._lever_b: Vector = tuple(config.aircraft.gps_lever_b.tolist())
        noise_m2 = config.gps.position_noise_m**2
        self._noise = np.eye(3) * noise_m2
        self._modelled_m2 = np.square(config.gps.position_sigma_m) + noise_m2

    def spare(self, sample: PositionSample, aids: AidStatus) -> bool:
        """Return whether RTK is fixed and used, and the GPS error was learned within a second."""
        return self.learned(sample, aids)

    def measured(
        self, sample: PositionSample, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement of position plus slow error, and the estimate."""
        if sample.status < FixStatus.SINGLE:
            return not_fixed(self.source, sample.status), estimate
        state, error_n = estimate.state, estimate.aids.receivers.gps_error_n
        lever_n = rotate(rotation_of(state.q_nb), self._lever_b)
        innovation = innovation_n(state, sample, added(lever_n, error_n))
        design = arm_design(self._states, lever_n, POSITION.start)
        design[:, GPS_ERROR] = np.eye(3)
        # Reported variance beyond that of the slow error in the state: white, and slow as well.
        beyond = np.maximum(np.diagonal(sample.covariance_n) - self._modelled_m2, 0.0)
        aids, now_ns, time_s = estimate.aids, sample.stamp_ns, self._gps.position_time_s
        white = beyond.copy()
        if beyond[2] and self._height_by_pressure(aids, now_ns):
            white[2] *= white_factor(time_s, now_ns - aids.track(self.source).judged_ns)
            beyond[2] = 0.0
        estimate = self.widened(sample, estimate, GPS_ERROR, beyond, time_s)
        aids = self._compared(added(innovation, error_n), now_ns, aids)
        estimate = estimate._replace(aids=aids)
        noise = self._noise + np.diag(white)
        measurement = Measurement(np.array(innovation), design, noise, self._gps.gate_sigma)
        invariant = added(innovation, state.correction_n)
        return AidMeasurement(
            sample.source, sample.stamp_ns, measurement, invariant, state.correction_n, _SLACK_M
        ), estimate

    def _compared(self, off_n: Vector, now_ns: int, aids: AidStatus) -> AidStatus:
        """Return the records with the mean of the positions less the state's, without RTK."""
        if aids.track(Source.RTK_POSITION).used_ns != NEVER_NS:
            return aids
        track = aids.track(self.source)
        share = min((now_ns - track.judged_ns) / _SLOW_NS, 1.0)
        mean_n = [m + share * (x - m) for m, x in zip(track.against[:3], off_n, strict=True)]
        sigmas = map(operator.truediv, map(abs, mean_n), self._gps.position_sigma_m)
        against = (*mean_n, max(track.against[3], *sigmas))
        return aids.with_track(self.source, track._replace(against=against))

    def _height_by_pressure(self, aids: AidStatus, now_ns: int) -> bool:
        """Return whether poor heights count by their mean alone: a barometer has their changes."""
        time_ns = round(self._gps.position_time_s * 1e9)
        learned = aids.track(Source.RTK_POSITION).recent(now_ns, time_ns)
        return not learned and aids.track(Source.BAROMETER).recent(now_ns, self._timeout_ns)

    def reset(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate:
        """Set the GPS error as measured; the position stays, since the GPS has jumped."""
        return self.blamed(aid, estimate, GPS_ERROR, POSITION, 1.0)
