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
"""Run the filter over a flight with values of the aircraft's parameters; whiten its innovations.

Prediction errors and their slopes by parameters (Ljung, System Identification, 2nd ed., chapter
7). An estimate of parameters needs the same measurements in every run. So nothing is refused or
reset; an outlier has its noise enlarged by a weight. A parameter enters a measurement directly,
and through the state that earlier measurements have moved:

    d innovation = direct - H d state,    d state' = transition (d state + gain d innovation)

so that one run of the filter gives the slopes by all parameters.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.aircraft_parameters import (
    ANTENNA,
    AZIMUTH,
    DELAYS,
    PARAMETERS,
    Floors,
    configured,
    reported_direction_rad,
    restamped,
)
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import FLU_FRD, matrix_from_quat, skew
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.core.navigation.aiding.aid import Aiding, AidMeasurement, Fused, StateEstimate
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import Baseline
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.alignment.aligner import Aligner, Alignment
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.navigation.ins.error_states import (
    ATTITUDE,
    POSITION,
    STATES,
    VELOCITY,
    feedback,
    states_of,
)
from tirgeo_ros.core.navigation.ins.kalman import update
from tirgeo_ros.core.navigation.ins.propagation import Propagated, Propagation
from tirgeo_ros.core.navigation.ins.strapdown import NavState
from tirgeo_ros.core.navigation.timeline.ekf import Ekf
from tirgeo_ros.core.navigation.timeline.imu_checks import in_body_axes
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

_NO_GATE = 1e6

#: Averaging time of the IMU readings about a measurement, for its slope by a delay.
_AVERAGED_S = 0.1
#: Measurements nearer to the end of the IMU's record or to the alignment are left out.
_MARGIN_NS = 500_000_000
_ATTITUDE_STEP_NS = 50_000_000
#: Sigmas of the error states that wrong values add to an alignment.
_START_SIGMA = np.zeros(STATES)
_START_SIGMA[ATTITUDE] = np.radians([2.0, 2.0, 5.0])
_START_SIGMA[VELOCITY], _START_SIGMA[POSITION] = 0.5, 2.0
_ALIGNMENT_FLOORS = Floors(0.1, 0.1, np.radians(2.0))


@dataclass(frozen=True)
class Recorded:
    """Hold a flight in memory: valid samples in order of stamps, without a gap of the IMU."""

    imu: Sequence[ImuSample]
    aids: Sequence[Aiding]  # of RTK; no two have the same source and stamp

    def has(self, source: Source) -> bool:
        """Return whether there is any measurement of a source."""
        return any(sample.source is source for sample in self.aids)

    @property
    def has_attitude(self) -> bool:
        """Return whether any sample has a usable attitude of the autopilot."""
        return any(usable_attitude(sample.autopilot_q_nb) for sample in self.imu)


@dataclass(frozen=True)
class FilterRun:
    """Hold the results of one run of the filter with one set of values."""

    values: Array  # (7,)
    white: list[White]
    error: Array  # (M,) whitened innovations of all measurements, one after another
    slope: Array  # (M, 7) partials of ``error`` by PARAMETERS
    row_ns: Array  # (M,) stamp of each entry, relative to the first
    attitude_ns: list[int]
    attitude_q_nb: Array  # (K, 4) wxyz at ``attitude_ns``
    velocity_n: Array  # (K, 3) m/s at ``attitude_ns``
    tilt_sigma_rad: float  # smallest sigma of the tilt in the flight, by the filter
    biases: Biases  # at the end

    def nis(self) -> dict[Source, float]:
        """Return the mean normalised innovation squared by source; 1 is expected."""
        by_source: dict[Source, list[float]] = {}
        for white in self.white:
            by_source.setdefault(white.source, []).append(squared(white))
        return {source: float(np.mean(values)) for source, values in by_source.items()}


class FlightRuns:
    """Run the filter over one flight."""

    def __init__(self, recorded: Recorded, config: EkfConfig) -> None:
        imu = [in_body_axes(sample, config.aircraft.rotation_bi) for sample in recorded.imu]
        self.recorded, self.config = replace(recorded, imu=imu), config
        self._t_ns, self._means = np.array([sample.stamp_ns for sample in imu]), _means(imu)

    def aligned(self, values: Array, *, by_antennas: bool) -> Alignment:
        """Return the alignment that starts the filter; raises CalibrationError without one."""
        method = "ekf_heading" if by_antennas else "ekf"
        config = replace(configured(self.config, values, _ALIGNMENT_FLOORS), method=method)
        aligner = Aligner(config, use_heading=by_antennas)
        for sample in _merged(self.recorded.imu, self._aids(values)):
            alignment = aligner.add(sample)
            if alignment is not None:
                # With wrong values the alignment is worse than its covariance says.
                covariance = alignment.covariance + np.diag(_START_SIGMA**2)
                return replace(alignment, covariance=covariance, later=())
        raise CalibrationError(f"the filter does not start: {aligner.reason}")

    def run(
        self,
        values: Array,
        start: Alignment,
        floors: Floors,
        weights: Array | None = None,
        without: Source | None = None,
    ) -> FilterRun:
        """Run the filter from an alignment.

        ``weights`` (N,) are of the flight's measurements, 1 by default; ``without`` is a
        source to leave out. Raises CalibrationError where no measurement can be used.
        """
        config = replace(configured(self.config, values, floors), method="ekf_heading")
        first_ns = start.stamp_ns + _MARGIN_NS
        last_ns = self.recorded.imu[-1].stamp_ns - _MARGIN_NS
        chosen = [
            (index, sample)
            for index, sample in enumerate(self._aids(values))
            if first_ns < sample.stamp_ns < last_ns and sample.source is not without
        ]
        readings = self._readings(chosen, weights)
        mechanisation = FollowedMechanisation(config)
        fusion = WhiteningFusion(config, values, mechanisation, readings)
        ekf = Ekf(config, start, mechanisation, fusion)
        estimates: list[tuple[int, StateEstimate]] = []
        imu = [sample for sample in self.recorded.imu if sample.stamp_ns > start.stamp_ns]
        for sample in _merged(imu, [sample for _, sample in chosen]):
            if not isinstance(sample, ImuSample):
                ekf.add_aiding(sample)
                continue
            ekf.add_imu(sample)
            if not estimates or sample.stamp_ns - estimates[-1][0] >= _ATTITUDE_STEP_NS:
                estimates.append((sample.stamp_ns, ekf.estimate()))
        white = fusion.white
        if not white or not np.all(np.isfinite(white[-1].error)):
            reason = "the filter can use no measurement; run 'tirgeo check' to see why"
            raise CalibrationError(reason)
        stamps = np.repeat([w.stamp_ns for w in white], [len(w.error) for w in white])
        states = [estimate.state for _, estimate in estimates]
        return FilterRun(
            values=values,
            white=white,
            error=np.concatenate([w.error for w in white]),
            slope=np.concatenate([w.slope for w in white]).reshape(-1, len(PARAMETERS)),
            row_ns=(stamps - stamps.min()).astype(float),
            attitude_ns=[stamp_ns for stamp_ns, _ in estimates],
            attitude_q_nb=np.array([state.q_nb for state in states]).reshape(-1, 4),
            velocity_n=np.array([state.velocity_n for state in states]).reshape(-1, 3),
            tilt_sigma_rad=math.sqrt(min(estimate.covariance[0, 0] for _, estimate in estimates)),
            biases=ekf.biases(),
        )

    def _readings(
        self, chosen: Sequence[tuple[int, Aiding]], weights: Array | None
    ) -> dict[tuple[Source, int], WhiteningReading]:
        """Return the IMU's mean readings at the measurements, by source and stamp."""
        first_ns = self._t_ns[0]
        at_ns = np.array([sample.stamp_ns for _, sample in chosen]) - first_ns
        columns = [np.interp(at_ns, self._t_ns - first_ns, column) for column in self._means.T]
        values = np.array(columns).T.reshape(-1, 3, 3)
        return {
            (sample.source, sample.stamp_ns): WhiteningReading(
                index, 1.0 if weights is None else float(weights[index]), *values[k]
            )
            for k, (index, sample) in enumerate(chosen)
        }

    def _aids(self, values: Array) -> list[Aiding]:
        return restamped(self.recorded.aids, values, reported_direction_rad(self.config))


def _merged(imu: Sequence[ImuSample], aids: Sequence[Aiding]) -> Iterator[ImuSample | Aiding]:
    """Yield samples by stamp; a measurement comes before the IMU sample that ends its interval."""
    ordered = sorted(aids, key=lambda sample: sample.stamp_ns)
    return heapq.merge(ordered, imu, key=lambda sample: sample.stamp_ns)


def _means(imu: Sequence[ImuSample]) -> Array:
    """Return running means (N, 9) of force and rate, and the derivative of the rate."""
    step_s = float(np.median(np.diff([sample.stamp_ns for sample in imu]))) * 1e-9
    count = max(1, round(_AVERAGED_S / step_s))
    readings = np.array([[*sample.specific_force_b, *sample.angular_rate_b] for sample in imu])
    means = [np.convolve(column, np.ones(count) / count, "same") for column in readings.T]
    return np.stack([*means, *(np.gradient(column, step_s) for column in means[3:])], axis=1)


def longest_piece(imu: Sequence[ImuSample], max_gap_s: float) -> tuple[int, int]:
    """Return begin and end index of the IMU's longest part, in time, without a gap."""
    cuts = [
        k for k, (a, b) in enumerate(pairwise(imu), 1) if b.stamp_ns - a.stamp_ns > max_gap_s * 1e9
    ]
    pieces = list(pairwise([0, *cuts, len(imu)]))
    return max(pieces, key=lambda piece: imu[piece[1] - 1].stamp_ns - imu[piece[0]].stamp_ns)


def squared(white: White) -> float:
    """Return the normalised innovation squared over its degrees of freedom; 1 is expected."""
    return float(white.error @ white.error) / len(white.error)


def huber_weight(off: float, scale: float, limit: float = 2.5) -> float:
    """Return Huber's weight of an innovation of ``off`` sigmas, if ``scale`` sigmas are usual."""
    off /= scale
    return 1.0 if off <= limit else limit / off


class White(NamedTuple):
    """Hold one measurement's innovation, m = 1 or 3 entries."""

    number: int
    source: Source
    stamp_ns: int
    error: Array  # (m,) whitened: unit variance if the filter is right
    slope: Array  # (m, 7) partials of ``error`` by PARAMETERS


class WhiteningReading(NamedTuple):
    """Hold the index and weight of a measurement, and the IMU's mean readings at its time."""

    number: int
    weight: float  # the measurement's noise is divided by this
    force_b: Array  # (3,) m/s2, mean over some readings
    rate_b: Array  # (3,) rad/s
    turning_b: Array  # (3,) rad/s2, derivative of the rate


class WhiteningFusion(Fusion):
    """Fuse every measurement and store its whitened innovation in ``white``."""

    def __init__(
        self,
        config: EkfConfig,
        values: Array,
        mechanisation: FollowedMechanisation,
        readings: Mapping[tuple[Source, int], WhiteningReading],
    ) -> None:
        super().__init__(config)
        self._values = values
        self._baseline_b = np.array(Baseline.from_config(config.aircraft).direction_b)
        self._mechanisation = mechanisation
        self._readings = readings
        self._state_slope = np.zeros((states_of(config), len(PARAMETERS)))
        self.white: list[White] = []

    def _judged(self, aid: AidMeasurement, estimate: StateEstimate) -> Fused:
        """Return the estimate with a measurement in it, whatever its innovation."""
        state, covariance, aids = estimate.state, estimate.covariance, estimate.aids
        reading = self._readings[aid.source, aid.stamp_ns]
        plain = aid.measurement
        measurement = plain._replace(noise=plain.noise / reading.weight, gate_sigma=_NO_GATE)
        ratio, error, updated, predicted, _ = update(covariance, measurement)
        if error is None or updated is None:
            verdict = Verdict(aid.source, Outcome.INVALID, "impossible covariance")
            return Fused(verdict, estimate)
        spread = predicted + measurement.noise
        design, innovation = measurement.design, measurement.innovation
        moved = self._mechanisation.pop_transition() @ self._state_slope
        slope = self._direct_partials(aid.source, state, reading) - design @ moved
        gain = np.linalg.solve(spread, design @ covariance).T
        self._state_slope = moved + gain @ slope
        root = np.linalg.cholesky(spread)
        whitened = np.linalg.solve(root, np.column_stack([innovation, slope]))
        parts = whitened[:, 0], whitened[:, 1:]  # error and slope
        self.white.append(White(reading.number, aid.source, aid.stamp_ns, *parts))
        track = aids.track(aid.source).used(aid.stamp_ns, self._timeout_ns)
        aids = aids.with_track(aid.source, track)
        verdict = Verdict(aid.source, Outcome.USED, "", ratio, tuple(innovation.tolist()))
        return Fused(verdict, StateEstimate(feedback(state, error), updated, aids))

    def _direct_partials(
        self, source: Source, state: NavState, reading: WhiteningReading
    ) -> Array:
        """Return the direct partials (m, 7) of an innovation by each parameter.

        Terms of the earth's rotation are left out of the antenna's acceleration.
        """
        rotation = matrix_from_quat(np.array(state.q_nb))
        rate_b = reading.rate_b - np.array(state.gyro_bias_b)
        if source is Source.RTK_HEADING:
            return self._heading_partials(rotation, rate_b)
        lever_b = FLU_FRD @ self._values[ANTENNA]
        swing_b = np.cross(rate_b, lever_b)
        partials = np.zeros((3, len(PARAMETERS)))
        if source is Source.RTK_POSITION:
            partials[:, ANTENNA] = -rotation @ FLU_FRD
            partials[:, DELAYS[source]] = np.array(state.velocity_n) + rotation @ swing_b
        else:
            partials[:, ANTENNA] = -rotation @ skew(rate_b) @ FLU_FRD
            force_b = reading.force_b - np.array(state.accel_bias_b)
            force_b += np.cross(rate_b, swing_b) + np.cross(reading.turning_b, lever_b)
            gravity = gravity_down(state.latitude_rad, state.height_m)
            partials[:, DELAYS[source]] = rotation @ force_b + [0.0, 0.0, gravity]
        return partials

    def _heading_partials(self, rotation: Array, rate_b: Array) -> Array:
        """Return the partials (1, 7) of the azimuth of the baseline in ``n``."""
        north, east, _ = rotation @ self._baseline_b

        def azimuth_of(move_b: Array) -> float:
            """Return the change of the azimuth by a small move of the baseline's end."""
            by_north, by_east, _ = rotation @ move_b
            return float((north * by_east - east * by_north) / (north**2 + east**2))

        partials = np.zeros((1, len(PARAMETERS)))
        partials[0, AZIMUTH] = -azimuth_of(np.cross([0.0, 0.0, 1.0], self._baseline_b))
        partials[0, DELAYS[Source.RTK_HEADING]] = azimuth_of(np.cross(rate_b, self._baseline_b))
        return partials


class FollowedMechanisation(Propagation):
    """Propagate as the base class does, and accumulate the transition of the error states."""

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._accumulated = np.eye(states_of(config))

    def followed(self, now: Propagated) -> Propagated:
        """Return ``now`` with its covariance propagated, as the base class does."""
        propagated = super().followed(now)
        if propagated is not now:
            self._accumulated = self._propagation.transition @ self._accumulated
        return propagated

    def pop_transition(self) -> Array:
        """Return the transition matrix (n, n) since the last call, and start another."""
        transition, self._accumulated = self._accumulated, np.eye(len(self._accumulated))
        return transition
