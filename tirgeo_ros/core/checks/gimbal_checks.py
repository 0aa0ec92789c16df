"""Check the gimbal's joint angles against the reported camera attitudes.

Both are yaw, roll, pitch of the same chain, so a mistake in axes, signs, unit or order of the
joints is one of few readings of the numbers. All of them are tried. The mean difference of yaw is
ignored there, because the gimbal's north may be biased.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    slerp,
)
from tirgeo_ros.core.gimbal.joint_geometry import joint_angles
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.streams.sanity_checks import joints_fault, usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample
from tirgeo_ros.core.types.poses import BodyPose

_EVERY_NS = 200_000_000  # interval between the compared instants
_HISTORY_S = 1.0
_STEP_NS = 18_000_000  # least interval between attitudes that are kept: about the joints' rate
_KEPT, _FEWEST = 300, 25  # instants: one minute, five seconds
_NAMES = ("gimbal_yaw_joint", "gimbal_roll_joint", "gimbal_pitch_joint")
#: Mean square difference without a mistake, from errors of the reported attitudes and of the
#: body's, and from the gimbal's wander: Table 8's 0.27 and 0.48 deg rms, 0.5 deg of the
#: body's tilt, and stamps that are 20 ms apart.
_FLOOR_RAD2 = math.radians(0.8) ** 2
_LARGEST_RAD2 = 0.25  # limit for one sample, so that a flight's start does not dominate
#: Another reading of the angles must leave less than this share of the squares.
_SHARE = 0.25
_LEAST_BETWEEN_RAD = math.radians(0.7)  # rms difference between two orders that can be told apart
_EXPLAINED = 0.7  # share of the squares that the right order explains
_ALIKE = 1.5  # readings within this factor of the least are equal: the simplest is chosen
#: Largest constant difference without a finding; yaw includes the gimbal's north bias (3 deg).
_OFF_RAD = np.radians((12.0, 3.0, 3.0))
_UNLIKE_RAD = math.radians(5.0)  # rms; above it the two do not agree at all
_TOPIC = "gimbal/joint_states"
_NEVER_CALIBRATED = Finding(
    "boresight_default",
    Severity.CAUTION,
    "the boresight was never calibrated: the ellipses do not include its error",
    "gimbal_node boresight_rpy_deg",
    "run tirgeo calibrate boresight, or set it to zeros if the camera is known to be aligned",
)


class GimbalChecks:
    """Take samples in order of arrival; return findings at any time.

    ``given`` are the parameters of gimbal_node that were set explicitly, None if not known.
    """

    def __init__(self, config: GimbalConfig, given: Collection[str] | None = None) -> None:
        untouched = given is not None and "boresight_rpy_deg" not in given
        self._askew = untouched and not np.any(config.boresight_rpy_deg)
        self._severity = Severity.NOTE if config.composition == "paper" else Severity.STOP
        self._yaw_zero_rad, self._order = config.yaw_zero_rad, config.joint_order
        self._joints: StampedBuffer[Array] = StampedBuffer(_HISTORY_S)
        self._autopilot: StampedBuffer[Array] = StampedBuffer(_HISTORY_S)
        self._bodies: StampedBuffer[Array] = StampedBuffer(_HISTORY_S)
        self._waiting: CameraAttitudeSample | None = None  # until later data have come
        self._pairs: deque[tuple[Array, Array]] = deque(maxlen=_KEPT)  # joints, reported q_bg

    def configure(self, config: GimbalConfig) -> None:
        """Take other parameters; forget what was compared with another yaw zero."""
        self._askew = self._askew and not np.any(config.boresight_rpy_deg)
        if config.yaw_zero_rad != self._yaw_zero_rad:
            self._yaw_zero_rad = config.yaw_zero_rad
            self._joints.clear()
            self._pairs.clear()

    def joints(self, sample: JointSample) -> None:
        """Take joint angles; computed ones, which no encoder measured, are ignored."""
        angles = (sample.yaw_rad, sample.roll_rad, sample.pitch_rad)
        if not (sample.computed or joints_fault(angles)):
            zero = (self._yaw_zero_rad, 0.0, 0.0)
            self._joints.put(sample.stamp_ns, np.subtract(angles, zero))

    def autopilot(self, stamp_ns: int, q_nb: Array) -> None:
        """Take the autopilot's attitude (4,), whose errors the reported attitudes share."""
        _put(self._autopilot, stamp_ns, q_nb)

    def body(self, pose: BodyPose) -> None:
        """Take a body pose, which is used where the autopilot's attitude is missing."""
        _put(self._bodies, pose.stamp_ns, pose.q_nb)

    def reported(self, sample: CameraAttitudeSample) -> None:
        """Take the camera attitude that the flight controller reports."""
        before = self._waiting
        if before is not None and 0 <= sample.stamp_ns - before.stamp_ns < _EVERY_NS:
            return
        self._waiting = sample if usable_attitude(sample.q_ng) else None
        if before is None:
            return
        joints = self._joints.around(before.stamp_ns)
        body = self._autopilot.around(before.stamp_ns)
        if isinstance(body, Miss):
            body = self._bodies.around(before.stamp_ns)
        if not isinstance(joints, Miss) and not isinstance(body, Miss):
            start, end, share = joints
            q_bg = quat_multiply(quat_conjugate(slerp(*body)), before.q_ng)
            self._pairs.append((start if share < 0.5 else end, q_bg))

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        found = []
        if len(self._pairs) >= _FEWEST:
            joints, reported = map(np.array, zip(*self._pairs, strict=True))
            found = self._compared(joints, matrix_from_quat(reported))
        has_gimbal = self._waiting is not None or self._joints.newest_ns is not None
        return [*found, _NEVER_CALIBRATED] if self._askew and has_gimbal else found

    def _compared(self, joints: Array, rotations_bg: Array) -> list[Finding]:
        """Compare angles (N, 3) yaw, roll, pitch, rad, with reported ``R_bg`` (N, 3, 3)."""
        reported = joint_angles(rotations_bg, self._order)
        other = _other_order(joints, reported, rotations_bg)
        if other:
            words = f"the joints are those of a gimbal {other}, not {self._order}"
            evidence = _evidence(
                words, joints, reported, joints, joint_angles(rotations_bg, other)
            )
            where = "gimbal_node joint_order"
            mend = f"set it to {other}, or send the angles of a gimbal {self._order}"
            return [Finding("joint_order", self._severity, evidence, where, mend)]
        limit = _SHARE * _cost(joints, reported)
        possible = _READINGS if limit > 3 * _FLOOR_RAD2 else ()  # no reading costs less
        costs = [(_cost(one.angles(joints), reported), one) for one in possible]
        least = min((cost for cost, _ in costs), default=math.inf)
        if least < limit:
            best = next(one for cost, one in costs if cost <= _ALIKE * least)
            evidence = _evidence(best.words, joints, reported, best.angles(joints), reported)
            mend = (
                "send radians by these names: yaw about up, roll about forward, then pitch about "
                "left"
            )
            return [Finding("joint_angles", self._severity, evidence, _TOPIC, mend)]
        mean, spread = _differences(joints, reported)
        if not ((np.abs(mean) > _OFF_RAD) | (spread > _UNLIKE_RAD)).any():
            return []
        off, within = (
            ", ".join(f"{angle:+.1f}" for angle in np.degrees(each).tolist())
            for each in (mean, spread)
        )
        evidence = (
            f"the joints are ({off}) deg off the reported attitude (yaw, roll, pitch), with a "
            f"standard deviation of ({within})"
        )
        where = f"{_TOPIC}, gimbal_node yaw_zero_deg, north.bias_deg"
        mend = "correct the joints' zeros, or their stamps; the boresight is not the cause"
        return [Finding("joints_unlike", Severity.CAUTION, evidence, where, mend)]


def _put(attitudes: StampedBuffer[Array], stamp_ns: int, q_nb: Array) -> None:
    """Keep a usable attitude (4,) if the one before is a step older."""
    newest_ns = attitudes.newest_ns
    is_due = newest_ns is None or not 0 <= stamp_ns - newest_ns < _STEP_NS
    if is_due and usable_attitude(q_nb):
        attitudes.put(stamp_ns, q_nb)


class _Reading(NamedTuple):
    """Hold one reading of the three numbers: which is which angle, signs, and the unit."""

    axes: tuple[int, ...]
    signs: tuple[float, ...]
    degrees: bool

    @property
    def mistakes(self) -> int:
        """Return how many of axes, signs and unit are wrong."""
        moved = sum(one != axis for axis, one in enumerate(self.axes))
        return moved + self.signs.count(-1.0) + self.degrees

    def angles(self, joints: Array) -> Array:
        """Return (N, 3) yaw, roll, pitch, rad, of the numbers (N, 3) as received."""
        unit = math.pi / 180 if self.degrees else 1.0
        return np.asarray(joints[:, self.axes] * np.array(self.signs) * unit)

    @property
    def words(self) -> str:
        """Return a description for the operator."""
        signs = ("-" if sign < 0 else "" for sign in self.signs)
        read = ", ".join(sign + _NAMES[one] for sign, one in zip(signs, self.axes, strict=True))
        return f"yaw, roll, pitch are {read}{', in degrees' if self.degrees else ''}"


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


def _other_order(joints: Array, reported: Array, rotations_bg: Array) -> str | None:
    """Return the other order that explains angles (N, 3) by reported R_bg (N, 3, 3), or None.

    The angles of one attitude in two orders differ by amounts that change with the attitude. If
    the joints differ from the ``reported`` angles by these amounts, they are in the other order.
    """
    off = _about_mean_yaw(joints - reported)
    lefts: dict[str, float] = {}
    for order in JOINT_ORDERS:
        between = _about_mean_yaw(joint_angles(rotations_bg, order) - reported)
        if (between**2).sum(axis=1).mean() > _LEAST_BETWEEN_RAD**2:
            lefts[order] = float((_about_mean_yaw(off - between) ** 2).sum())
    best = min(lefts, key=lambda order: lefts[order], default=None)
    is_explained = best and lefts[best] < (1 - _EXPLAINED) * (off**2).sum()
    return best if is_explained else None


def _about_mean_yaw(off: Array) -> Array:
    """Return differences (N, 3) wrapped to half a turn, yaw's relative to its mean."""
    off = wrap_pi(off)
    off[:, 0] = wrap_pi(off[:, 0] - np.angle(np.exp(1j * off[:, 0]).mean()))
    return np.asarray(off)


def _cost(angles: Array, reported: Array) -> float:
    """Return the sum of the axes' mean square differences, yaw's relative to its mean."""
    off = _about_mean_yaw(angles - reported)
    squares = np.minimum(off**2, _LARGEST_RAD2).mean(axis=0)
    return float(np.maximum(squares, _FLOOR_RAD2).sum())


def _differences(joints: Array, reported: Array) -> tuple[Array, Array]:
    """Return (3,) mean and (3,) standard deviation of joints minus reported angles (N, 3), rad."""
    mean = np.angle(np.exp(1j * (joints - reported)).mean(axis=0))
    return mean, np.asarray(wrap_pi(joints - reported - mean).std(axis=0))


def _evidence(words: str, *angles: Array) -> str:
    before, after = _sizes(*angles[:2]), _sizes(*angles[2:])
    beside = f"{before} deg beside the reported attitude (yaw, roll, pitch)"
    return f"{words}: {beside}, {after} deg when mended"


def _sizes(joints: Array, reported: Array) -> str:
    sizes_deg = np.degrees(np.hypot(*_differences(joints, reported)))
    return ", ".join(f"{angle:.1f}" for angle in sizes_deg.tolist())
