"""The heading of two antennas (Eq. 7 and 9, with the row that the full attitude gives)."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.attitude import wrap_pi
from tirgeo_ros.core.error_state import STATES
from tirgeo_ros.core.kalman import Measurement
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.strapdown import NavState, matrix, rotation_of

#: Below this horizontal share a baseline has no heading worth the name (75 deg of tilt).
_LEAST_HORIZONTAL = 0.25


def baseline_b(offset_deg: float) -> Array:
    """(3,) unit vector from the first antenna to the second, FRD, ``offset_deg`` from the nose."""
    angle = math.radians(offset_deg)
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def azimuth(direction_n: Array) -> float:
    """Azimuth of a NED vector, radians from north, clockwise."""
    return math.atan2(direction_n[1], direction_n[0])


def heading_measurement(
    state: NavState, heading_rad: float, variance_rad2: float, baseline: Array, gate_sigma: float
) -> Measurement | None:
    """The measurement that a baseline's azimuth is, or None where the baseline stands upright.

    With ``u = R u_b`` and ``du = phi x u`` the azimuth moves by
    ``phi_D - u_D (u_N phi_N + u_E phi_E) / (u_N^2 + u_E^2)``; with a baseline along the nose it is
    ``[tan(pitch) cos(yaw), tan(pitch) sin(yaw), 1] phi``.
    """
    u = matrix(rotation_of(state.q_nb)) @ baseline
    horizontal = u[0] * u[0] + u[1] * u[1]
    if horizontal < _LEAST_HORIZONTAL**2:
        return None
    design = np.zeros((1, STATES))
    design[0, :3] = -u[2] * u[0] / horizontal, -u[2] * u[1] / horizontal, 1.0
    innovation = np.atleast_1d(wrap_pi(heading_rad - azimuth(u)))
    return Measurement(innovation, design, np.array([[variance_rad2]]), gate_sigma)
