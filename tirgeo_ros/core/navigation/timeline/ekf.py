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
"""Estimate the aircraft's state with an error-state Kalman filter on the IMU, with a history.

Epochs (IMU samples) and measurements lie on one time line. Each epoch keeps the filter's state
after all measurements up to its stamp. A late measurement is inserted in its place and the later
epochs are computed again, so the result equals that of timely arrival.
"""

from __future__ import annotations

import bisect
import math
import operator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, skew
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.aiding.aid import AidSample, StateEstimate
from tirgeo_ros.core.navigation.aiding.aid_status import PLACE, AidStatus, AidTrack, Receivers
from tirgeo_ros.core.navigation.aiding.barometer import UNKNOWN_M
from tirgeo_ros.core.navigation.aiding.fusion import Fusion, longest_hold_s
from tirgeo_ros.core.navigation.alignment.aligner import Alignment
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.navigation.ins.error_states import (
    ANTENNA,
    ATTITUDE,
    BAROMETER_OFFSET,
    DELAY,
    GPS_ERROR,
    GPS_VELOCITY_ERROR,
    GYRO_BIAS,
    POSITION,
    STATES,
    VELOCITY,
    feedback,
    has_antenna,
    states_of,
)
from tirgeo_ros.core.navigation.ins.imu_delay import at_stamp, mean_readings, motion_of
from tirgeo_ros.core.navigation.ins.kalman import Change, Mark
from tirgeo_ros.core.navigation.ins.propagation import (
    Epoch,
    NoisePowers,
    Powers,
    Propagated,
    Propagation,
    VibrationMeter,
    between,
    clipped_powers,
)
from tirgeo_ros.core.navigation.ins.strapdown import NavState
from tirgeo_ros.core.navigation.timeline.flight_record import FlightRecord
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

_AVERAGED_S = 0.04  # of readings before a measurement, for its slope by the IMU's delay
#: Up to this share of the prior variance, the flight tells more of the delay than the prior.
_TOLD = 0.5
_MOST_HZ = 500  # bound on the measurements held for each second
_stamp_of = operator.attrgetter("stamp_ns")
_ROWS = np.r_[POSITION, ATTITUDE, VELOCITY]


@dataclass(slots=True, eq=False)
class HistoryRecord:
    """Hold a measurement on the time line, and the newest verdict on it."""

    sample: AidSample
    stale: bool = False  # it repeats the value of the previous measurement
    held: bool = False  # it arrived before the IMU sample that reaches its stamp
    verdict: Verdict | None = None

    @property
    def order(self) -> tuple[int, int]:
        """Return the sort key: the stamp, then a fixed order of the sources."""
        return self.sample.stamp_ns, PLACE[self.sample.source]

    @property
    def applied(self) -> bool:
        """Return whether the filter has judged it, or will: true of all but STANDBY."""
        return self.verdict is None or self.verdict.outcome is not Outcome.STANDBY


@dataclass(slots=True, eq=False)
class FilterEpoch(Epoch):
    """Add to an epoch the records of the aids at its stamp, and its interval's measurements."""

    aids: AidStatus = AidStatus(Receivers(0))
    records: list[HistoryRecord] = field(default_factory=list)  # of the interval, in order


def put(records: list[HistoryRecord], record: HistoryRecord) -> bool:
    """Insert a record in order; return False if there is one of the same source and stamp."""
    at = bisect.bisect_left(records, record.order, key=operator.attrgetter("order"))
    if at < len(records) and records[at].order == record.order:
        return False
    records.insert(at, record)
    return True


class _Progress(NamedTuple):
    """Hold the state after the newest measurement in an interval, to continue from there."""

    end_ns: int  # stamp of the epoch that ends the interval
    order: tuple[int, int]  # sort key of the newest measurement in ``propagated``
    applied: int  # number of the interval's records up to that measurement
    propagated: Propagated
    aids: AidStatus


class Ekf:
    """Run the filter from the end of the alignment. Samples must be finite (see ``estimator``).

    ``mechanisation`` and ``fusion`` replace those that ``config`` gives (see
    ``calibration/aircraft_run``). ``record`` takes what a smoother needs.
    """

    def __init__(
        self,
        config: EkfConfig,
        alignment: Alignment,
        mechanisation: Propagation | None = None,
        fusion: Fusion | None = None,
        record: FlightRecord | None = None,
    ) -> None:
        self.configure(config)
        self._mechanisation: Propagation = mechanisation or self._mechanisation
        self._fusion: Fusion = fusion or self._fusion
        self._meter = VibrationMeter(alignment.vibration, alignment.vibration_s)
        self._maker = SolutionMaker(config)
        estimate = initial_estimate(config, alignment)
        start = Propagated(estimate.state, estimate.covariance)
        first = FilterEpoch.first(alignment.stamp_ns, alignment.imu[0], start)
        first.aids = estimate.aids
        if record is not None:
            first.propagated = first.propagated._replace(trail=Mark(Change(estimate.covariance)))
        self._epochs, self._record = [first], record
        self._held: list[HistoryRecord] = []
        self._resolved: list[Verdict] = []
        self._progress: _Progress | None = None
        # The variance of the IMU's delay, and by how much it was changed, since the start.
        self._delay_variance_s2, self._taken_s = estimate.covariance.item(DELAY, DELAY), 0.0
        self._done = 0  # index of the newest epoch that is computed

    def configure(self, config: EkfConfig) -> None:
        """Take the parameters, at the start or in flight; error states must stay the same."""
        self._mechanisation, self._fusion = Propagation(config), Fusion(config)
        self._noise_powers = NoisePowers(config.imu)
        self._estimates_delay = config.imu.delay_sigma_s > 0
        self._keep_ns = round(config.max_delay_s * 1e9)
        self._hold_ns = round(longest_hold_s(config) * 1e9)
        self._most_held = math.ceil(longest_hold_s(config) * _MOST_HZ)

    def take_delay(self, taken_s: float) -> None:
        """Reduce the IMU's estimated delay by what the stamps of all later samples lack of it."""
        self._progress = None
        self._taken_s += taken_s
        for epoch in self._epochs:
            epoch.aids = epoch.aids.with_imu_delay(-taken_s)

    @property
    def newest_ns(self) -> int:
        """Return the time stamp of the newest IMU sample."""
        return self._epochs[-1].stamp_ns

    def add_imu(self, sample: ImuSample, *, clipped: bool = False) -> list[Verdict]:
        """Propagate the state to an IMU sample, which must be newer than all before.

        ``clipped``: the IMU was at full scale within the last second, so the process noise is
        enlarged. Returns the verdicts on measurements that were held until this sample.
        """
        epoch = FilterEpoch.after(self._epochs[-1], sample, self._meter)
        if clipped:
            epoch.vibration = clipped_powers(epoch.vibration)
        while self._held and self._held[0].sample.stamp_ns <= epoch.stamp_ns:
            epoch.records.append(self._held.pop(0))
        epochs = self._epochs
        epochs.append(epoch)
        self._catch_up(len(epochs) - 1)
        if len(epochs) > 64 and epochs[64].stamp_ns < epoch.stamp_ns - self._keep_ns:
            self._forget()
        verdicts, self._resolved = self._resolved, []
        return verdicts

    def add_aiding(self, sample: AidSample, *, stale: bool = False) -> Verdict:
        """Insert a measurement in its place; if it is newer than the IMU, hold it.

        ``stale``: it repeats the value of the previous one, so its refusal proves nothing.
        """
        stamp_ns, newest_ns = sample.stamp_ns, self._epochs[-1].stamp_ns
        if stamp_ns <= self._epochs[0].stamp_ns or stamp_ns < newest_ns - self._keep_ns:
            reason = "older than max_delay_s or the alignment"
            return Verdict(sample.source, Outcome.TOO_OLD, reason)
        if stamp_ns > newest_ns + self._hold_ns:
            return Verdict(sample.source, Outcome.TOO_NEW, "newer than imu/data")
        held = stamp_ns > newest_ns
        if held and len(self._held) >= self._most_held:
            reason = f"{self._most_held} other measurements wait for imu/data"
            return Verdict(sample.source, Outcome.TOO_MANY, reason)
        record = HistoryRecord(sample, stale, held)
        index = bisect.bisect_left(self._epochs, stamp_ns, key=_stamp_of)
        if not put(self._held if held else self._epochs[index].records, record):
            return Verdict(sample.source, Outcome.REPEATED)
        if held:
            return Verdict(sample.source, Outcome.WAITING, "held until imu/data reaches it")
        return self._revised(index, record)

    def _revised(self, index: int, record: HistoryRecord) -> Verdict:
        """Return the verdict on a new record of the interval that ends with epoch ``index``."""
        if self._progress is not None and self._progress.order > record.order:
            self._progress = None
        self._catch_up(index - 1)
        records, progress = self._epochs[index].records, self._progress
        before = [r.order for r in records if r.order < record.order and r.applied]
        if not before:
            aids: AidStatus | None = self._epochs[index - 1].aids
        else:  # without these aid records the later epochs are computed again
            aids = progress.aids if progress and progress.order == before[-1] else None
        if aids is not None and self._fusion.spare(record.sample, aids):
            record.verdict = Verdict(record.sample.source, Outcome.STANDBY, "not needed")
            return record.verdict  # nothing changes, so the later epochs remain valid
        self._done = min(self._done, index - 1)
        self._catch_up(index)
        assert record.verdict is not None
        return record.verdict

    def solution(self) -> NavSolution:
        """Return the solution at the newest IMU sample; its covariance may be 50 ms older."""
        self._catch_up(len(self._epochs) - 1)
        epoch = self._epochs[-1]
        state, covariance = epoch.propagated.state, epoch.propagated.covariance
        readings = Readings(epoch.force_b, epoch.rate_b, self._white_b(epoch))
        receivers = epoch.aids.receivers
        solution = self._maker.make(epoch.stamp_ns, state, covariance, readings, receivers)
        return with_pending_step(solution, epoch.aids.pending_step)

    def _white_b(self, epoch: FilterEpoch) -> Vector:
        """Return the variances of the white noise of one angular rate in ``b``, (rad/s)^2."""
        first, last, count = self._epochs[0], self._epochs[-1], len(self._epochs) - 1
        x, y, z = self._noise_powers.under(epoch.vibration)[:3]
        # With one sample there is no sampling rate.
        rate_hz = count / ((last.stamp_ns - first.stamp_ns) * 1e-9) if count else 0.0
        return x * rate_hz, y * rate_hz, z * rate_hz

    def estimate(self) -> StateEstimate:
        """Return the estimate at the newest IMU sample; its covariance may be 50 ms older."""
        self._catch_up(len(self._epochs) - 1)
        epoch = self._epochs[-1]
        return StateEstimate(epoch.propagated.state, epoch.propagated.covariance, epoch.aids)

    @property
    def aids(self) -> AidStatus:
        """Return the records of the aids at the newest IMU sample."""
        return self.estimate().aids

    @property
    def vibration(self) -> Powers:
        """Return the noise densities that the IMU's latest readings show."""
        return self._epochs[-1].vibration

    @property
    def process_noise(self) -> str:
        """Return the source of the process noise: "parameters", or "vibration" if larger."""
        return "vibration" if self._noise_powers.exceeded(self.vibration) else "parameters"

    def imu_delay_s(self) -> tuple[float, float]:
        """Return what the flight alone shows of the IMU's delay, and its sigma.

        The filter's estimate is drawn from it to the delay that was configured at the start. Both
        are nan if the delay is exact, or if the flight tells less of it than the prior.
        """
        estimate = self.estimate()
        variance_s2, receivers = estimate.covariance.item(DELAY, DELAY), estimate.aids.receivers
        share = variance_s2 / self._delay_variance_s2 if variance_s2 > 0 else 1.0
        if share > _TOLD:
            return math.nan, math.nan
        told_s = (receivers.imu_delay_s + share * self._taken_s) / (1 - share)
        return told_s, math.sqrt(variance_s2 / (1 - share))

    def biases(self) -> Biases:
        """Return the estimated IMU biases and their covariance (6, 6), to start again from."""
        estimate, rows = self.estimate(), slice(GYRO_BIAS.start, GYRO_BIAS.start + 6)
        covariance = estimate.covariance[rows, rows].copy()
        return Biases(estimate.state.gyro_bias_b, estimate.state.accel_bias_b, covariance)

    def _catch_up(self, index: int) -> None:
        while self._done < index:
            self._advance(self._epochs[self._done], self._epochs[self._done + 1])
            self._done += 1

    def _advance(self, start: FilterEpoch, end: FilterEpoch) -> None:
        """Compute the state and aid records of ``end`` from ``start`` and its measurements."""
        if not end.records:
            end.propagated = self._mechanisation.whole(start.propagated, start, end)
            end.aids = start.aids
            return
        progress = self._progress
        if progress is None or progress.end_ns != end.stamp_ns:
            order = start.stamp_ns, 0
            progress = _Progress(end.stamp_ns, order, 0, start.propagated, start.aids)
        now, aids, now_ns = progress.propagated, progress.aids, progress.order[0]
        for number, record in enumerate(end.records[progress.applied :], progress.applied + 1):
            if self._fusion.spare(record.sample, aids):
                standby = Verdict(record.sample.source, Outcome.STANDBY, "not needed")
                self._set_verdict(record, standby)
                continue
            stamp_ns = record.sample.stamp_ns
            now = self._mechanisation.part(now, start, end, now_ns, stamp_ns)
            now_ns = stamp_ns
            now, aids = self._applied(record, now, aids, start, end)
            progress = _Progress(end.stamp_ns, record.order, number, now, aids)
        self._progress = progress
        end.aids = aids
        if now_ns == start.stamp_ns:
            end.propagated = self._mechanisation.whole(now, start, end)
        else:
            end.propagated = self._mechanisation.part(now, start, end, now_ns, end.stamp_ns)

    def _applied(
        self,
        record: HistoryRecord,
        now: Propagated,
        aids: AidStatus,
        start: FilterEpoch,
        end: FilterEpoch,
    ) -> tuple[Propagated, AidStatus]:
        now = self._mechanisation.followed(now)
        x, y, z = now.state.gyro_bias_b
        estimate = StateEstimate(now.state, now.covariance, aids)
        rate_b, motion = between(start, end, record.sample.stamp_ns)[1], None
        if self._estimates_delay:
            first = max(0, self._done - round(_AVERAGED_S / end.step_s))
            force_b, turning_b = mean_readings(self._epochs[first : self._done + 2])
            motion = motion_of(now.state, force_b, rate_b, turning_b)
        turning_b, stale = (rate_b[0] - x, rate_b[1] - y, rate_b[2] - z), record.stale
        verdict, after = self._fusion.fuse(
            record.sample,
            estimate,
            turning_b,
            stale=stale,
            autopilot_q_nb=end.autopilot_q_nb,
            motion=motion,
        )
        self._set_verdict(record, verdict)
        trail = now.trail
        if trail is not None:
            for change in after.changes:
                trail = Mark(change, trail)
        return Propagated(after.state, after.covariance, trail=trail), after.aids

    def _set_verdict(self, record: HistoryRecord, verdict: Verdict) -> None:
        """Store a verdict; the first on a measurement that was held also goes to the caller."""
        if record.held and record.verdict is None:
            self._resolved.append(verdict)
        record.verdict = verdict

    def _forget(self) -> None:
        """Drop the epochs that no measurement can reach any more, in batches for speed."""
        oldest_ns = self.newest_ns - self._keep_ns
        drop = bisect.bisect_right(self._epochs, oldest_ns, key=_stamp_of) - 1
        self._keep(drop)
        del self._epochs[:drop]
        self._done -= drop

    def finish(self) -> None:
        """Record the remaining epochs; call it after the last sample."""
        self._catch_up(len(self._epochs) - 1)
        self._keep(len(self._epochs))

    def _keep(self, number: int) -> None:
        """Record the first ``number`` epochs, which no measurement can reach any more."""
        if self._record is not None:
            for epoch in self._epochs[:number]:
                self._record.keep(epoch, epoch.aids, self._white_b(epoch))


class Readings(NamedTuple):
    """Hold the IMU's readings at a stamp, with their biases, and the noise of the rate."""

    force_b: Vector  # m/s2
    rate_b: Vector  # rad/s
    white_b: Vector  # variances of the rate's white noise, (rad/s)^2


class SolutionMaker:
    """Make solutions in the form that the parameters ask for."""

    def __init__(self, config: EkfConfig) -> None:
        states = states_of(config)
        self._at_antenna = has_antenna(states) and not config.aircraft.rtk_lever_b.any()
        self._delay_sigma_s = config.imu.delay_sigma_s
        # Flat indices of the solution's covariance (9, 9) in the filter's covariance.
        self._entries = states * _ROWS[:, None] + _ROWS

    def make(
        self,
        stamp_ns: int,
        state: NavState,
        covariance: Array,
        readings: Readings,
        receivers: Receivers,
    ) -> NavSolution:
        """Return the solution of a state and the covariance (n, n) of its error.

        The state is older than its stamp by the estimated delay of the IMU.
        """
        rate_b = readings.rate_b
        if self._delay_sigma_s > 0:
            motion, delay_s = motion_of(state, readings.force_b, rate_b), receivers.imu_delay_s
            error, covariance = at_stamp(covariance, motion, delay_s, self._delay_sigma_s)
            state = feedback(state, error)
            if self._at_antenna:
                receivers = receivers.changed(error)
        bias, (x, y, z), item = state.gyro_bias_b, readings.white_b, covariance.item
        turning_b = rate_b[0] - bias[0], rate_b[1] - bias[1], rate_b[2] - bias[2]
        vectors = np.array((*state.velocity_n, *state.q_nb, *turning_b))
        fields = (
            stamp_ns,
            state.latitude_rad,
            state.longitude_rad,
            state.height_m,
            vectors[:3],
            vectors[3:7],
            vectors[7:],
            (x + item(9, 9), y + item(10, 10), z + item(11, 11)),
            covariance.take(self._entries),
        )
        solution: NavSolution = tuple.__new__(NavSolution, fields)  # at half the cost
        return at_antenna(solution, covariance, receivers) if self._at_antenna else solution


def with_pending_step(solution: NavSolution, step: tuple[float, ...]) -> NavSolution:
    """Return a solution with its covariance enlarged by an RTK step (m) not accepted yet."""
    if step:
        solution.covariance[:3, :3] += np.outer(step, step)
    return solution


def at_antenna(imu: NavSolution, covariance: Array, receivers: Receivers) -> NavSolution:
    """Return the solution of the antenna from that of the IMU.

    A configured lever arm of zeros that nobody has measured means that the origin of ``base_link``
    is the antenna. The filter's state is that of the IMU, which is elsewhere.
    ``covariance`` (n, n) is the filter's, the antenna's position among its error states.
    With ``l`` from IMU to antenna in ``b``, the position is ``p + R l`` and the velocity
    ``v + R (w x l)`` (Groves, 2nd ed., 14.3.4). The covariance (9, 9) follows to first order.
    """
    lever_b = np.array(receivers.antenna_b)
    rotation_nb = matrix_from_quat(imu.q_nb)
    lever_n = rotation_nb @ lever_b
    swing_n = rotation_nb @ np.cross(imu.angular_rate_b, lever_b)
    meridian, transverse = radii_of_curvature(imu.latitude_rad)
    east_m = (transverse + imu.height_m) * np.cos(imu.latitude_rad)
    effect = np.zeros((9, len(covariance)))
    effect[0:3, 6:9] = effect[3:6, 0:3] = effect[6:9, 3:6] = np.eye(3)
    effect[0:3, 0:3] = -skew(lever_n)
    effect[0:3, ANTENNA] = rotation_nb
    effect[6:9, 0:3] = -skew(swing_n)
    effect[6:9, GYRO_BIAS] = rotation_nb @ skew(lever_b)
    effect[6:9, ANTENNA] = rotation_nb @ skew(imu.angular_rate_b)
    return imu._replace(
        latitude_rad=imu.latitude_rad + float(lever_n[0]) / (meridian + imu.height_m),
        longitude_rad=imu.longitude_rad + float(lever_n[1] / east_m),
        height_m=imu.height_m - float(lever_n[2]),
        velocity_n=imu.velocity_n + swing_n,
        covariance=effect @ covariance @ effect.T,
    )


def initial_estimate(config: EkfConfig, alignment: Alignment) -> StateEstimate:
    """Return the first estimate, in which the aids of the alignment count as used."""
    states = states_of(config)
    covariance = np.zeros((states, states))
    covariance[:STATES, :STATES] = alignment.covariance
    covariance[GPS_ERROR, GPS_ERROR] = np.diag(np.square(config.gps.position_sigma_m))
    covariance[DELAY, DELAY] = config.imu.delay_sigma_s**2
    covariance[BAROMETER_OFFSET, BAROMETER_OFFSET] = UNKNOWN_M**2
    if has_antenna(states):
        effect = np.zeros((states, 3))
        effect[ANTENNA] = np.eye(3)
        if Source.RTK_POSITION in alignment.sources:  # the position was computed with the arm
            effect[POSITION] = -matrix_from_quat(np.array(alignment.state.q_nb))
        covariance += effect @ np.diag(config.aircraft.rtk_lever_sigma_b**2) @ effect.T
    aids = AidStatus(Receivers(alignment.stamp_ns))
    for source in alignment.sources:
        aids = aids.with_track(source, AidTrack(alignment.stamp_ns))
    if alignment.rtk_status is not None:
        aids = aids.with_status(alignment.rtk_status, alignment.stamp_ns, 0)
    gps = config.gps
    for source, state, error, least, noise in (
        (Source.GPS_POSITION, POSITION, GPS_ERROR, gps.position_sigma_m, gps.position_noise_m),
        (Source.GPS_VELOCITY, VELOCITY, GPS_VELOCITY_ERROR, 0.0, gps.velocity_error_m_s),
    ):
        if source in alignment.sources:
            # The state came from the GPS: its error (truth - estimate) is the GPS's, negated.
            own = covariance[state, state]
            np.fill_diagonal(own, np.maximum(np.diag(own), np.square(least)))
            covariance[error, :] = -covariance[state, :]
            covariance[:, error] = -covariance[:, state]
            covariance[error, error] = own + np.eye(3) * noise**2
    return StateEstimate(alignment.state, covariance, aids)
