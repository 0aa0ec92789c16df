"""Findings from joint angles beside those that the reported camera attitude makes."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.checks.finding import Finding, Severity
from tirgeo_ros.core.checks.joint_hypotheses import (
    NAMES,
    Reading,
    mean_differences,
    mistaken_reading,
)
from tirgeo_ros.core.samples import Array

#: A constant difference counts beyond this: yaw with the gimbal's north (3 deg) in it.
_OFF_RAD = np.radians((12.0, 3.0, 3.0))
_STEADY_RAD = math.radians(2.0)
_UNLIKE_RAD = math.radians(5.0)  # rms: nothing agrees
_TOPIC = "gimbal/joint_states"
_CHAIN = "send radians by these names: yaw about up, roll about forward, then pitch about left"


def joint_findings(joints: Array, reported: Array, *, used: bool) -> list[Finding]:
    """Return what angles (N, 3) yaw, roll, pitch show, rad; ``used``: they drive the poses."""
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


def _mistaken(reading: Reading, joints: Array, reported: Array, *, used: bool) -> Finding:
    before, after = (
        np.degrees(np.hypot(*mean_differences(angles, reported)))
        for angles in (joints, reading.angles(joints))
    )
    evidence = (
        f"{reading.words}: {_three(before)} deg beside the reported attitude (yaw, roll, pitch), "
        f"{_three(after)} deg when mended"
    )
    severity = Severity.STOP if used else Severity.NOTE
    return Finding("joint_angles", severity, evidence, _TOPIC, _CHAIN)


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
