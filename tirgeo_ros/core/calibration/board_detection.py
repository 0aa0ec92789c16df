# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Detect a checkerboard in a thermal picture: all its corners, or the reason for rejecting them.

Foil on a board gives a contrast of a few degrees, of either sign, and unevenly. The picture is
given to OpenCV's detector in several forms until it finds the board. The corners are then fitted
in the original picture, to a few hundredths of a pixel. In the model two straight edges cross,
each blurred by its own width, and the four quarters around have their own temperatures:

    I(p) = a + b s1 + c s2 + d s1 s2,    s_i = tanh(n_i . (p - corner) / w_i)

If the foil is warmer on one square than on the next, b and c absorb the difference, which would
move a saddle point, but not this corner. The residuals give the corner's covariance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.calibration.checkerboard import (
    BoardSighting,
    Checkerboard,
    RefusalReason,
    Refused,
    steps_of,
)
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels

#: Sigma of the Gaussian blur whose edge is as steep in the middle as tanh(x / w), divided by w.
_SIGMA_OF_WIDTH = math.sqrt(2 / math.pi)
#: Radius of the fitted pixels, relative to the shortest square side at the corner: the next edges
#: and their blur stay outside.
_REACH = 0.42
_LEAST_PX, _MOST_PX = 2.5, 10.0
_LEAST_WIDTH_PX = 0.25
_PARAMETERS = 10  # u, v, two angles, two logarithms of widths, four levels

# Limits beyond which a sighting is rejected.
_MOST_BLUR = 0.22  # of a square's side
_MOST_BLUR_PX = 3.0
_MOST_SMEAR_PX = 2.2  # extra blur in one direction: 8 px of motion
_LEAST_CONTRAST = 0.3  # of a corner, relative to the median of all
_MOST_SIGMA_PX = 0.25
_UNEVEN = 0.025  # largest deviation of a corner from the plane, in squares;
_SIGMAS = 4.0  # this many sigmas of a corner are added
_RING = 0.4  # contrast of a corner beyond the board, less a lone square's, relative to the median

# The search for a board.
_LEAST_SIDE_PX = 8.0  # of a square; in a smaller one the blurs of two edges overlap
_DETECTION = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
_STRETCH = 0.5, 99.5  # percentiles that become black and white
_LOCAL_SHARE = 0.08  # sigma of the local contrast's surroundings, relative to the width
_WIDEST_PX = 1300  # width of the detector's picture; its time grows faster than the pixels
_CALM_PX = 1.2  # blur that reduces noise, for the detector only


def find_board(picture: RawPixels, board: Checkerboard) -> BoardSighting | Refused:
    """Return the board in a picture (h, w) uint8 or uint16, or (h, w, 3) in blue, green, red."""
    grey = grey_of(picture)
    sharp = grey.astype(np.float32)
    refused = None
    for corners in _candidates(grey, board):
        result = _judged(sharp, _right_handed(corners, board), board)
        if isinstance(result, BoardSighting):
            return result
        refused = refused or result
    return refused or _not_detected(grey, board)


def grey_of(picture: RawPixels) -> RawPixels:
    """Return the picture with one channel."""
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)) if picture.ndim == 3 else picture


def _candidates(grey: RawPixels, board: Checkerboard) -> Iterator[Array]:
    """Yield corners (count, 2), px, that the detector finds in each form of the picture."""
    small, scale = _shrunk(grey)
    for form in (_stretched(small), _local(small)):
        for calm_px in (0.0, _CALM_PX):
            calm = np.asarray(cv2.GaussianBlur(form, (0, 0), calm_px)) if calm_px else form
            # The detector accepts light and dark squares either way round.
            detected, corners = cv2.findChessboardCornersSB(calm, board.size, flags=_DETECTION)
            if detected:
                yield (np.asarray(corners, float).reshape(-1, 2) + 0.5) * scale - 0.5


def _shrunk(grey: RawPixels) -> tuple[RawPixels, int]:
    """Return the picture reduced for the detector, and its scale: less time, and less noise."""
    scale = -(-grey.shape[1] // _WIDEST_PX)
    if scale == 1:
        return grey, 1
    size = grey.shape[1] // scale, grey.shape[0] // scale
    whole = grey[: size[1] * scale, : size[0] * scale]
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA)), scale


def _stretched(grey: RawPixels) -> Pixels:
    """Stretch a picture to 8 bits, between its darkest and lightest pixels."""
    low, high = np.percentile(grey, _STRETCH)
    scaled = (grey.astype(np.float32) - low) * (255 / max(high - low, 1.0))
    return np.asarray(np.clip(scaled, 0, 255), np.uint8)


def _local(grey: RawPixels) -> Pixels:
    """Return local contrast in 8 bits: without vignetting, warm corners and hot spots."""
    sharp = grey.astype(np.float32)
    sigma = _LOCAL_SHARE * grey.shape[1]
    off = sharp - np.asarray(cv2.GaussianBlur(sharp, (0, 0), sigma))
    spread = np.sqrt(np.asarray(cv2.GaussianBlur(off * off, (0, 0), sigma)))
    spread = np.maximum(spread, 0.25 * spread.mean() + 1e-6)
    return np.asarray(np.clip(128 + 60 * off / spread, 0, 255), np.uint8)


def _right_handed(corners: Array, board: Checkerboard) -> Array:
    """Return the corners, with rows reversed if the board would be seen from behind."""
    grid = corners.reshape(board.rows, board.columns, 2)
    a, b = (grid[:, -1] - grid[:, 0]).mean(0), (grid[-1] - grid[0]).mean(0)
    return corners if a[0] * b[1] - a[1] * b[0] > 0 else grid[::-1].reshape(-1, 2)


def _judged(
    sharp: npt.NDArray[np.float32], corners: Array, board: Checkerboard
) -> BoardSighting | Refused:
    """Return the sighting from the fitted corners, or the reason for rejecting it."""
    steps = steps_of(corners, board)
    side = float(np.linalg.norm(steps, axis=2).min())
    if side < _LEAST_SIDE_PX:
        return Refused(RefusalReason.SMALL, f"squares of {side:.1f} px; come nearer")
    fit = fit_corners(sharp, corners, steps)
    blur_px = np.median(fit.blur_px, 0)
    return _doubt(sharp, fit, side, board) or BoardSighting(fit.uv, fit.sigma_px, blur_px)


def _not_detected(grey: RawPixels, board: Checkerboard) -> Refused:
    """Return the refusal, with the part of a board that is visible."""
    flags = _DETECTION | cv2.CALIB_CB_LARGER
    form = _stretched(_shrunk(grey)[0])
    detected, _, meta = cv2.findChessboardCornersSBWithMeta(form, (3, 3), flags)
    if not detected:
        return Refused(RefusalReason.NO_BOARD, "none was detected")
    rows, columns = meta.shape[:2]
    detail = f"{columns}x{rows} corners were found, not {board.columns}x{board.rows}"
    more = max(rows, columns) > max(board.size) or min(rows, columns) > min(board.size)
    return Refused(RefusalReason.OTHER_BOARD if more else RefusalReason.PARTIAL, detail)


def _doubt(
    sharp: npt.NDArray[np.float32], fit: CornerFit, side_px: float, board: Checkerboard
) -> Refused | None:
    """Return why a picture's (h, w) corners are rejected, or None; ``side_px`` is the shortest."""
    fitted = np.isfinite(fit.contrast)
    blur = np.median(fit.blur_px[fitted], 0) if fitted.any() else np.zeros(2)
    most = min(_MOST_BLUR_PX, _MOST_BLUR * side_px)
    if blur.max() > most or abs(blur[0] ** 2 - blur[1] ** 2) > _MOST_SMEAR_PX**2:
        detail = f"edges blurred by {blur[0]:.1f} and {blur[1]:.1f} px; at most {most:.1f}, alike"
        return Refused(RefusalReason.BLURRED, detail)
    # Light and dark squares alternate.
    signed = fit.contrast * np.where(board.grid.sum(1) % 2 == 0, 1.0, -1.0)
    median = np.median(signed[fitted]) if fitted.any() else 0.0
    missing = int((~(signed * np.sign(median) > _LEAST_CONTRAST * abs(median))).sum())
    if missing:
        detail = f"{missing} of {board.count} corners are not between squares"
        return Refused(RefusalReason.COVERED, detail)
    sigma = fit.sigma_px
    if sigma > _MOST_SIGMA_PX:
        detail = f"corners known only to {sigma:.2f} px; more contrast is needed"
        return Refused(RefusalReason.FAINT, detail)
    off = _off_plane_px(fit.uv, board)
    if off > _UNEVEN * side_px + _SIGMAS * sigma:
        return Refused(
            RefusalReason.UNEVEN, f"a corner is off by {off:.1f} px; make the board flat"
        )
    if _is_continued(sharp, fit, board):
        detail = f"it has more corners than {board.columns}x{board.rows}"
        return Refused(RefusalReason.OTHER_BOARD, detail)
    return None


def _off_plane_px(uv: Array, board: Checkerboard) -> float:
    """Return the largest distance of a corner (count, 2) from a plane's image through a lens, px.

    That image is a homography plus a smooth bend: polynomials of third degree, of lower degree if
    a side has few corners.
    """
    homography, _ = cv2.findHomography(board.grid, uv)
    if homography is None:
        return math.inf
    off = uv - cv2.perspectiveTransform(board.grid[None], homography)[0]
    x, y = ((board.grid / (np.array(board.size) - 1)) * 2 - 1).T
    most = min(3, board.columns - 2), min(3, board.rows - 2)
    powers = [(i, j) for i in range(most[0] + 1) for j in range(most[1] + 1) if i + j <= max(most)]
    shapes = np.stack([x**i * y**j for i, j in powers], 1)
    off -= shapes @ np.linalg.lstsq(shapes, off, rcond=None)[0]
    return float(np.hypot(*off.T).max())


def _is_continued(sharp: npt.NDArray[np.float32], fit: CornerFit, board: Checkerboard) -> bool:
    """Return whether there are corners beyond the expected ones: the board has more squares."""
    grid = fit.uv.reshape(board.rows, board.columns, 2)
    steps = steps_of(fit.uv, board).reshape(board.rows, board.columns, 2, 2)
    for end, way in ((0, -1), (-1, 1)):
        for corners, step in (
            (grid[:, end] + way * steps[:, end, 0], steps[:, end]),
            (grid[end] + way * steps[end, :, 1], steps[end]),
        ):
            beyond = fit_corners(sharp, corners, step)
            # At a plain margin only one quarter differs, and all three contrasts are equal.
            lone = np.abs(beyond.steps).max(1)
            sure = np.nan_to_num(np.maximum(np.abs(beyond.contrast) - lone, 0.0))
            turning = sure * np.sign(np.nan_to_num(beyond.contrast))
            turning *= np.where(np.arange(len(sure)) % 2, -1, 1)
            if abs(np.median(turning)) > _RING * np.median(np.abs(fit.contrast)):
                return True
    return False


class CornerFit(NamedTuple):
    """Hold N fitted corners; nan where the fit failed."""

    uv: Array  # (N, 2) px
    covariance: Array  # (N, 2, 2) px^2, from the residuals
    contrast: Array  # (N,) grey values: d, half the step; its sign alternates over a board
    steps: Array  # (N, 2) grey values: b and c, half of each edge's own step
    blur_px: Array  # (N, 2) sigma of the blur across each edge

    @property
    def sigma_px(self) -> float:
        """Return the standard deviation of a coordinate of the median corner, px."""
        return float(np.sqrt(np.median(np.trace(self.covariance, axis1=1, axis2=2)) / 2))


def fit_corners(image: npt.NDArray[np.float32], uv: Array, steps_px: Array) -> CornerFit:
    """Refine corners (N, 2) of an image (h, w) with squares' sides ``steps_px`` (N, 2, 2).

    ``steps_px[:, 0]`` goes from a corner to the next along its row, ``[:, 1]`` along its column.
    """
    fits = [_fit_corner(image, *corner) for corner in zip(uv, steps_px, strict=True)]
    return CornerFit(*map(np.array, zip(*fits, strict=True)))


def _fit_corner(image: npt.NDArray[np.float32], uv: Array, steps_px: Array) -> tuple[Array, ...]:
    """Return the fields of CornerFit of one corner, by the Levenberg-Marquardt method."""
    from scipy.optimize import leastsq  # noqa: PLC0415  slow to import

    failed = tuple(np.full(shape, np.nan) for shape in (2, (2, 2), (), 2, 2))
    reach = np.clip(_REACH * np.linalg.norm(steps_px, axis=1).min(), _LEAST_PX, _MOST_PX)
    middle = np.rint(uv).astype(int)
    if (middle < reach).any() or (middle + reach > np.subtract(image.shape[::-1], 1)).any():
        return failed
    dv, du = np.mgrid[-int(reach) : int(reach) + 1, -int(reach) : int(reach) + 1]
    near = du**2 + dv**2 <= reach**2
    du, dv = du[near], dv[near]
    grey = image[middle[1] + dv, middle[0] + du].astype(float)

    def widths(p: Array) -> Array:
        return np.asarray(_LEAST_WIDTH_PX + np.exp(np.minimum(p[4:6], 9.0)))

    def shapes(p: Array) -> Array:
        x, y = du - p[0], dv - p[1]
        across = np.outer(np.cos(p[2:4]), y) - np.outer(np.sin(p[2:4]), x)
        first, second = np.tanh(across / widths(p)[:, None])
        return np.array([np.ones(len(x)), first, second, first * second])

    begin = np.array([*(uv - middle), *np.arctan2(steps_px[:, 1], steps_px[:, 0]), -0.3, -0.3])
    levels = np.linalg.lstsq(shapes(begin).T, grey, rcond=None)[0]
    p, inverse, details, *_ = leastsq(
        lambda p: p[6:] @ shapes(p) - grey, [*begin, *levels], full_output=True
    )
    if inverse is None or not np.hypot(*p[:2]) < reach:
        return failed
    variance = (details["fvec"] ** 2).sum() / max(len(grey) - _PARAMETERS, 1)
    blur_px = _SIGMA_OF_WIDTH * widths(p)
    return middle + p[:2], inverse[:2, :2] * variance, p[9], p[7:9], blur_px
