"""Model what the antennas of satellite receivers measure: positions, velocities, a baseline.

H includes the lever arm's partials in attitude, which Ren et al. 2022 leave out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.rotations import azimuth
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.ins.ins_error_model import VELOCITY, flat_memory
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Rotation, Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import PositionSample

#: A larger turn is the antennas' fault: no gyroscope misses it and few compasses err by as much.
LARGE_TURN_RAD = math.radians(20.0)


def innovation_n(state: NavState, sample: PositionSample, lever_n: Vector) -> Vector:
    """Return measured less predicted antenna position (Eq. 5), NED m; ``lever_n``: ``R_nb l``."""
    meridian, transverse = radii_of_curvature(state.latitude_rad)
    east = (sample.longitude_rad - state.longitude_rad + math.pi) % (2 * math.pi) - math.pi
    middle = 0.5 * (sample.latitude_rad + state.latitude_rad)
    return (
        (sample.latitude_rad - state.latitude_rad) * (meridian + state.height_m) - lever_n[0],
        east * (transverse + state.height_m) * math.cos(middle) - lever_n[1],
        state.height_m - sample.height_m - lever_n[2],
    )


def arm_design(states: int, arm_n: Vector, first: int) -> Array:
    """Return H (3, states) of ``R_true a = R a - [R a x] phi``, plus the states from ``first``."""
    design = np.zeros((3, states))
    x, y, z = arm_n
    flat = flat_memory(design)
    second, third = states, 2 * states
    flat[1], flat[2] = z, -y
    flat[second], flat[second + 2] = -z, x
    flat[third], flat[third + 1] = y, -x
    flat[first] = flat[second + first + 1] = flat[third + first + 2] = 1.0
    return design


def velocity_design(
    states: int, rotation_nb: Rotation, swing: Vector, lever_arm_b: Vector
) -> Array:
    """Return H (3, states) of an antenna velocity: the lever arm swings with the body's rate.

    The rate is the reading less its bias, so ``d(w x l) = -db x l = [l x] db``.
    """
    design = arm_design(states, swing, VELOCITY.start)
    flat = flat_memory(design)
    x, y, z = lever_arm_b
    for row in range(3):
        a, b, c = rotation_nb[3 * row : 3 * row + 3]
        at = row * states + 9
        flat[at], flat[at + 1], flat[at + 2] = b * z - c * y, c * x - a * z, a * y - b * x
    return design


def white_factor(time_s: float, step_ns: int) -> float:
    """Return the factor that makes the variance of a lasting error one of white noise.

    Positions do not average it away. White noise with the same power at low frequency has
    2 tau / step times its variance, tau being the correlation time.
    """
    return max(2 * time_s / min(max(step_ns * 1e-9, 0.02), 1.0), 1.0)


class Baseline(NamedTuple):
    """Hold the direction from the first antenna to the second, and the heading's offset."""

    direction_b: Vector  # unit vector, FRD
    reported_less_azimuth_rad: float  # what the receiver has added to the baseline's azimuth

    @classmethod
    def from_config(cls, aircraft: AircraftConfig) -> Baseline:
        """Return the baseline of the two antennas; with one antenna, level along the nose.

        The reported heading is the azimuth of the baseline less its direction in a level body.
        Raises ConfigError where the two antennas give no heading.
        """
        baseline_b = aircraft.baseline_b
        if baseline_b is None:
            return cls((1.0, 0.0, 0.0), 0.0)
        x, y, z = (baseline_b / np.linalg.norm(baseline_b)).tolist()
        return cls((x, y, z), -azimuth((x, y)))
