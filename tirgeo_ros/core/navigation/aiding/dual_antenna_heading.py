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
"""Aid the filter with the heading of two antennas (Eq. 7 and 9 of Ren et al. 2022).

H is derived for the full attitude, unlike the row that the paper prints.
"""

from __future__ import annotations

import math
import operator
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config import AircraftConfig, EkfConfig
from tirgeo_ros.core.frames.rotations import (
    azimuth,
    azimuth_row,
    euler_from_quat,
    rotation_of,
    wrapped,
)
from tirgeo_ros.core.navigation.aiding.aid import (
    LONGEST_PATIENCE_S,
    Aid,
    AidMeasurement,
    Modelled,
    StateEstimate,
    uncorrelated,
)
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack
from tirgeo_ros.core.navigation.ins.error_states import ACCEL_BIAS, ATTITUDE, GYRO_BIAS, feedback
from tirgeo_ros.core.navigation.ins.kalman import Change, Measurement, cut
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Vector, rotate
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: A larger turn is the antennas' fault: no gyroscope misses it, and few compasses err so much.
LARGE_TURN_RAD = math.radians(20.0)
#: A baseline with a smaller horizontal share gives no useful heading (75 deg of tilt).
_LEAST_HORIZONTAL = 0.25
#: Weight of the newest innovation in the running mean, which averages about twenty.
_MEAN_SHARE = 0.1
_MEAN_GATE_SIGMA = 5.0
#: Longest contradiction that a reset needs if it turns by less than the gate of one heading.
_SMALL_LONGEST_S = 10.0
#: A larger reset means that the initial heading was wrong, and with it tilt and biases.
_SPOILING_TURN_RAD = math.radians(5.0)
_TILT_SIGMA_RAD = math.radians(1.0)


class Baseline(NamedTuple):
    """Hold the direction from the first antenna to the second, and the heading's offset."""

    direction_b: Vector  # unit vector, FRD
    reported_less_azimuth_rad: float  # added by the receiver to the baseline's azimuth

    @classmethod
    def from_config(cls, aircraft: AircraftConfig) -> Baseline:
        """Return the baseline of the two antennas; with one antenna, level along the nose.

        The reported heading is the azimuth of the baseline less its direction in a level body.
        Raises ConfigError if the two antennas give no heading.
        """
        baseline_b = aircraft.baseline_b
        if baseline_b is None:
            return cls((1.0, 0.0, 0.0), 0.0)
        x, y, z = (baseline_b / np.linalg.norm(baseline_b)).tolist()
        return cls((x, y, z), -azimuth((x, y)))


class HeadingAid(Aid):
    """Use the antennas' headings while RTK is fixed."""

    source = Source.RTK_HEADING
    delay = "heading.delay_s"
    look_at = "heading.delay_s, aircraft.second_antenna_m"
    moved = "heading turned by"
    steps = True

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._heading = config.heading
        self._baseline = Baseline.from_config(config.aircraft)
        self._floor_rad2 = math.radians(config.heading.sigma_floor_deg) ** 2

    @classmethod
    def delay_s(cls, config: EkfConfig) -> float:
        """Return the delay, s; a heading without a delay of its own takes that of RTK."""
        own_s = config.heading.delay_s
        return config.rtk.delay_s if math.isnan(own_s) else own_s

    def _obstacle(self, sample: HeadingSample, aids: AidStatus) -> str:
        """Return why a heading is not used, or "": RTK must be fixed, for a time at the start."""
        now_ns = sample.stamp_ns
        if aids.rtk.status is not FixStatus.FIXED:
            return "rtk/fix is not fixed"
        if now_ns - aids.rtk.status_ns > self._timeout_ns:
            return "rtk/fix is silent"
        going_on = aids.track(Source.RTK_HEADING).recent(now_ns, self._timeout_ns)
        fixed_s = (now_ns - aids.rtk.fixed_since_ns) * 1e-9
        if not going_on and fixed_s < self._heading.start_after_s:
            return f"rtk/fix has been fixed for only {fixed_s:.1f} s"
        return ""

    def measured(
        self, sample: HeadingSample, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement; INVALID if the baseline is near the vertical."""
        obstacle = self._obstacle(sample, estimate.aids)
        if obstacle:
            return Verdict(self.source, Outcome.NOT_FIXED, obstacle), estimate
        u = rotate(rotation_of(estimate.state.q_nb), self._baseline.direction_b)
        if u[0] * u[0] + u[1] * u[1] < _LEAST_HORIZONTAL**2:
            reason = "the antenna baseline is vertical"
            return Verdict(self.source, Outcome.INVALID, reason), estimate
        design = np.zeros((1, self._states))
        design[0, :3] = azimuth_row(u)
        predicted = azimuth(u) + self._baseline.reported_less_azimuth_rad
        innovation = wrapped(sample.heading_rad - predicted)
        variance = max(sample.variance_rad2, self._floor_rad2)
        gate_sigma, noise = self._heading.gate_sigma, np.array(((variance,),))
        measurement = Measurement(np.array((innovation,)), design, noise, gate_sigma)
        invariant = (math.cos(innovation), math.sin(innovation))
        slack = 1.5 * gate_sigma * math.sqrt(variance)
        own = self.source, sample.stamp_ns, measurement
        return AidMeasurement(*own, invariant, (1.0, 0.0), slack), estimate

    def off(self, aid: AidMeasurement, track: AidTrack) -> str:
        """Describe how far a heading is off; a step is a chord of the unit circle."""
        turn = abs(float(aid.measurement.innovation[0]))
        if track.step:
            turn = 2 * math.asin(min(math.hypot(*track.step) / 2, 1.0))
        swapped = "; antennas swapped?" if turn > LARGE_TURN_RAD else ""
        return f"{math.degrees(turn):.0f} deg off{swapped}"

    def averaged(
        self, track: AidTrack, measurement: Measurement, predicted: Array, reason: str
    ) -> tuple[AidTrack, str]:
        """Return the record with one more innovation in its mean, and why a heading is refused.

        A single heading that is off by less than the gate passes it. The mean of many such
        headings lies far outside the scatter that a mean of correct headings has.
        """
        noise, own = float(measurement.noise[0, 0]), float(predicted[0, 0])
        off = float(measurement.innovation[0])
        if abs(off) > 2 * measurement.gate_sigma * math.sqrt(own + noise):
            return track, reason  # too large for a small lasting error: a flip
        mean = track.mean_rad + _MEAN_SHARE * (off - track.mean_rad)
        scatter = math.sqrt(own + noise * _MEAN_SHARE / (2 - _MEAN_SHARE))
        if not reason and abs(mean) > _MEAN_GATE_SIGMA * scatter:
            reason = f"off by {math.degrees(mean):+.1f} deg on average"
        return track._replace(mean_rad=mean), reason

    def step(self, aid: AidMeasurement, track: AidTrack) -> tuple[float, ...]:
        """Return the innovation's step that led to a refusal; empty if the innovation drifted.

        After a silence a heading is compared with the gyroscopes, which drift little: a difference
        from them is a step.
        """
        if track.step or track.denied or track.recent(aid.stamp_ns, self._timeout_ns):
            return super().step(aid, track)
        return tuple(map(operator.sub, aid.invariant, aid.expected)) if track.newest else ()

    def patience_s(self, aid: AidMeasurement, estimate: StateEstimate) -> float:
        """Return how long a run must last; infinite for a turn that the autopilot denies."""
        track = estimate.aids.track(aid.source)
        measurement, turn = aid.measurement, float(aid.measurement.innovation[0])
        if track.step or (not track.agreed_ns and abs(turn) > LARGE_TURN_RAD):
            supported = _supported(turn, estimate.state, aid.autopilot_q_nb)
            return self._heading.reset_after_s if supported else math.inf
        # The longer headings and state have agreed, the less a contradiction proves against the
        # state. One below the gate of a heading may as well come from the gyroscopes.
        gate_rad = measurement.gate_sigma * math.sqrt(measurement.noise[0, 0])
        longest_s = _SMALL_LONGEST_S if abs(turn) < gate_rad else LONGEST_PATIENCE_S
        return max(self._heading.reset_after_s, min(track.agreed_ns * 1e-9, longest_s))

    def reset(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate:
        """Turn the attitude about the vertical to the heading."""
        state, covariance = estimate.state, estimate.covariance
        turn = float(aid.measurement.innovation[0])
        error = np.zeros(len(covariance))
        error[2], lost = turn, [slice(2, 3)]
        if abs(turn) > _SPOILING_TURN_RAD:
            imu = self._config.imu
            for block, variances in (  # tilt and biases as uncertain as at the start
                (ATTITUDE, np.full(3, _TILT_SIGMA_RAD**2)),
                (GYRO_BIAS, imu.bias_variances[:3]),
                (ACCEL_BIAS, imu.bias_variances[3:]),
            ):
                covariance = uncorrelated(covariance, block)
                covariance[block, block] = np.diag(variances)
            error[GYRO_BIAS] = imu.bias_b[:3] - state.gyro_bias_b
            error[ACCEL_BIAS] = imu.bias_b[3:] - state.accel_bias_b
            lost += [ATTITUDE, GYRO_BIAS, ACCEL_BIAS]
        covariance, transition = uncorrelated(covariance, lost[0]), cut(len(covariance), *lost)
        covariance[2, 2] = aid.measurement.noise[0, 0]
        aids = self.with_reset(estimate.aids, aid.stamp_ns, turn)
        changes = (Change(covariance, transition),)
        return StateEstimate(feedback(state, error), covariance, aids, changes)

    def reset_text(self, size: float) -> str:
        """Describe a turn, in degrees."""
        return f"{self.moved} {math.degrees(size):+.1f} deg"


def _supported(turn_rad: float, state: NavState, autopilot_q_nb: Array | None) -> bool:
    """Return whether the autopilot's heading is nearer to the antennas' than to the state's."""
    if abs(turn_rad) < LARGE_TURN_RAD or not usable_attitude(autopilot_q_nb):
        return False
    assert autopilot_q_nb is not None
    yaw = euler_from_quat(np.array([state.q_nb, autopilot_q_nb]))[:, 2]
    apart = math.remainder(float(yaw[1] - yaw[0]), 2 * math.pi)
    return abs(math.remainder(apart - turn_rad, 2 * math.pi)) < 0.5 * abs(turn_rad)
