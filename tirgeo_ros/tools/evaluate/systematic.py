"""Find what the errors of located ground points have in common, and its likely cause.

Each cause moves every observation in the picture in its own way, to first order by
``pixel_moves``: a boresight error is one small rotation of the camera, a latency a shift along the
camera's motion, a datum error one step to east and north, a height error one step of the ground
under the camera. The size of each is fitted by least squares to the offsets in pixels.
A cause is systematic if an F test says that its size over its standard error is not chance (1 %),
and if it explains half of the mean square. Of several causes the one with the least BIC is named,
and those within 6 of it: a smaller difference is no strong evidence (Kass and Raftery, Bayes
Factors, JASA 1995, section 3.2). The errors within one picture share one pose, so the test counts
pictures, two numbers each, and not observations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates, pixel_jacobian
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

#: With fewer pictures a common error cannot be recognised.
LEAST_PICTURES = 3
_CHANCE = 0.01
_LEAST_SHARE = 0.5
_STRONG_BIC = 6.0
#: px2; lower limit of a mean square, finer than a click, so that the logarithm is finite.
_LEAST_SQUARE_PX2 = 1e-6


class Cause(Enum):
    """List the causes of an error that all observations share."""

    BORESIGHT = "boresight"  # fixed in the picture
    LATENCY = "latency"  # along the camera's motion
    DATUM = "datum"  # fixed on the ground
    HEIGHT = "height"  # away from the point under the camera


class PixelMoves(NamedTuple):
    """Hold one observation's pixel offset, and the effect of each cause per unit of its size."""

    offset_px: Array  # (2,) observed less predicted, column and row
    by: Mapping[Cause, Array]  # (2, k) px per rad, s, m east and north, m up


@dataclass(frozen=True)
class Systematic:
    """Hold the error that all observations share."""

    #: rad about the camera's right, down and forward; s later than assumed; m east, north from the
    #: surveyed to the located points; m by which the assumed ground is too high under the camera.
    size: Array
    # The likeliest, to which ``size`` belongs, then those about as likely.
    causes: tuple[Cause, ...]
    share: float  # of the mean square offset, 0 to 1
    mean_px: Array  # (2,) mean offset, column and row


def pixel_moves(
    camera: Camera,
    pose: CameraPose,
    rates: CameraRates | None,
    uv: tuple[float, float],
    surveyed_n: Array,
) -> PixelMoves | None:
    """Return one observation's moves; None if the camera cannot see the surveyed point.

    ``surveyed_n`` (3,) is the surveyed point at the height of the assumed ground, NED in the
    pose's plane. Without ``rates`` latency is not considered.
    """
    rotation_nc = matrix_from_quat(pose.q_nc)
    predicted, _ = camera.project((surveyed_n - pose.position_n)[None] @ rotation_nc)
    by_pose, by_point = (both[0] for both in pixel_jacobian(camera, pose, surveyed_n))
    if not (np.isfinite(predicted).all() and np.isfinite(by_pose).all()):
        return None
    by = {
        Cause.BORESIGHT: by_pose[:, 3:] @ rotation_nc,
        Cause.DATUM: by_point[:, [1, 0]],
        Cause.HEIGHT: by_point[:, 2:],
    }
    if rates is not None:
        by[Cause.LATENCY] = -(by_pose @ np.concatenate(rates))[:, None]
    return PixelMoves(np.array(uv) - predicted[0], by)


def find_systematic(moves: Sequence[PixelMoves], pictures: int) -> Systematic | None:
    """Return what the observations of that many pictures share; None if it may be chance."""
    if pictures < LEAST_PICTURES:
        return None
    offsets = np.concatenate([one.offset_px for one in moves])
    numbers = 2 * pictures
    before = max(_mean_square(offsets), _LEAST_SQUARE_PX2)
    found = []
    for cause in Cause:
        if not all(cause in one.by for one in moves):
            continue
        design = np.concatenate([one.by[cause] for one in moves])
        size, _, rank, _ = np.linalg.lstsq(design, offsets, rcond=None)
        after = max(_mean_square(offsets - design @ size), _LEAST_SQUARE_PX2)
        if rank == len(size) and _is_systematic(before, after, len(size), numbers):
            found.append(
                (numbers * math.log(after) + rank * math.log(numbers), cause, size, after)
            )
    if not found:
        return None
    bic, first, size, after = min(found, key=lambda one: one[0])
    others = (cause for b, cause, *_ in found if cause is not first and b - bic < _STRONG_BIC)
    mean_px = offsets.reshape(-1, 2).mean(axis=0)
    return Systematic(size, (first, *others), 1 - after / before, mean_px)


def _is_systematic(before: float, after: float, unknowns: int, numbers: int) -> bool:
    """Return whether mean squares (px2) without and with a cause differ by more than chance."""
    from scipy.special import fdtrc  # noqa: PLC0415  slow to import

    free = numbers - unknowns
    if free < 1 or 1 - after / before < _LEAST_SHARE:
        return False
    ratio = (before - after) / unknowns / (after / free)
    return bool(fdtrc(unknowns, free, ratio) < _CHANCE)


def _mean_square(values: Array) -> float:
    return float(np.mean(np.square(values)))
