"""Find what the errors of located ground points have in common, and its likely cause.

Each cause moves every observation in the picture in its own way, to first order by
``pixel_moves``. The size of each is fitted by least squares to the offsets in pixels. A cause is
systematic if an F test says that its size is not chance (1 %), and if it explains half of the mean
square. Of several the one with the least BIC is named, and those within 6 of it: a smaller
difference is no strong evidence (Kass and Raftery, Bayes Factors, JASA 1995, section 3.2). The
errors within one picture share one pose, so the tests count pictures, two numbers each.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates, pixel_jacobian
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

#: Error that all observations share -> what its numbers are. ``boresight``: rad about the camera's
#: right, down and forward; ``latency``: s later than assumed; ``datum``: m east, north from the
#: surveyed to the located points; ``height``: m by which the assumed ground is too high.
CAUSES = ("boresight", "latency", "datum", "height")
#: With fewer pictures a common error cannot be recognised.
LEAST_PICTURES = 3
_CHANCE = 0.01
_LEAST_SHARE = 0.5
_STRONG_BIC = 6.0
#: px2; lower limit of a mean square, finer than a click, so that the logarithm is finite.
_LEAST_SQUARE_PX2 = 1e-6


class PixelMoves(NamedTuple):
    """Hold one observation's pixel offset, and the effect of each cause per unit of its size."""

    offset_px: Array  # (2,) observed less predicted, column and row
    by: Mapping[str, Array]  # (2, k) px per unit of the cause


class Systematic(NamedTuple):
    """Hold the error that all observations share."""

    causes: Sequence[str]  # the likeliest, then those about as likely
    size: Array  # of the likeliest


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
        "boresight": by_pose[:, 3:] @ rotation_nc,
        "datum": by_point[:, [1, 0]],
        "height": by_point[:, 2:],
    }
    if rates is not None:
        by["latency"] = -(by_pose @ np.concatenate(rates))[:, None]
    return PixelMoves(np.array(uv) - predicted[0], by)


def find_systematic(moves: Sequence[PixelMoves], pictures: int) -> Systematic | None:
    """Return what the observations of that many pictures share; None if it may be chance."""
    from scipy.special import fdtrc  # noqa: PLC0415  slow to import

    if pictures < LEAST_PICTURES or not moves:
        return None
    offsets = np.concatenate([one.offset_px for one in moves])
    numbers = 2 * pictures
    before = max(float(np.mean(offsets**2)), _LEAST_SQUARE_PX2)
    found = []
    for cause in CAUSES:
        if not all(cause in one.by for one in moves):
            continue
        design = np.concatenate([one.by[cause] for one in moves])
        size, _, rank, _ = np.linalg.lstsq(design, offsets, rcond=None)
        after = max(float(np.mean((offsets - design @ size) ** 2)), _LEAST_SQUARE_PX2)
        free = numbers - len(size)
        if rank < len(size) or after > (1 - _LEAST_SHARE) * before:
            continue
        if fdtrc(rank, free, (before - after) / rank / (after / free)) < _CHANCE:
            bic = numbers * math.log(after) + rank * math.log(numbers)
            found.append((bic, cause, size))
    if not found:
        return None
    found.sort(key=lambda one: one[0])
    causes = [cause for bic, cause, _ in found if bic - found[0][0] < _STRONG_BIC]
    return Systematic(causes, found[0][2])
