"""Aid the filter with the satellite position of an antenna (Eq. 4 of Ren et al. 2022).

H includes the lever arm's partials in attitude, which the paper leaves out. The error of the
ordinary GPS, metres that vary over a minute, is estimated as a state of the filter while RTK is
fixed, from one position a second. Without RTK, positions less the estimated error continue from
where RTK stopped, and the covariance grows as the error wanders.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.aiding.aid import Aid
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS, AidStatus
from tirgeo_ros.core.navigation.aiding.state_estimate import (
    AidMeasurement,
    Modelled,
    StateEstimate,
    added,
    floored,
    not_fixed,
)
from tirgeo_ros.core.navigation.ins.ins_error_model import (
    ANTENNA,
    GPS_ERROR,
    POSITION,
    flat_memory,
    has_antenna,
)
from tirgeo_ros.core.navigation.ins.kalman import Measurement
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Vector, matrix, rotate
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source

#: While RTK is there the GPS error is learned at this interval: a second less stamp jitter.
_LEARNING_NS = 950_000_000
#: Variation of a GPS error that still counts as the same error.
_SLACK_M = 2.0


def innovation_n(state: NavState, sample: PositionSample, lever_n: Vector) -> Vector:
    """Return measured less predicted antenna position (Eq. 5), NED m; ``lever_n``: ``R_nb l``."""
    meridian, transverse = radii_of_curvature(state.latitude_rad)
    east = (sample.longitude_rad - state.longitude_rad + math.pi) % (2 * math.pi) - math.pi
    middle = 0.5 * (sample.latitude_rad + state.latitude_rad)
    return (
        (sample.latitude_rad - state.latitude_rad) * (meridian + state.height_m) - lever_n[0],
        east * (transverse + state.height_m) * math.cos(middle) - lever_n[1],
        state.height_m - sample.height_m - lever_n[2],
    )


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
    """Return the factor that makes the variance of a lasting error one of white noise.

    Positions do not average it away. White noise with the same power at low frequency has
    2 tau / step times its variance, tau being the correlation time.
    """
    return max(2 * time_s / min(max(step_ns * 1e-9, 0.02), 1.0), 1.0)


class RtkPositionAid(Aid):
    """Use positions of RTK from float on."""

    source = Source.RTK_POSITION
    delay = "rtk.delay_s"
    look_at = "aircraft.rtk_antenna_m, rtk.delay_s"
    steps = True
    eased = True
    resets = POSITION

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._rtk = config.rtk
        self._lever_b: Vector = tuple(config.aircraft.rtk_lever_b.tolist())

    def measured(
        self, sample: PositionSample, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement; the estimate knows its status, and its offset for the median."""
        state = estimate.state
        aids = estimate.aids.heard(sample.status, sample.stamp_ns, self._timeout_ns)
        estimate = estimate._replace(aids=aids)
        if sample.status < FixStatus.FLOAT:
            return not_fixed(self.source, sample.status), estimate
        rotation = rotation_of(state.q_nb)
        lever_n = rotate(rotation, added(self._lever_b, aids.receivers.antenna_b))
        innovation = innovation_n(state, sample, lever_n)
        offset = added(innovation, state.correction_n)
        if self._rtk.median_window > 1:
            innovation, estimate = self._median(offset, estimate)
        noise, sigma_m = self._noise(sample, aids)
        gate_sigma = self._rtk.gate_sigma
        design = arm_design(self._states, lever_n, POSITION.start)
        if has_antenna(self._states):
            design[:, ANTENNA] = matrix(rotation)
        measurement = Measurement(np.array(innovation), design, noise, gate_sigma)
        slack = 1.5 * gate_sigma * sigma_m
        return AidMeasurement(
            sample.source, sample.stamp_ns, measurement, offset, state.correction_n, slack
        ), estimate

    def _median(self, offset: Vector, estimate: StateEstimate) -> tuple[Vector, StateEstimate]:
        """Return the innovation of the median, NED m, and the estimate with the offset stored.

        A median of positions would lag behind an aircraft in motion. Offsets from the path that
        the IMU alone has taken show a jump as positions do, but not the motion.
        """
        aids, moved = estimate.aids, estimate.state.correction_n
        offsets = (*aids.offsets_n, offset)[-self._rtk.median_window :]
        north, east, down = np.median(offsets, axis=0).tolist()
        estimate = estimate._replace(aids=aids._replace(offsets_n=offsets))
        return (north - moved[0], east - moved[1], down - moved[2]), estimate

    def _noise(self, sample: PositionSample, aids: AidStatus) -> tuple[Array, float]:
        """Return R (3, 3), and the scatter (m) of one position against the next."""
        if sample.status is FixStatus.FIXED:
            noise = floored(sample.covariance_n, self._rtk.position_sigma_floor_m)
            return noise, math.sqrt(noise[0, 0] + noise[1, 1] + noise[2, 2])
        step_ns = sample.stamp_ns - aids.track(sample.source).used_ns
        noise = floored(sample.covariance_n, self._rtk.float_sigma_m)
        return noise * white_factor(self._rtk.float_time_s, step_ns), self._rtk.float_sigma_m


class GpsPositionAid(Aid):
    """Use positions of the ordinary GPS, with their slow error as a state."""

    source = Source.GPS_POSITION
    delay = "gps.delay_s"
    look_at = "aircraft.gps_antenna_m, gps.delay_s"
    resets = GPS_ERROR  # a jump of it leaves the state unchanged

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._gps = config.gps
        self._lever_b: Vector = tuple(config.aircraft.gps_lever_b.tolist())
        noise_m2 = config.gps.position_noise_m**2
        self._noise = np.eye(3) * noise_m2
        self._known_m2 = np.square(config.gps.position_sigma_m) + noise_m2

    def spare(self, sample: PositionSample, aids: AidStatus) -> bool:
        """Return whether RTK is fixed and used, and the error was learned within a second."""
        now_ns = sample.stamp_ns
        return (
            aids.status is FixStatus.FIXED
            and aids.track(Source.RTK_POSITION).recent(now_ns, self._timeout_ns)
            and aids.track(self.source).recent(now_ns, _LEARNING_NS)
        )

    def measured(
        self, sample: PositionSample, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement of a position with its slow error in it, and the estimate."""
        if sample.status < FixStatus.SINGLE:
            return not_fixed(self.source, sample.status), estimate
        state, error_n = estimate.state, estimate.aids.receivers.gps_error_n
        lever_n = rotate(rotation_of(state.q_nb), self._lever_b)
        innovation = innovation_n(state, sample, added(lever_n, error_n))
        design = arm_design(self._states, lever_n, POSITION.start)
        design[:, GPS_ERROR] = np.eye(3)
        # Reported variance beyond that of the slow error in the state.
        beyond = np.maximum(np.diagonal(sample.covariance_n) - self._known_m2, 0.0)
        beyond *= self._beyond_factor(estimate.aids, sample.stamp_ns)
        noise = self._noise + np.diag(beyond)
        measurement = Measurement(np.array(innovation), design, noise, self._gps.gate_sigma)
        invariant = added(innovation, state.correction_n)
        return AidMeasurement(
            sample.source, sample.stamp_ns, measurement, invariant, state.correction_n, _SLACK_M
        ), estimate

    def _beyond_factor(self, aids: AidStatus, now_ns: int) -> float:
        """Return the factor on variances beyond the state's: 1 until RTK is gone for long."""
        used_ns, rtk = aids.track(self.source).used_ns, aids.track(Source.RTK_POSITION)
        time_s = self._gps.position_time_s
        if used_ns == NEVER_NS or rtk.recent(now_ns, round(time_s * 1e9)):
            return 1.0
        return white_factor(time_s, now_ns - used_ns)
