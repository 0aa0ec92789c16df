"""Report faults of joint angles, compared with the angles of the reported camera attitude."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.checks.joint_hypotheses import (
    NAMES,
    JointHypothesis,
    mean_differences,
    mistaken_reading,
    other_order,
)
from tirgeo_ros.core.gimbal.joint_geometry import joint_angles
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity

#: Largest constant difference without a finding; yaw includes the gimbal's north bias (3 deg).
_OFF_RAD = np.radians((12.0, 3.0, 3.0))
_STEADY_RAD = math.radians(2.0)
_UNLIKE_RAD = math.radians(5.0)  # rms; above it the two do not agree at all
_TOPIC = "gimbal/joint_states"
_CHAIN = "send radians by these names: yaw about up, roll about forward, then pitch about left"


def joint_findings(joints: Array, rotations_bg: Array, order: str, *, used: bool) -> list[Finding]:
    """Return the faults of joint angles (N, 3) yaw, roll, pitch, rad.

    ``rotations_bg`` (N, 3, 3) come from the reported attitudes, ``order`` from the parameters.
    ``used`` is whether the joint angles give the camera's poses.
    """
    reported = joint_angles(rotations_bg, order)
    other = other_order(joints, rotations_bg, order)
    if other:
        return [_in_other_order(other, joints, rotations_bg, order, used=used)]
    reading = mistaken_reading(joints, reported)
    if reading is not None:
        return [_mistaken(reading, joints, reported, used=used)]
    mean, spread = mean_differences(joints, reported)
    steady = spread < _STEADY_RAD
    found = [
        _constant(axis, float(mean[axis]), float(spread[axis]))
        for axis in np.flatnonzero(steady & (np.abs(mean) > _OFF_RAD)).tolist()
    ]
    if not found and (spread > _UNLIKE_RAD).any():
        found = [_unlike(mean, spread)]
    return found


def _mistaken(reading: JointHypothesis, joints: Array, reported: Array, *, used: bool) -> Finding:
    before, after = _sizes(joints, reported), _sizes(reading.angles(joints), reported)
    return Finding(
        "joint_angles", _severity(used), _evidence(reading.words, before, after), _TOPIC, _CHAIN
    )


def _in_other_order(
    other: str, joints: Array, rotations_bg: Array, order: str, *, used: bool
) -> Finding:
    before, after = (_sizes(joints, joint_angles(rotations_bg, one)) for one in (order, other))
    evidence = _evidence(f"the joints are those of a gimbal {other}, not {order}", before, after)
    mend = f"set it to {other}, or send the angles of a gimbal {order}"
    return Finding("joint_order", _severity(used), evidence, "gimbal_node joint_order", mend)


def _severity(used: bool) -> Severity:
    return Severity.STOP if used else Severity.NOTE


def _sizes(joints: Array, reported: Array) -> str:
    return _three(np.degrees(np.hypot(*mean_differences(joints, reported))))


def _evidence(words: str, before: str, after: str) -> str:
    return (
        f"{words}: {before} deg beside the reported attitude (yaw, roll, pitch), "
        f"{after} deg when mended"
    )


def _three(angles_deg: Array) -> str:
    return ", ".join(f"{angle:.1f}" for angle in angles_deg.tolist())


def _constant(axis: int, mean_rad: float, spread_rad: float) -> Finding:
    evidence = (
        f"{NAMES[axis]} is {math.degrees(mean_rad):+.1f} deg off the reported attitude all the "
        f"time (within {math.degrees(spread_rad):.1f})"
    )
    parameter = _TOPIC if axis else "gimbal_node yaw_zero_deg, north.bias_deg"
    mend = "mend the zero of the joint; it is no matter of the boresight"
    return Finding(f"joint_zero_{axis}", Severity.CAUTION, evidence, parameter, mend)


def _unlike(mean: Array, spread: Array) -> Finding:
    evidence = (
        f"joints and reported attitude differ by {_three(np.degrees(np.hypot(mean, spread)))} deg "
        "(yaw, roll, pitch)"
    )
    mend = "see that both have stamps of their measurement, and angles by the contract"
    parameter = f"{_TOPIC}, gimbal/attitude"
    return Finding("joints_unlike", Severity.CAUTION, evidence, parameter, mend)
