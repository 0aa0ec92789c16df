"""Find the mistake that explains joint angles, given those of the reported camera attitude.

Both are yaw, roll, pitch of the same chain, so a mistake in axes, signs or units is a permutation,
signs and a factor. All of them are tried. The mean difference of yaw is ignored, because the
gimbal's north may be biased.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.core.gimbal.joint_geometry import joint_angles
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS

NAMES = ("gimbal_yaw_joint", "gimbal_roll_joint", "gimbal_pitch_joint")
#: Mean square difference without a mistake, from errors of the reported attitudes and of the
#: autopilot, and from the gimbal's wander: Table 8's 0.27 and 0.48 deg rms, 0.5 deg of the
#: autopilot's tilt, and stamps that are 20 ms apart.
_FLOOR_RAD2 = math.radians(0.8) ** 2
_LARGEST_RAD2 = 0.25  # limit for one sample, so that a flight's start does not dominate
#: The angles are wrong if one axis differs by more than this rms, and another reading of them
#: leaves less than _SHARE of the squares.
_LEAST_RAD = math.radians(1.5)
_SHARE = 0.25
_LEAST_BETWEEN_RAD = math.radians(0.7)  # rms difference between two orders that can be told apart
_EXPLAINED = 0.7  # share of the squares that the right order explains
_ALIKE = 1.5  # readings within this factor of the least are equal: the simplest is chosen


@dataclass(frozen=True)
class JointHypothesis:
    """Hold one reading of the three numbers: which is which angle, their signs, and the unit."""

    order: tuple[int, ...] = (0, 1, 2)
    signs: tuple[float, ...] = (1.0, 1.0, 1.0)
    degrees: bool = False

    @property
    def mistakes(self) -> int:
        """Return the number of mistakes that it assumes."""
        moved = sum(one != axis for axis, one in enumerate(self.order))
        return moved + self.signs.count(-1.0) + self.degrees

    def angles(self, joints: Array) -> Array:
        """Return (N, 3) yaw, roll, pitch, rad, of the numbers (N, 3) as received."""
        unit = math.pi / 180 if self.degrees else 1.0
        return np.asarray(joints[:, self.order] * np.array(self.signs) * unit)

    @property
    def words(self) -> str:
        """Return a description of the mistakes for the operator."""
        parts = ["the joint angles are in degrees, not in radians"] if self.degrees else []
        moved = [axis for axis, one in enumerate(self.order) if one != axis]
        if len(moved) == 2:
            parts.append(f"{NAMES[moved[0]]} and {NAMES[moved[1]]} are exchanged")
        elif moved:
            parts.append("yaw, roll, pitch stand under " + ", ".join(NAMES[i] for i in self.order))
        turned = [NAMES[one] for one, sign in zip(self.order, self.signs, strict=True) if sign < 0]
        if turned:
            parts.append(f"{' and '.join(turned)} with the other sign")
        return ", ".join(parts)


_READINGS = sorted(
    (
        JointHypothesis(order, signs, degrees)
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
        for degrees in (False, True)
    ),
    key=lambda one: one.mistakes,
)


def mean_differences(joints: Array, reported: Array) -> tuple[Array, Array]:
    """Return (3,) mean and (3,) standard deviation of joints minus reported angles (N, 3), rad."""
    off = np.exp(1j * (joints - reported))
    mean = np.angle(off.mean(axis=0))
    return mean, np.asarray(wrap_pi(joints - reported - mean).std(axis=0))


def mistaken_reading(joints: Array, reported: Array) -> JointHypothesis | None:
    """Return the reading that explains joints (N, 3) by reported angles (N, 3), or None."""
    if math.sqrt(_squares(joints, reported).max()) < _LEAST_RAD:
        return None
    parts = [_squares(reading.angles(joints), reported) for reading in _READINGS]
    costs = [float(np.maximum(part, _FLOOR_RAD2).sum()) for part in parts]
    least = min(costs)
    if least > _SHARE * costs[0]:
        return None
    alike = zip(_READINGS, costs, strict=True)
    return next(reading for reading, cost in alike if cost <= _ALIKE * least)


def other_order(joints: Array, rotations_bg: Array, order: str) -> str | None:
    """Return the other order that explains angles (N, 3) by reported R_bg (N, 3, 3), or None.

    The angles of one attitude in two orders differ by amounts that change with the attitude. If
    the joints differ from those of ``order`` by these amounts, they are in the other order.
    """
    reported = joint_angles(rotations_bg, order)
    off = _about_mean_yaw(joints - reported)
    left = {one: _left(off, joint_angles(rotations_bg, one) - reported) for one in JOINT_ORDERS}
    best = min(left, key=left.__getitem__)
    return best if left[best] < (1 - _EXPLAINED) * (off**2).sum() else None


def _left(off: Array, between: Array) -> float:
    """Return the sum of squares of differences (N, 3) minus those between two orders (N, 3)."""
    between = _about_mean_yaw(between)
    if (between**2).sum(axis=1).mean() < _LEAST_BETWEEN_RAD**2:
        return math.inf
    return float((_about_mean_yaw(off - between) ** 2).sum())


def _about_mean_yaw(off: Array) -> Array:
    """Return differences (N, 3) wrapped to half a turn, yaw's relative to its mean."""
    off = wrap_pi(off)
    off[:, 0] = wrap_pi(off[:, 0] - np.angle(np.exp(1j * off[:, 0]).mean()))
    return np.asarray(off)


def _squares(angles: Array, reported: Array) -> Array:
    """Return (3,) mean squares of the differences, yaw's relative to its mean."""
    off = _about_mean_yaw(angles - reported)
    return np.asarray(np.minimum(off**2, _LARGEST_RAD2).mean(axis=0))
