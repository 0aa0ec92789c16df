"""Poses of a camera, by the angles of its body."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import quat_from_euler, quat_multiply
from tirgeo_ros.core.types.poses import CameraPose


def camera_pose(position_n, roll_deg=0.0, pitch_deg=-90.0, yaw_deg=0.0, covariance=None, stamp=0):
    """Return a pose; its covariance is zero unless given: (6, 6), or one variance for all."""
    q_ng = quat_from_euler(*np.radians([roll_deg, pitch_deg, yaw_deg]))
    covariance = 0.0 if covariance is None else covariance
    covariance = covariance * np.eye(6) if np.ndim(covariance) == 0 else covariance
    q_nc = quat_multiply(q_ng, Q_BODY_OPTICAL)
    return CameraPose(stamp, np.array(position_n, float), q_nc, covariance)
