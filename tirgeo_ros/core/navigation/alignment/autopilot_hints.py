"""Read the autopilot's attitudes over a window: its attitude at the end, the gyroscopes' bias."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_matrix, rotvec_from_quat
from tirgeo_ros.core.navigation.alignment.consistency_checks import central
from tirgeo_ros.core.navigation.alignment.imu_preintegration import PreintegratedImu
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample

_PICKED = 9
_AUTOPILOT_APART_RAD = np.radians(5.0)


def usable_samples(imu: Sequence[ImuSample], first_ns: int, last_ns: int) -> list[ImuSample]:
    """Return some samples of a window with an attitude, evenly spaced."""
    usable = [
        s for s in imu if first_ns <= s.stamp_ns <= last_ns and usable_attitude(s.autopilot_q_nb)
    ]
    last = len(usable) - 1
    return [usable[k] for k in np.unique(np.linspace(0, last, _PICKED, dtype=int)) if usable]


def rotations_of(samples: Sequence[ImuSample]) -> Array:
    """Return the autopilot's attitudes (n, 3, 3)."""
    return matrix_from_quat(np.array([s.autopilot_q_nb for s in samples], float).reshape(-1, 4))


def autopilot_gyro_bias(window: PreintegratedImu, imu: Sequence[ImuSample]) -> Array | None:
    """Return the gyroscope bias (3,), rad/s, by the autopilot's attitudes; None if they are few.

    Carried to the window's end, each attitude is turned by the bias times the time to the end.
    """
    picked = usable_samples(imu, *window.stamps_ns[[0, -1]].tolist())
    if len(picked) < _PICKED:
        return None
    at = window.at([s.stamp_ns for s in picked])
    at_end = rotations_of(picked) @ window.to_end[at].swapaxes(1, 2)
    turned = np.array([rotvec_from_quat(quat_from_matrix(at_end[-1].T @ r)) for r in at_end])
    before_s = window.before_s[at] - window.before_s[at].mean()
    return np.asarray(before_s @ turned / (before_s @ before_s) + window.taken[:3])


def autopilot_attitude(window: PreintegratedImu, imu: Sequence[ImuSample]) -> Array | None:
    """Return the autopilot's attitude (3, 3) at the window's end, if most of its attitudes agree.

    The gyroscopes carry some attitudes of the window to its end. More than half of them must be
    within 5 deg of the central one, so that they follow the body's turn.
    """
    picked = usable_samples(imu, *window.stamps_ns[[0, -1]].tolist())
    if not picked:
        return None
    to_end = window.to_end[window.at([s.stamp_ns for s in picked])]
    at_end = rotations_of(picked) @ to_end.swapaxes(1, 2)
    cosines = 0.5 * (np.einsum("aij,bij->ab", at_end, at_end) - 1)
    middle, near = central(np.arccos(np.clip(cosines, -1, 1)), _AUTOPILOT_APART_RAD)
    return np.asarray(at_end[middle]) if near.sum() * 2 > len(picked) else None
