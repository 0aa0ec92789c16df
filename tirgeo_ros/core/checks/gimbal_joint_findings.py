"""Report faults of joint angles, compared with the angles of the reported camera attitude.

Both are yaw, roll, pitch of the same chain, so a mistake in axes, signs or units is a permutation,
signs and a factor. All of them are tried. The mean difference of yaw is ignored, because the
gimbal's north may be biased.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.core.gimbal.joint_geometry import joint_angles
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS

_NAMES = ("gimbal_yaw_joint", "gimbal_roll_joint", "gimbal_pitch_joint")
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
#: Largest constant difference without a finding; yaw includes the gimbal's north bias (3 deg).
_OFF_RAD = np.radians((12.0, 3.0, 3.0))
_STEADY_RAD = math.radians(2.0)
_UNLIKE_RAD = math.radians(5.0)  # rms; above it the two do not agree at all
_TOPIC = "gimbal/joint_states"
_CHAIN = "send radians by these names: yaw about up, roll about forward, then pitch about left"


class _Reading(NamedTuple):
    """Hold one reading of the three numbers: which is which angle, their signs, and the unit."""

    order: tuple[int, ...]
    signs: tuple[float, ...]
    degrees: bool

    @property
    def mistakes(self) -> int:
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
            parts.append(f"{_NAMES[moved[0]]} and {_NAMES[moved[1]]} are exchanged")
        elif moved:
            parts.append(
                "yaw, roll, pitch stand under " + ", ".join(_NAMES[i] for i in self.order)
            )
        turned = [
            _NAMES[one] for one, sign in zip(self.order, self.signs, strict=True) if sign < 0
        ]
        if turned:
            parts.append(f"{' and '.join(turned)} with the other sign")
        return ", ".join(parts)


_READINGS = sorted(
    itertools.starmap(
        _Reading,
        itertools.product(
            itertools.permutations(range(3)),
            itertools.product((1.0, -1.0), repeat=3),
            (False, True),
        ),
    ),
    key=lambda one: one.mistakes,
)


def joint_findings(joints: Array, rotations_bg: Array, order: str, *, used: bool) -> list[Finding]:
    """Return the faults of joint angles (N, 3) yaw, roll, pitch, rad.

    ``rotations_bg`` (N, 3, 3) come from the reported attitudes, ``order`` from the parameters.
    ``used`` is whether the joint angles give the camera's poses.
    """
    severity = Severity.STOP if used else Severity.NOTE
    reported = joint_angles(rotations_bg, order)
    other = _other_order(joints, reported, rotations_bg)
    if other:
        words = f"the joints are those of a gimbal {other}, not {order}"
        evidence = _evidence(words, joints, reported, joints, joint_angles(rotations_bg, other))
        mend = f"set it to {other}, or send the angles of a gimbal {order}"
        return [Finding("joint_order", severity, evidence, "gimbal_node joint_order", mend)]
    reading = _mistaken_reading(joints, reported)
    if reading is not None:
        evidence = _evidence(reading.words, joints, reported, reading.angles(joints), reported)
        return [Finding("joint_angles", severity, evidence, _TOPIC, _CHAIN)]
    mean, spread = _mean_differences(joints, reported)
    off = (spread < _STEADY_RAD) & (np.abs(mean) > _OFF_RAD)
    found = [_constant(axis, mean[axis], spread[axis]) for axis in np.flatnonzero(off).tolist()]
    if not found and (spread > _UNLIKE_RAD).any():
        sizes = _sizes(joints, reported)
        evidence = f"joints and reported attitude differ by {sizes} deg (yaw, roll, pitch)"
        mend = "see that both have stamps of their measurement, and angles by the contract"
        where = f"{_TOPIC}, gimbal/attitude"
        found = [Finding("joints_unlike", Severity.CAUTION, evidence, where, mend)]
    return found


def _constant(axis: int, mean_rad: float, spread_rad: float) -> Finding:
    evidence = (
        f"{_NAMES[axis]} is {math.degrees(mean_rad):+.1f} deg off the reported attitude all the "
        f"time (within {math.degrees(spread_rad):.1f})"
    )
    parameter = _TOPIC if axis else "gimbal_node yaw_zero_deg, north.bias_deg"
    mend = "mend the zero of the joint; it is no matter of the boresight"
    return Finding(f"joint_zero_{axis}", Severity.CAUTION, evidence, parameter, mend)


def _evidence(words: str, *angles: Array) -> str:
    before, after = _sizes(*angles[:2]), _sizes(*angles[2:])
    beside = f"{before} deg beside the reported attitude (yaw, roll, pitch)"
    return f"{words}: {beside}, {after} deg when mended"


def _sizes(joints: Array, reported: Array) -> str:
    sizes_deg = np.degrees(np.hypot(*_mean_differences(joints, reported)))
    return ", ".join(f"{angle:.1f}" for angle in sizes_deg.tolist())


def _mean_differences(joints: Array, reported: Array) -> tuple[Array, Array]:
    """Return (3,) mean and (3,) standard deviation of joints minus reported angles (N, 3), rad."""
    mean = np.angle(np.exp(1j * (joints - reported)).mean(axis=0))
    return mean, np.asarray(wrap_pi(joints - reported - mean).std(axis=0))


def _mistaken_reading(joints: Array, reported: Array) -> _Reading | None:
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


def _other_order(joints: Array, reported: Array, rotations_bg: Array) -> str | None:
    """Return the other order that explains angles (N, 3) by reported R_bg (N, 3, 3), or None.

    The angles of one attitude in two orders differ by amounts that change with the attitude. If
    the joints differ from the ``reported`` angles by these amounts, they are in the other order.
    """
    off = _about_mean_yaw(joints - reported)

    def left(order: str) -> float:
        between = _about_mean_yaw(joint_angles(rotations_bg, order) - reported)
        if (between**2).sum(axis=1).mean() < _LEAST_BETWEEN_RAD**2:
            return math.inf
        return float((_about_mean_yaw(off - between) ** 2).sum())

    least, best = min((left(order), order) for order in JOINT_ORDERS)
    return best if least < (1 - _EXPLAINED) * (off**2).sum() else None


def _about_mean_yaw(off: Array) -> Array:
    """Return differences (N, 3) wrapped to half a turn, yaw's relative to its mean."""
    off = wrap_pi(off)
    off[:, 0] = wrap_pi(off[:, 0] - np.angle(np.exp(1j * off[:, 0]).mean()))
    return np.asarray(off)


def _squares(angles: Array, reported: Array) -> Array:
    """Return (3,) mean squares of the differences, yaw's relative to its mean."""
    off = _about_mean_yaw(angles - reported)
    return np.asarray(np.minimum(off**2, _LARGEST_RAD2).mean(axis=0))
