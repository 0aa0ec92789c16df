"""ROS's frames (ENU, FLU) and the core's (NED, FRD), and the camera's two.

NED and ENU differ by swapping the first two axes and turning the third; FRD and FLU by turning
the last two. Both maps are their own inverse, so one serves both ways. What is inside a message
is turned by ``io.messages.axes``.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.types.arrays import Array

#: ENU from NED and back: rows are E, N, U.
ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
#: FLU from FRD and back.
FLU_FRD = np.diag([1.0, -1.0, -1.0])
#: ``R_gc``: camera body (forward, right, down) from optical (right, down, forward).
BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
#: ``q_gc``, the quaternion of BODY_OPTICAL.
Q_BODY_OPTICAL = np.array([0.5, 0.5, 0.5, 0.5])

_HALF = math.sqrt(0.5)

Quaternion = tuple[float, float, float, float]  # w, x, y, z


def flu_from_frd(v: Array) -> Array:
    """(..., 3) FRD to FLU, or FLU to FRD."""
    return np.asarray(np.asarray(v, float) * FLU_FRD.diagonal())


def quat_turned_both(w: float, x: float, y: float, z: float) -> Quaternion:
    """Quaternion (w, x, y, z) of FRD-to-NED to FLU-to-ENU, or the other way round.

    Linear and unchecked: a quaternion of any length keeps it.
    """
    return _HALF * (w + z), _HALF * (x + y), _HALF * (x - y), _HALF * (w - z)
