"""Convert the IMU's solution to the RTK antenna, where nobody has measured the lever arm.

A configured lever arm of zeros says that the origin of ``base_link`` is the antenna. The filter's
state is that of the IMU, which is elsewhere; the filter estimates the lever arm between them.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.frames.rotations import matrix_from_quat, skew
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.ins_error_model import ANTENNA, GYRO_BIAS
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.poses import NavSolution


def at_antenna(imu: NavSolution, covariance: Array, antenna_b: Vector) -> NavSolution:
    """Return the solution of the antenna from that of the IMU.

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
