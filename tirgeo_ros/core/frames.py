"""ROS's frames (ENU, FLU) and the core's (NED, FRD), and the camera's two.

NED and ENU differ by swapping the first two axes and turning the third; FRD and FLU by turning
the last two. Both maps are their own inverse, so one function serves both ways.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.attitude import canonical, quat_multiply
from tirgeo_ros.core.samples import Array

#: ENU from NED and back: rows are E, N, U.
ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
#: FLU from FRD and back.
FLU_FRD = np.diag([1.0, -1.0, -1.0])
#: ``R_gc``: camera body (forward, right, down) from optical (right, down, forward).
BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

_Q_ENU_NED = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0])
_Q_FLU_FRD = np.array([0.0, 1.0, 0.0, 0.0])
#: ``q_gc``, the quaternion of BODY_OPTICAL.
Q_BODY_OPTICAL = np.array([0.5, 0.5, 0.5, 0.5])


def enu_from_ned(v: Array) -> Array:
    """(..., 3) NED to ENU, or ENU to NED."""
    v = np.asarray(v, float)
    return np.stack([v[..., 1], v[..., 0], -v[..., 2]], -1)


def flu_from_frd(v: Array) -> Array:
    """(..., 3) FRD to FLU, or FLU to FRD."""
    return np.asarray(np.asarray(v, float) * np.array([1.0, -1.0, -1.0]))


def quat_enu_flu_from_ned_frd(q: Array) -> Array:
    """(..., 4) FRD-to-NED to FLU-to-ENU, or the other way round."""
    return canonical(quat_multiply(quat_multiply(_Q_ENU_NED, q), _Q_FLU_FRD))


def quat_enu_from_ned(q: Array) -> Array:
    """(..., 4) any-frame-to-NED to the same frame to ENU, or the other way round."""
    return canonical(quat_multiply(_Q_ENU_NED, q))


def covariance_enu_from_ned(covariance: Array) -> Array:
    """(3k, 3k) covariance of k NED vectors to ENU, or the other way round."""
    blocks = np.kron(np.eye(covariance.shape[0] // 3), ENU_NED)
    return np.asarray(blocks @ covariance @ blocks.T)
