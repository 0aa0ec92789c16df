"""Make the published solution of a filter's state and covariance."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, skew
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.ins.ins_error_model import (
    ANTENNA,
    ATTITUDE,
    GYRO_BIAS,
    POSITION,
    VELOCITY,
    has_antenna,
    states_of,
)
from tirgeo_ros.core.navigation.ins.strapdown import NavState
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.poses import NavSolution

_ROWS = np.r_[POSITION, ATTITUDE, VELOCITY]


class SolutionMaker:
    """Make solutions in the form that the parameters ask for."""

    def __init__(self, config: EkfConfig) -> None:
        states = states_of(config)
        self._at_antenna = has_antenna(states) and not config.aircraft.rtk_lever_b.any()
        # Flat indices of the solution's covariance (9, 9) in the filter's covariance.
        self._entries = states * _ROWS[:, None] + _ROWS

    def made(
        self,
        stamp_ns: int,
        state: NavState,
        covariance: Array,
        rate_b: Vector,
        white_b: Vector,
        antenna_b: Vector,
    ) -> NavSolution:
        """Return the solution of a state and the covariance (n, n) of its error.

        ``rate_b`` is the angular rate as read (rad/s), ``white_b`` the variances of its white
        noise, ``antenna_b`` the estimated part of the RTK antenna's place (m).
        """
        bias, (x, y, z), item = state.gyro_bias_b, white_b, covariance.item
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
        solution: NavSolution = tuple.__new__(NavSolution, fields)  # half of NavSolution(...)
        return at_antenna(solution, covariance, antenna_b) if self._at_antenna else solution


def unsure_by(solution: NavSolution, step: tuple[float, ...]) -> NavSolution:
    """Return a solution as uncertain as an RTK step (m, NED) that is not accepted yet is large."""
    if step:
        solution.covariance[:3, :3] += np.outer(step, step)
    return solution


def at_antenna(imu: NavSolution, covariance: Array, antenna_b: Vector) -> NavSolution:
    """Return the solution of the antenna from that of the IMU.

    A configured lever arm of zeros, which nobody has measured, says that the origin of
    ``base_link`` is the antenna; the state is that of the IMU, which is elsewhere.
    ``covariance`` (n, n) is the filter's, the lever arm ``antenna_b`` (m) among its error states.
    With ``l`` from IMU to antenna in ``b``, the position is ``p + R l`` and the velocity
    ``v + R (w x l)`` (Groves, 2nd ed., 14.3.4). The covariance (9, 9) follows to first order.
    """
    lever_b = np.array(antenna_b)
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
