"""Compute azimuths and headings: radians from true north, clockwise, wrapped to half a turn.

``math`` serves single values at the filter's rate, NumPy serves arrays; their wrapped intervals
differ in which end is closed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.types.arrays import Array


def wrapped(angle_rad: float) -> float:
    """Return an angle as the same direction in [-pi, pi]."""
    return math.remainder(angle_rad, math.tau)


def wrap_pi(angle_rad: npt.ArrayLike) -> Array:
    """Return angles, any shape, wrapped to [-pi, pi)."""
    angles = (np.asarray(angle_rad, float) + np.pi) % (2 * np.pi) - np.pi
    # Rounding can make the remainder 2 pi itself.
    return np.asarray(np.where(angles < np.pi, angles, -np.pi))


def azimuth(direction_n: Sequence[float] | Array) -> float:
    """Return the azimuth of a NED vector (3,); its length does not matter."""
    return math.atan2(direction_n[1], direction_n[0])


def azimuths(directions_n: Array) -> Array:
    """Return the azimuths (...) of NED vectors (..., 3)."""
    return np.asarray(np.arctan2(directions_n[..., 1], directions_n[..., 0]))


def heading_of(q_nb: Array) -> float:
    """Return the azimuth of the body's x axis, the nose, from a unit quaternion (4,) wxyz."""
    return azimuth(rotation_of(q_nb.tolist())[0::3])


def azimuth_row(direction_n: Sequence[float] | Array) -> tuple[float, float, float]:
    """Return the derivative (3,) of a direction's azimuth by the attitude error ``phi_n``.

    With ``u = R u_b`` and ``du = phi x u`` the azimuth changes by
    ``phi_D - u_D (u_N phi_N + u_E phi_E) / (u_N^2 + u_E^2)``. For the nose it is the last row of
    Equation 9 of Ren et al. 2022 with its errata: [tan(pitch) cos(yaw), tan(pitch) sin(yaw), 1].
    """
    north, east, down = direction_n
    horizontal = north * north + east * east
    return -down * north / horizontal, -down * east / horizontal, 1.0
