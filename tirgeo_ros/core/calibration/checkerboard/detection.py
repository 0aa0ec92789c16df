"""Detect a checkerboard in a thermal picture: all its corners, or the reason for rejecting them.

Foil on a board gives a contrast of a few degrees, of either sign, and unevenly. The picture is
given to OpenCV's detector in several forms until it finds the board. The corners are then fitted
in the original picture.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.calibration.checkerboard.board import (
    BoardSighting,
    Checkerboard,
    RefusalReason,
    Refused,
    steps_of,
)
from tirgeo_ros.core.calibration.checkerboard.corner_checks import doubt, sigma_px
from tirgeo_ros.core.calibration.checkerboard.corner_fit import fit_corners
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels

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
        found = _judged(sharp, _right_handed(corners, board), board)
        if isinstance(found, BoardSighting):
            return found
        refused = refused or found
    return refused or _not_found(grey, board)


def grey_of(picture: RawPixels) -> RawPixels:
    """Return the picture with one channel."""
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)) if picture.ndim == 3 else picture


def _candidates(grey: RawPixels, board: Checkerboard) -> Iterator[Array]:
    """Yield corners (count, 2), px, that the detector finds in each form of the picture."""
    small, scale = _shrunk(grey)
    for form in (stretched(small), _local(small)):
        for calm_px in (0.0, _CALM_PX):
            calm = cv2.GaussianBlur(form, (0, 0), calm_px) if calm_px else form
            # The detector accepts light and dark squares either way round.
            yes, corners = cv2.findChessboardCornersSB(
                np.asarray(calm, np.uint8), board.size, flags=_DETECTION
            )
            if yes:
                yield (np.asarray(corners, float).reshape(-1, 2) + 0.5) * scale - 0.5


def _shrunk(grey: RawPixels) -> tuple[RawPixels, int]:
    """Return the picture reduced for the detector, and its scale: less time, and less noise."""
    scale = -(-grey.shape[1] // _WIDEST_PX)
    if scale == 1:
        return grey, 1
    size = grey.shape[1] // scale, grey.shape[0] // scale
    whole = grey[: size[1] * scale, : size[0] * scale]
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA)), scale


def stretched(grey: RawPixels) -> Pixels:
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
    along, down = grid[:, -1] - grid[:, 0], grid[-1] - grid[0]
    a, b = along.mean(0), down.mean(0)
    right = a[0] * b[1] - a[1] * b[0] > 0
    return corners if right else grid[::-1].reshape(-1, 2)


def _judged(
    sharp: npt.NDArray[np.float32], corners: Array, board: Checkerboard
) -> BoardSighting | Refused:
    """Return the sighting that the fits give, or the reason for rejecting it."""
    steps = steps_of(corners, board)
    side = float(np.linalg.norm(steps, axis=2).min())
    if side < _LEAST_SIDE_PX:
        return Refused(RefusalReason.SMALL, f"squares of {side:.1f} px; come nearer")
    fit = fit_corners(sharp, corners, steps)
    blur_px = np.median(fit.blur_px, 0)
    return doubt(sharp, fit, side, board) or BoardSighting(fit.uv, sigma_px(fit), blur_px)


def _not_found(grey: RawPixels, board: Checkerboard) -> Refused:
    """Return the refusal, with the part of a board that is visible."""
    flags = _DETECTION | cv2.CALIB_CB_LARGER
    form = stretched(_shrunk(grey)[0])
    found = cv2.findChessboardCornersSBWithMeta(form, (3, 3), flags)
    if not found[0]:
        return Refused(RefusalReason.NO_BOARD, "none is seen")
    rows, columns = found[2].shape[:2]
    seen = f"{columns}x{rows} corners were found, not {board.columns}x{board.rows}"
    more = max(rows, columns) > max(board.size) or min(rows, columns) > min(board.size)
    return Refused(RefusalReason.OTHER_BOARD if more else RefusalReason.PARTIAL, seen)
