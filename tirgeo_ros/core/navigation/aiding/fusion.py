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
"""List the filter's aids and the sources of each method; fuse samples into the estimate.

Each aid's class holds what differs between aids; records, easing and gates are here, for all.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid import (
    Aid,
    AidMeasurement,
    AidSample,
    Fused,
    StateEstimate,
    added,
)
from tirgeo_ros.core.navigation.aiding.aid_status import EASE_STEPS, AidStatus
from tirgeo_ros.core.navigation.aiding.barometer import BarometerAid
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import HeadingAid
from tirgeo_ros.core.navigation.aiding.nose_heading import AutopilotHeadingAid, SetHeadingAid
from tirgeo_ros.core.navigation.aiding.rest import RestAid
from tirgeo_ros.core.navigation.aiding.satellite_position import GpsPositionAid, RtkPositionAid
from tirgeo_ros.core.navigation.aiding.satellite_velocity import GpsVelocityAid, RtkVelocityAid
from tirgeo_ros.core.navigation.ins.error_states import DELAY
from tirgeo_ros.core.navigation.ins.imu_delay import LONGEST_SIGMAS, later
from tirgeo_ros.core.navigation.ins.kalman import update
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: All aids, by source.
AIDS: Mapping[Source, type[Aid]] = {
    aid.source: aid
    for aid in (
        RtkPositionAid,
        RtkVelocityAid,
        HeadingAid,
        GpsPositionAid,
        GpsVelocityAid,
        BarometerAid,
        AutopilotHeadingAid,
        SetHeadingAid,
        RestAid,
    )
}

_IMU = Source.IMU
_EKF = tuple(s for s in Source if s not in {Source.AUTOPILOT_HEADING, Source.REST})
#: The sources that arrive as samples of their own, by method.
METHOD_SOURCES: Mapping[str, tuple[Source, ...]] = {
    "raw": (_IMU, Source.GPS_POSITION, Source.GPS_VELOCITY),
    "rtk": (_IMU, Source.RTK_POSITION, Source.RTK_VELOCITY),
    "ekf": tuple(source for source in _EKF if source is not Source.RTK_HEADING),
    "ekf_heading": _EKF,
}
#: The aids without which a filter is degraded, by method.
EXPECTED: Mapping[str, tuple[Source, ...]] = {
    "ekf": (Source.RTK_POSITION, Source.RTK_VELOCITY),
    "ekf_heading": (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING),
}
#: Gate of an aid that has stepped: narrow, so it passes only if the state may be as far off.
_STEPPED_GATE_SIGMA = 2.0
#: Measurements may be ahead of the IMU by at least this, however small ``max_delay_s`` is.
_LEAST_HOLD_S = 0.2


class Delays(NamedTuple):
    """Hold stamp minus time of measurement (ns) by sensor; negative if stamps are early."""

    imu_ns: int
    aid_ns: Mapping[Source, int]

    @classmethod
    def from_config(cls, config: EkfConfig) -> Delays:
        """Return the configured delays."""
        aid_ns = {
            source: round(aid.delay_s(config) * 1e9) for source, aid in AIDS.items() if aid.delay
        }
        return cls(round(config.imu.delay_s * 1e9), aid_ns)

    @property
    def ahead_ns(self) -> int:
        """Return how far the corrected stamp of an aid may be ahead of the IMU's on arrival.

        It is the IMU's delay less the smallest delay of an aid, and never negative. A barometer
        whose delay is 0 does not count: most aircraft have no barometer topic.
        """
        delays_ns = (ns for s, ns in self.aid_ns.items() if ns or s is not Source.BAROMETER)
        return max(0, self.imu_ns - min(delays_ns))


def longest_hold_s(config: EkfConfig) -> float:
    """Return how far ahead of the IMU (s) a measurement may be and still be held for it."""
    return max(config.max_delay_s, _LEAST_HOLD_S) + Delays.from_config(config).ahead_ns * 1e-9


class Fusion:
    """Convert samples to measurements and fuse them."""

    def __init__(self, config: EkfConfig) -> None:
        self._models = {source: aid(config) for source, aid in AIDS.items()}
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)
        self._gps_time_s = config.gps.position_time_s
        self._longest_delay_s = LONGEST_SIGMAS * config.imu.delay_sigma_s

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
        motion: Array | None = None,
    ) -> Fused:
        """Return the verdict on a sample, and the estimate after it.

        ``angular_rate_b`` (rad/s) has its bias removed. A ``stale`` sample repeats the value of
        the previous one, so its refusal proves less against the state. The autopilot's attitude
        (4,), wxyz, is consulted if headings contradict the state. ``motion`` (12,) by
        ``imu_delay``, if the IMU's delay is estimated: the state is older by that delay.
        """
        if self.spare(sample, estimate.aids):
            return Fused(Verdict(sample.source, Outcome.STANDBY, "not needed"), estimate)
        receivers = estimate.aids.receivers.at(sample.stamp_ns, self._gps_time_s)
        aids = estimate.aids._replace(receivers=receivers)
        model, state, rate_b = self._models[sample.source], estimate.state, angular_rate_b
        motion, shown = motion if model.by_delay else None, state
        if motion is not None:
            shown = later(state, motion, receivers.imu_delay_s)
            change_b = map(operator.sub, state.gyro_bias_b, shown.gyro_bias_b)
            rate_b = added(rate_b, tuple(change_b))
        estimate = StateEstimate(shown, estimate.covariance, aids)
        aid, estimate = model.measured(sample, estimate, rate_b)
        estimate = estimate._replace(state=state)
        if isinstance(aid, Verdict):
            return Fused(aid, estimate)
        if motion is not None:
            design = aid.measurement.design
            design[:, DELAY] = design[:, : len(motion)].dot(motion)
        aid = aid._replace(stale=stale, autopilot_q_nb=autopilot_q_nb)
        verdict, estimate = self._judged(aid, estimate)
        if abs(estimate.aids.receivers.imu_delay_s) > self._longest_delay_s:
            estimate = estimate.without_delay()
        return Fused(verdict, estimate)

    def _judged(self, aid: AidMeasurement, estimate: StateEstimate) -> Fused:
        """Return the estimate after a measurement, or before it if the gates refuse it."""
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
        reset = model.after_refusal(aid, estimate)
        if reset is None:
            return Fused(aid.verdict(Outcome.GATED, reason, result.test_ratio), estimate)
        reason = str(reset.aids.last_reset)
        return Fused(aid.verdict(Outcome.RESET, reason, result.test_ratio), reset)
