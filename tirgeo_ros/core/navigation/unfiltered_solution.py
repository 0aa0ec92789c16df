"""Estimate the baselines ``raw`` and ``rtk``: the autopilot's attitude and a satellite position.

Between two positions the last one is extrapolated with the last velocity. There is no filter.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import canonical, matrix_from_quat
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.aiding.state_estimate import Aiding
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

_LARGEST_AGE_S = 1.0
#: Sampling rate assumed to convert the gyroscopes' noise density to a variance of one reading.
_NOMINAL_RATE_HZ = 100.0


class UnfilteredSolution:
    """Estimate the pose from the autopilot's attitude and ``source`` (RTK or GPS position)."""

    def __init__(self, config: EkfConfig, source: Source) -> None:
        self._position_source = source
        rtk = source is Source.RTK_POSITION
        self._velocity_source = Source.RTK_VELOCITY if rtk else Source.GPS_VELOCITY
        self._lever_b = config.aircraft.antenna_b(source)
        self._default_covariance = np.diag(np.array(config.gps.position_sigma_m) ** 2)
        if rtk:
            self._default_covariance = np.eye(3) * config.rtk.position_sigma_floor_m**2
        walk, bias = config.imu.angle_random_walk, config.imu.gyro_turn_on_bias
        x, y, z = (w * w * _NOMINAL_RATE_HZ + bias * bias for w in walk)
        self._rate_variance_b = (x, y, z)
        self._attitude_covariance = np.diag(np.radians(config.autopilot.attitude_sigma_deg) ** 2)
        self._imu: ImuSample | None = None
        self._position: PositionSample | None = None
        self._velocity: VelocitySample | None = None

    @property
    def reason(self) -> str:
        """Return what is missing for a solution, or an empty string."""
        if self._imu is None or not usable_attitude(self._imu.autopilot_q_nb):
            return "imu/data has no orientation"
        if self._position is None or not self._fresh(self._position):
            return f"no {self._position_source.value} within {_LARGEST_AGE_S:g} s"
        return ""

    def add_imu(self, sample: ImuSample) -> tuple[Outcome, str]:
        """Store an IMU sample, of which the attitude and the rate enter the solution."""
        self._imu = sample
        if usable_attitude(sample.autopilot_q_nb):
            return Outcome.USED, ""
        return Outcome.INVALID, "no orientation"

    def add_aiding(self, sample: Aiding) -> Verdict:
        """Store a position or a velocity of the chosen receiver; any other sample is UNUSED."""
        if sample.source not in {self._position_source, self._velocity_source}:
            return Verdict(sample.source, Outcome.UNUSED)
        if isinstance(sample, PositionSample):
            self._position = sample
        elif isinstance(sample, VelocitySample):
            self._velocity = sample
        return Verdict(sample.source, Outcome.USED)

    def solution(self) -> NavSolution | None:
        """Return the position extrapolated to the newest IMU sample, or None (see ``reason``)."""
        if self.reason or self._imu is None or self._position is None:
            return None
        q_nb = self._imu.autopilot_q_nb
        assert q_nb is not None
        velocity = self._velocity if self._velocity and self._fresh(self._velocity) else None
        velocity_n = velocity.velocity_n if velocity else np.zeros(3)
        rotation = matrix_from_quat(q_nb)
        position = self._position
        shift = velocity_n * self._age_s(position.stamp_ns) - rotation @ self._lever_b
        meridian, transverse = radii_of_curvature(position.latitude_rad)
        east_m = (transverse + position.height_m) * np.cos(position.latitude_rad)
        return NavSolution(
            self._imu.stamp_ns,
            position.latitude_rad + float(shift[0]) / (meridian + position.height_m),
            math.remainder(position.longitude_rad + float(shift[1]) / float(east_m), 2 * math.pi),
            position.height_m - float(shift[2]),
            velocity_n,
            canonical(q_nb),
            self._imu.angular_rate_b,
            self._rate_variance_b,
            self._covariance(position, velocity),
        )

    def _age_s(self, stamp_ns: int) -> float:
        """Return the age (s) at the newest IMU sample; negative for what was measured after it."""
        return (self._imu.stamp_ns - stamp_ns) * 1e-9 if self._imu else math.inf

    def _fresh(self, sample: PositionSample | VelocitySample) -> bool:
        return abs(self._age_s(sample.stamp_ns)) <= _LARGEST_AGE_S

    def _covariance(self, position: PositionSample, velocity: VelocitySample | None) -> Array:
        covariance = np.zeros((9, 9))
        covariance[:3, :3] = _or_else(position.covariance_n, self._default_covariance)
        covariance[3:6, 3:6] = self._attitude_covariance
        covariance[6:, 6:] = _or_else(velocity.covariance_n, np.eye(3)) if velocity else np.eye(3)
        return covariance


def _or_else(covariance: Array, otherwise: Array) -> Array:
    """Return ``covariance``, or ``otherwise`` where a variance of the former is not positive.

    Messages without a covariance have variances of zero.
    """
    return covariance if np.all(np.diag(covariance) > 0) else otherwise
