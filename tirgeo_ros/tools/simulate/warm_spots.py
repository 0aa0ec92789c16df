"""Draw warm objects over the painted ground, at the size of the pixels.

A pixel shows a patch by the share of its ground that the patch covers. So a patch smaller than a
pixel is correspondingly faint, and its middle is where the camera projects it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.ground import GRASS, GREY_PER_K

Floats = npt.NDArray[np.float32]

_PARTS = 8  # of a pixel, in each direction
_COARSEST_M = 5.0  # pixels that cover more ground than this show no patch
_OFFSETS = (np.arange(_PARTS, dtype=np.float32) + 0.5) / _PARTS - 0.5


@dataclass(frozen=True, eq=False)
class Patch:
    """Hold a rectangle on the ground, or the ellipse within it, of one temperature."""

    center: Array  # (2,) m, north and east
    half_m: tuple[float, float]  # half its length along the heading, half its width
    heading_rad: float
    warmer_k: float  # contrast to the grass
    is_round: bool = False


def lay_on(picture: Floats, patches: Sequence[Patch], north: Floats, east: Floats) -> None:
    """Draw patches into a picture (h, w) of grey levels, later ones over earlier ones.

    ``north`` and ``east`` (h, w) are the ground position that each pixel's middle sees, m.
    """
    if not patches:
        return
    middle = slice(picture.shape[1] // 2, picture.shape[1] // 2 + 2)
    pixel_m = _pixel_m(north[:, middle], east[:, middle])
    for patch in patches:
        reach_m = pixel_m + float(np.hypot(*patch.half_m))
        near = np.abs(north - patch.center[0]) < reach_m
        near &= np.abs(east - patch.center[1]) < reach_m
        near &= pixel_m < _COARSEST_M
        if near.any():
            rows, columns = (_around(near.any(axis=axis)) for axis in (1, 0))
            seen = picture[rows, columns]
            share = _share(patch, north[rows, columns], east[rows, columns])
            seen += share * (GRASS + GREY_PER_K * patch.warmer_k - seen)


def _pixel_m(north: Floats, east: Floats) -> Floats:
    """Return the longest extent (h, 1), m, on the ground of a pixel of each row."""
    sides = [np.hypot(*(np.gradient(of, axis=axis) for of in (north, east))) for axis in (0, 1)]
    return np.asarray((sides[0] + sides[1])[:, :1])


def _around(marked: npt.NDArray[np.bool_]) -> slice:
    """Return the range of the marked items, with one more on either side."""
    found = np.flatnonzero(marked)
    return slice(max(int(found[0]) - 1, 0), int(found[-1]) + 2)


def _share(patch: Patch, north: Floats, east: Floats) -> Floats:
    """Return the share (h, w) of each pixel that the patch covers."""
    cos, sin = np.cos(patch.heading_rad), np.sin(patch.heading_rad)
    n, e = north - patch.center[0], east - patch.center[1]
    along = _in_parts((cos * n + sin * e) / patch.half_m[0])
    across = _in_parts((cos * e - sin * n) / patch.half_m[1])
    if patch.is_round:
        inside = along**2 + across**2 < 1
    else:
        inside = (np.abs(along) < 1) & (np.abs(across) < 1)
    return np.asarray(inside.mean(axis=(0, 1)), np.float32)


def _in_parts(values: Floats) -> Floats:
    """Return values (parts, parts, h, w) over each pixel, linear there."""
    by_row, by_column = np.gradient(values)
    rows, columns = np.meshgrid(_OFFSETS, _OFFSETS, indexing="ij")
    return np.asarray(
        values + rows[..., None, None] * by_row + columns[..., None, None] * by_column
    )
