"""Convert values of messages between ROS's axes and the core's (``core.frames.axes``).

The functions are fast, as there are hundreds of messages a second, and check nothing. The maps are
linear, so a zero or NaN quaternion arrives as it was sent and the core can detect it.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.frames.axes import ENU_NED
from tirgeo_ros.core.types.arrays import Array, Quaternion

_HALF = math.sqrt(0.5)
#: The rotation between equal axes.
NO_TURN: Quaternion = (1.0, 0.0, 0.0, 0.0)
#: The gimbal's joints in the order of its chain, and the sign of each from FLU to FRD: the axes y
#: and z point the other way, x does not.
JOINT_SIGNS = {"gimbal_yaw_joint": -1.0, "gimbal_roll_joint": 1.0, "gimbal_pitch_joint": -1.0}
#: Frame of joint messages that were computed without encoders: the topic of their source.
COMPUTED_FROM = "gimbal/attitude"


def quat_turned_world(w: float, x: float, y: float, z: float) -> Quaternion:
    """Convert a quaternion (w, x, y, z) of any frame to NED into that to ENU, or the reverse."""
    return _HALF * (x + y), -_HALF * (w + z), _HALF * (z - w), _HALF * (x - y)


def positive(q: Quaternion) -> Quaternion:
    """Return the same rotation with w >= 0."""
    w, x, y, z = q
    return (-w, -x, -y, -z) if w < 0 else q


def _entries(blocks: int) -> tuple[np.ndarray, Array]:
    """Return the source index and the sign of each entry of a turned covariance; both flat."""
    turn = np.kron(np.eye(blocks), ENU_NED)
    source = np.argmax(np.abs(turn), axis=1)
    sign = turn.sum(axis=1)
    size = 3 * blocks
    return (source[:, None] * size + source).ravel(), np.outer(sign, sign).ravel()


_WORLD = {3 * blocks: _entries(blocks) for blocks in (1, 2)}


def covariance_turned_world(covariance: Array, size: int) -> Array:
    """Convert a covariance of NED vectors to ENU, or the reverse.

    Returns (size * size,) row-major; ``size`` is 3 or 6. Takes any shape of ``size * size``
    numbers.
    """
    source, sign = _WORLD[size]
    turned: Array = np.asarray(covariance).take(source)
    turned *= sign
    return turned
