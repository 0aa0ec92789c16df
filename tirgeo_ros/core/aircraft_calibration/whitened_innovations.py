"""Run the filter over a whole flight without gates; whiten its innovations, with their slopes.

Prediction errors and their slopes by parameters (Ljung, System Identification, 2nd ed., chapter
7). An estimate of parameters needs the same measurements in every run. So nothing is refused or
reset; an outlier has its noise enlarged by a weight. A parameter enters a measurement directly,
and through the state that earlier measurements have moved:

    d innovation = direct - H d state,    d state' = transition (d state + gain d innovation)

so that one run of the filter gives the slopes by all parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.aircraft_calibration.parameters import (
    ANTENNA,
    AZIMUTH,
    DELAYS,
    PARAMETERS,
)
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.axes import FLU_FRD
from tirgeo_ros.core.frames.rotations import matrix_from_quat, skew
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import Baseline
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.state_estimate import AidMeasurement, Fused, StateEstimate
from tirgeo_ros.core.navigation.ins.ins_error_model import feedback, states_of
from tirgeo_ros.core.navigation.ins.kalman import update
from tirgeo_ros.core.navigation.ins.propagation import Propagated, Propagation
from tirgeo_ros.core.navigation.ins.strapdown import NavState
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

_NO_GATE = 1e6


class WhiteningReading(NamedTuple):
    """Hold the index and weight of a measurement, and the IMU's mean readings at its time."""

    number: int
    weight: float  # the measurement's noise is divided by it
    force_b: Array  # (3,) m/s2, mean over some readings
    rate_b: Array  # (3,) rad/s
    turning_b: Array  # (3,) rad/s2, derivative of the rate


class White(NamedTuple):
    """Hold one measurement's innovation, m = 1 or 3 entries."""

    number: int
    source: Source
    stamp_ns: int
    innovation: Array  # (m,) m, m/s or rad
    error: Array  # (m,) the same whitened: unit variance if the filter is right
    slope: Array  # (m, 7) partials of ``error`` by PARAMETERS


class FollowedMechanisation(Propagation):
    """Propagate as the base class does, and accumulate the transition of the error states."""

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._motion = np.eye(states_of(config))

    def followed(self, now: Propagated) -> Propagated:
        """Return ``now`` with its covariance propagated, as the base class does."""
        found = super().followed(now)
        if found is not now:
            self._motion = self._propagation.transition @ self._motion
        return found

    def taken(self) -> Array:
        """Return the transition matrix (n, n) since the last call."""
        found, self._motion = self._motion, np.eye(len(self._motion))
        return found


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

    def _judged(
        self,
        aid: AidMeasurement,
        estimate: StateEstimate,
        autopilot_q_nb: Array | None,  # noqa: ARG002
    ) -> Fused:
        """Return the estimate with a measurement in it, whatever its innovation."""
        state, covariance, aids = estimate[:3]
        reading = self._readings[aid.source, aid.stamp_ns]
        plain = aid.measurement
        measurement = plain._replace(noise=plain.noise / reading.weight, gate_sigma=_NO_GATE)
        ratio, error, updated, predicted, _ = update(covariance, measurement)
        if error is None or updated is None:
            verdict = Verdict(aid.source, Outcome.INVALID, "impossible covariance")
            return Fused(verdict, estimate)
        spread = predicted + measurement.noise
        design, innovation = measurement.design, measurement.innovation
        moved = self._mechanisation.taken() @ self._state_slope
        slope = self._direct_partials(aid.source, state, reading) - design @ moved
        gain = np.linalg.solve(spread, design @ covariance).T
        self._state_slope = moved + gain @ slope
        root = np.linalg.cholesky(spread)
        whitened = np.linalg.solve(root, np.column_stack([innovation, slope]))
        self.white.append(
            White(
                reading.number,
                aid.source,
                aid.stamp_ns,
                innovation,
                whitened[:, 0],
                whitened[:, 1:],
            )
        )
        track = aids.track(aid.source).used(aid.stamp_ns, self._timeout_ns)
        aids = aids.with_track(aid.source, track)
        verdict = Verdict(aid.source, Outcome.USED, "", ratio, tuple(innovation.tolist()))
        return Fused(verdict, StateEstimate(feedback(state, error), updated, aids))

    def _direct_partials(
        self, source: Source, state: NavState, reading: WhiteningReading
    ) -> Array:
        """Return the direct partials (m, 7) of an innovation by each parameter."""
        rotation = matrix_from_quat(np.array(state.q_nb))
        rate_b = reading.rate_b - np.array(state.gyro_bias_b)
        if source is Source.RTK_HEADING:
            return self._direct_heading_partials(rotation, rate_b)
        lever_b = FLU_FRD @ self._values[ANTENNA]
        found = np.zeros((3, len(PARAMETERS)))
        if source is Source.RTK_POSITION:
            found[:, ANTENNA] = -rotation @ FLU_FRD
            moving_n = np.array(state.velocity_n) + rotation @ np.cross(rate_b, lever_b)
        else:
            found[:, ANTENNA] = -rotation @ skew(rate_b) @ FLU_FRD
            moving_n = self._acceleration_n(rotation, state, reading, rate_b, lever_b)
        found[:, DELAYS[source]] = moving_n
        return found

    @staticmethod
    def _acceleration_n(
        rotation: Array, state: NavState, reading: WhiteningReading, rate_b: Array, lever_b: Array
    ) -> Array:
        """Return the antenna's acceleration (3,), m/s2, without terms of the earth's rotation."""
        swing_b = np.cross(rate_b, np.cross(rate_b, lever_b)) + np.cross(
            reading.turning_b, lever_b
        )
        force_b = reading.force_b - np.array(state.accel_bias_b)
        gravity = gravity_down(state.latitude_rad, state.height_m)
        return np.asarray(rotation @ (force_b + swing_b) + [0.0, 0.0, gravity])

    def _direct_heading_partials(self, rotation: Array, rate_b: Array) -> Array:
        """Return the partials (1, 7) of the azimuth of the baseline in ``n``."""
        north, east, _ = rotation @ self._baseline_b

        def azimuth_of(move_b: Array) -> float:
            """Return the change of the azimuth by a small move of the baseline's end."""
            by_north, by_east, _ = rotation @ move_b
            return float((north * by_east - east * by_north) / (north**2 + east**2))

        found = np.zeros((1, len(PARAMETERS)))
        found[0, AZIMUTH] = -azimuth_of(np.cross([0.0, 0.0, 1.0], self._baseline_b))
        found[0, DELAYS[Source.RTK_HEADING]] = azimuth_of(np.cross(rate_b, self._baseline_b))
        return found


def squared(white: White) -> float:
    """Return the normalised innovation squared over its degrees of freedom; 1 is expected."""
    return float(white.error @ white.error) / len(white.error)


def huber_weight(off: float, scale: float, limit: float = 2.5) -> float:
    """Return Huber's weight of an innovation of ``off`` sigmas, if ``scale`` sigmas are usual."""
    off /= scale
    return 1.0 if off <= limit else limit / off
