"""Check that a flight moved as each parameter needs it, and advise what to fly.

Standard deviations alone do not show that. Over a hover that drifts by centimetres they shrink
with time, for they assume that the receiver's error has no memory.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.aircraft_calibration.filter_run import FilterRun
from tirgeo_ros.core.aircraft_calibration.parameters import PARAMETERS
from tirgeo_ros.core.frames.rotations import euler_from_quat, matrix_from_quat
from tirgeo_ros.core.types.arrays import Array

_TURNS = "turns of the nose through 180 deg or more, right and left"
_SPEED = "legs in several directions with brisk starts, stops and turns, at 5 m/s or more"
_LEANS = "starts and stops that tilt the aircraft by 10 deg or more, in several directions"
#: What to fly for each of PARAMETERS.
ADVICE = {
    "antenna_forward": _TURNS,
    "antenna_left": _TURNS,
    "antenna_up": _LEANS,
    "baseline_azimuth": _SPEED,
    "position_delay": _SPEED,
    "velocity_delay": _SPEED,
    "heading_delay": "turns at 20 deg/s or more, right and left, with rests between",
}
_BY_SPEED = ("antenna_up", "baseline_azimuth", "position_delay", "velocity_delay")
_LEAST_TURNED_RAD = math.radians(90)
_LEAST_TILT_RAD = math.radians(1.5)  # rms about the mean
_LEAST_SPEED_M_S = 1.0  # rms about the mean
_LEAST_TURN_RATE_RAD_S = math.radians(3.0)  # rms


def not_flown(run: FilterRun) -> dict[str, str]:
    """Return the parameters that the motion of a flight cannot observe, with what was missing."""
    yaw = np.unwrap(euler_from_quat(run.attitude_q_nb)[:, 2])
    turned_rad = float(np.ptp(yaw))
    times_s = np.array([stamp - run.attitude_ns[0] for stamp in run.attitude_ns]) * 1e-9
    rate_rad_s = float(np.sqrt(np.mean(np.gradient(yaw, times_s) ** 2)))
    tilt_rad = _rms_about_mean(matrix_from_quat(run.attitude_q_nb)[:, 2, :2])
    speed_m_s = _rms_about_mean(run.velocity_n[:, :2])
    found: dict[str, str] = {}
    if turned_rad < _LEAST_TURNED_RAD:
        said = f"the nose turned through {math.degrees(turned_rad):.0f} deg only"
        found |= dict.fromkeys(PARAMETERS[:2], said)
    if tilt_rad < _LEAST_TILT_RAD:
        found["antenna_up"] = f"the tilt varied by {math.degrees(tilt_rad):.1f} deg rms only"
    if speed_m_s < _LEAST_SPEED_M_S:
        said = f"the velocity varied by {speed_m_s:.1f} m/s rms only"
        found |= dict.fromkeys(_BY_SPEED, said)
    if rate_rad_s < _LEAST_TURN_RATE_RAD_S:
        found["heading_delay"] = f"it turned at {math.degrees(rate_rad_s):.1f} deg/s rms only"
    return found


def _rms_about_mean(vectors: Array) -> float:
    """Return the root mean square distance of (N, 2) from their mean."""
    return float(np.sqrt(np.mean(np.sum((vectors - vectors.mean(0)) ** 2, axis=1))))
