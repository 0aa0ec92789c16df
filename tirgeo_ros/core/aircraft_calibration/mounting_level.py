"""Estimate the IMU's mounting angles against the autopilot's level from their mean difference.

The vertical by the filter in the IMU's axes and that by the autopilot in the body's differ by the
mounting's small turn ``phi``: ``d_body - d_imu = phi x d_imu``. An error of the autopilot's
heading does not enter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.aircraft_calibration.filter_run import FilterRun
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample

LEVEL = ("level_roll", "level_pitch")
LEVEL_LIMIT_RAD = math.radians(0.3)
LEVEL_ADVICE = (
    "three minutes with orientation in imu/data, legs in several directions and rests between"
)
_LEAST_PART = 20  # attitudes
_NEAR_NS = 30_000_000


class MountingLevel(NamedTuple):
    """Hold roll and pitch of the IMU's axes against the body's, FRD, rad."""

    angles_rad: Array  # (2,)
    sigma_rad: Array  # (2,)
    left_out_rad: Array  # (2,) rms change where a part of the flight is left out


def mounting_level(run: FilterRun, imu: Sequence[ImuSample], parts: int) -> MountingLevel | None:
    """Return roll and pitch of the mounting; None where there are too few autopilot attitudes.

    The flight is divided in ``parts`` to find the standard deviations.
    """
    stamps = np.array([sample.stamp_ns for sample in imu])
    at = np.searchsorted(stamps, run.attitude_ns).clip(0, len(imu) - 1)
    pairs = [
        (imu[k].autopilot_q_nb, q)
        for k, stamp_ns, q in zip(at, run.attitude_ns, run.attitude_q_nb, strict=True)
        if abs(int(stamps[k]) - stamp_ns) < _NEAR_NS and usable_attitude(imu[k].autopilot_q_nb)
    ]
    if len(pairs) < parts * _LEAST_PART:
        return None
    body_down = matrix_from_quat(np.array([a for a, _ in pairs]))[:, 2, :]
    imu_down = matrix_from_quat(np.array([b for _, b in pairs]))[:, 2, :]
    groups = np.array_split(np.arange(len(pairs)), parts)
    whole = _turn(body_down, imu_down)
    each = np.array([_turn(body_down[rows], imu_down[rows]) for rows in groups])
    others = np.array(
        [
            _turn(np.delete(body_down, rows, 0), np.delete(imu_down, rows, 0)) - whole
            for rows in groups
        ]
    )
    sigma = each.std(axis=0, ddof=1) / math.sqrt(parts)
    sigma = np.hypot(sigma, run.tilt_sigma_rad)
    return MountingLevel(whole, sigma, np.sqrt(np.mean(others**2, axis=0)))


def _turn(body_down: Array, imu_down: Array) -> Array:
    """Return the least-squares turn (2,) about the first two axes; directions are (N, 3)."""
    x, y, z = imu_down.T
    zero = np.zeros_like(x)
    # phi x d = (phi_y z, -phi_x z, phi_x y - phi_y x) for phi_z = 0
    by_roll = np.stack([zero, -z, y], axis=-1).ravel()
    by_pitch = np.stack([z, zero, -x], axis=-1).ravel()
    design = np.stack([by_roll, by_pitch], axis=-1)
    return np.asarray(np.linalg.lstsq(design, (body_down - imu_down).ravel(), rcond=None)[0])
