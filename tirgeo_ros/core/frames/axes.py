"""Convert between ROS axes (ENU, FLU) and the core's (NED, FRD), and between the camera's two.

NED and ENU differ by a swap of the first two axes and the sign of the third; FRD and FLU by the
signs of the last two. Each conversion is its own inverse, so one function serves both directions.
The contents of ROS messages are converted by ``io.messages.message_axes``.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.types.arrays import Array, Quaternion

#: NED to ENU, or ENU to NED (the matrix is its own inverse).
ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
#: FRD to FLU, or FLU to FRD.
FLU_FRD = np.diag([1.0, -1.0, -1.0])
#: ``R_gc``: optical frame (right, down, forward) to camera body (forward, right, down).
BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
#: ``q_gc``, (w, x, y, z): the quaternion of BODY_OPTICAL.
Q_BODY_OPTICAL = np.array([0.5, 0.5, 0.5, 0.5])

_HALF = math.sqrt(0.5)


def flu_from_frd(v: Array) -> Array:
    """Convert vectors (..., 3) from FRD to FLU, or from FLU to FRD."""
    return np.asarray(np.asarray(v, float) * FLU_FRD.diagonal())


def quat_turned_both(w: float, x: float, y: float, z: float) -> Quaternion:
    """Convert an attitude quaternion (w, x, y, z) from FRD-to-NED to FLU-to-ENU, or back."""
    return _HALF * (w + z), _HALF * (x + y), _HALF * (x - y), _HALF * (w - z)
