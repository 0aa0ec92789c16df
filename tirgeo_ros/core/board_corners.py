"""A checkerboard in a thermal picture: all its corners, or the reason why they are not to be used.

Foil on a board gives a few degrees of contrast, of either sign, unevenly. The picture is given to
OpenCV's detector in several forms until one shows the board; the corners are then fitted in the
picture itself, and every doubt about them refuses the view: a calibration is spoilt by one wrong
view and hardly better for one more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.checkerboard import Checkerboard
from tirgeo_ros.core.corner_fit import CornerFit, fit_corners
from tirgeo_ros.core.samples import Array

Picture = npt.NDArray[Any]  # uint8 or uint16
Grey = npt.NDArray[np.uint8]


class Reason(Enum):
    """Why a view is not used; the value is its name in reports."""

    NO_BOARD = "no board"
    PARTIAL = "board not whole"
    OTHER_BOARD = "another board"
    COVERED = "corners covered"
    BLURRED = "blurred"
    SMEARED = "moved while exposed"
    FAINT = "too faint"
    UNCLEAN = "squares not clean"
    SMALL = "too small"
    OBLIQUE = "too oblique"
    UNEVEN = "corners not on a plane"
    DUPLICATE = "as another view"
    OUTLIER = "does not fit the others"
    OTHER_SIZE = "another picture size"
    UNREADABLE = "not readable"


@dataclass(frozen=True)
class Refused:
    """A view that is not used."""

    reason: Reason
    detail: str  # numbers, and what to do


@dataclass(frozen=True)
class Sighting:
    """A board's corners in a picture, in the order of ``Checkerboard.grid``.

    The order begins at one of the grid's ends and is right-handed: the board's z points away from
    the camera. ``dark_first`` tells whether the square outside corner 0, diagonally, is dark.
    """

    corners_px: Array  # (count, 2)
    sigma_px: float  # standard deviation of a coordinate, as the fits tell
    blur_px: Array  # (2,) standard deviation across the rows' edges and the columns'
    side_px: float  # shortest side of a square
    contrast: float  # grey values between dark and light squares
    dark_first: bool


_DETECTION = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
_STRETCH = 0.5, 99.5  # percent of the pixels that become black and white
_LOCAL_SHARE = 0.08  # of the picture's width: what a local contrast is taken over
_WIDEST_PX = 1300
_CALM_PX = 1.2  # blur that quietens noise for the detector alone
_LEAST_SIDE_PX = 8.0  # of a square: below it the blurs of two edges meet
_MOST_BLUR = 0.22  # of a square's side
_MOST_BLUR_PX = 3.0
_MOST_SMEAR_PX = 2.2  # blur that one direction has more than the other: 8 px of motion
_LEAST_CONTRAST = 0.3  # of a corner, of the median of all
_MOST_SIGMA_PX = 0.25
_MOST_STRUCTURE = 0.2  # what is left that is no noise, of the contrast
_LEAST_COSINE = 0.34  # of the angle between the view and the board's normal: 70 deg
_UNEVEN = 0.025  # of a square's side, and so many sigmas more:
_SIGMAS = 4.0
_RING = 0.4  # of the median contrast, that a corner beyond the board has more than a lone square


def find_board(picture: Picture, board: Checkerboard) -> Sighting | Refused:
    """The board in a picture (h, w) uint8 or uint16, or (h, w, 3) in blue, green, red."""
    grey = grey_of(picture)
    sharp = grey.astype(np.float32)
    refused = None
    for corners in _candidates(grey, board):
        found = _judged(sharp, _right_handed(corners, board), board)
        if isinstance(found, Sighting):
            return found
        refused = refused or found
    return refused or _not_found(grey, board)


def grey_of(picture: Picture) -> Picture:
    """The picture with one channel."""
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)) if picture.ndim == 3 else picture


def _candidates(grey: Picture, board: Checkerboard) -> Iterator[Array]:
    """Corners (count, 2) px as a detector gives them, form by form of the picture."""
    small, scale = _shrunk(grey)
    for form in (stretched(small), _local(small)):
        for calm_px in (0.0, _CALM_PX):
            calm = cv2.GaussianBlur(form, (0, 0), calm_px) if calm_px else form
            for corners in _detected(np.asarray(calm, np.uint8), board):
                yield (corners + 0.5) * scale - 0.5


def _shrunk(grey: Picture) -> tuple[Picture, int]:
    """The picture as the detector gets it, and by how much it is smaller: time, and noise."""
    scale = -(-grey.shape[1] // _WIDEST_PX)
    if scale == 1:
        return grey, 1
    size = grey.shape[1] // scale, grey.shape[0] // scale
    whole = grey[: size[1] * scale, : size[0] * scale]
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA)), scale


def _detected(form: Grey, board: Checkerboard) -> Iterator[Array]:
    """None or one; the detector takes light and dark squares either way round."""
    yes, corners = cv2.findChessboardCornersSB(form, board.size, flags=_DETECTION)
    if yes:
        yield np.asarray(corners, float).reshape(-1, 2)


def stretched(grey: Picture) -> Grey:
    """8 bits between the darkest and the lightest of a picture's pixels."""
    low, high = np.percentile(grey, _STRETCH)
    scaled = (grey.astype(np.float32) - low) * (255 / max(high - low, 1.0))
    return np.asarray(np.clip(scaled, 0, 255), np.uint8)


def _local(grey: Picture) -> Grey:
    """8 bits of the local contrast: without vignette, warm corners and hot spots."""
    sharp = grey.astype(np.float32)
    sigma = _LOCAL_SHARE * grey.shape[1]
    off = sharp - np.asarray(cv2.GaussianBlur(sharp, (0, 0), sigma))
    spread = np.sqrt(np.asarray(cv2.GaussianBlur(off * off, (0, 0), sigma)))
    spread = np.maximum(spread, 0.25 * spread.mean() + 1e-6)
    return np.asarray(np.clip(128 + 60 * off / spread, 0, 255), np.uint8)


def _right_handed(corners: Array, board: Checkerboard) -> Array:
    """The corners with rows turned about where the board would be seen from behind."""
    grid = corners.reshape(board.rows, board.columns, 2)
    along, down = grid[:, -1] - grid[:, 0], grid[-1] - grid[0]
    a, b = along.mean(0), down.mean(0)
    right = a[0] * b[1] - a[1] * b[0] > 0
    return corners if right else grid[::-1].reshape(-1, 2)


def steps_of(corners: Array, board: Checkerboard) -> Array:
    """(count, 2, 2) px from each corner to the next along its row and along its column."""
    grid = corners.reshape(board.rows, board.columns, 2)
    steps = np.stack([np.gradient(grid, axis=1), np.gradient(grid, axis=0)], 2)
    return np.asarray(steps.reshape(-1, 2, 2))


def _judged(sharp: npt.NDArray[np.float32], corners: Array, board: Checkerboard) -> Any:
    """The sighting that the fits give, or why not."""
    steps = steps_of(corners, board)
    side = float(np.linalg.norm(steps, axis=2).min())
    if side < _LEAST_SIDE_PX:
        return Refused(Reason.SMALL, f"squares of {side:.1f} px; come nearer")
    fit = fit_corners(sharp, corners, steps)
    return (
        _covered(fit, board)
        or _blurred(fit, side)
        or _faint(sharp, fit)
        or _oblique(steps)
        or _uneven(fit, side, board)
        or _continued(sharp, fit, board)
        or _sighting(fit, side, board)
    )


def _sighting(fit: CornerFit, side: float, board: Checkerboard) -> Sighting:
    signed = fit.contrast * _alternating(board)
    return Sighting(
        fit.uv,
        _sigma(fit),
        np.median(fit.blur_px, 0),
        side,
        float(2 * np.median(np.abs(fit.contrast))),
        bool(np.median(signed) > 0),
    )


def _sigma(fit: CornerFit) -> float:
    return float(np.sqrt(np.median(np.trace(fit.covariance, axis1=1, axis2=2)) / 2))


def _alternating(board: Checkerboard) -> Array:
    return np.asarray(np.where(board.grid.sum(1) % 2 == 0, 1.0, -1.0))


def _covered(fit: CornerFit, board: Checkerboard) -> Refused | None:
    """Corners that are none: with no contrast, or with light and dark the wrong way round."""
    signed = fit.contrast * _alternating(board)
    median = np.nanmedian(signed) if np.isfinite(signed).any() else 0.0
    there = signed * np.sign(median) > _LEAST_CONTRAST * abs(median)  # nan is not there
    missing = int(len(there) - there.sum())
    if missing == 0:
        return None
    return Refused(Reason.COVERED, f"{missing} of {len(there)} corners are not those of squares")


def _blurred(fit: CornerFit, side: float) -> Refused | None:
    across = np.median(fit.blur_px, 0)
    smear = float(np.sqrt(abs(across[0] ** 2 - across[1] ** 2)))
    if smear > _MOST_SMEAR_PX:
        return Refused(Reason.SMEARED, f"one way more blurred than the other by {smear:.1f} px")
    blur, most = float(across.max()), min(_MOST_BLUR_PX, _MOST_BLUR * side)
    if blur > most:
        return Refused(Reason.BLURRED, f"edges blurred by {blur:.1f} px, more than {most:.1f}")
    return None


def _faint(sharp: npt.NDArray[np.float32], fit: CornerFit) -> Refused | None:
    sigma = _sigma(fit)
    if sigma > _MOST_SIGMA_PX:
        return Refused(Reason.FAINT, f"corners known to {sigma:.2f} px; more contrast is needed")
    noise = _noise(sharp, fit.uv)
    contrast = float(np.median(np.abs(fit.contrast)))
    left = float(np.sqrt(max(np.median(fit.left) ** 2 - noise**2, 0.0)))
    if left > max(_MOST_STRUCTURE * contrast, noise / 2):
        share = 100 * left / contrast
        return Refused(Reason.UNCLEAN, f"{share:.0f} % of the contrast is of no square")
    return None


def _noise(sharp: npt.NDArray[np.float32], uv: Array) -> float:
    """Standard deviation of the pixels' noise around the board.

    Of a difference that is zero for planes and for straight edges along either axis (Immerkaer,
    Fast noise variance estimation, 1996); its median does not mind what edges are left.
    """
    low = np.floor(uv.min(0)).astype(int).clip(0)
    high = np.ceil(uv.max(0)).astype(int) + 1
    part = sharp[low[1] : high[1], low[0] : high[0]]
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    return float(np.median(np.abs(cv2.filter2D(part, -1, kernel))) / 0.6745 / 6)


def _oblique(steps: Array) -> Refused | None:
    """Judged by how much shorter a circle on the board looks one way than the other."""
    strengths = np.linalg.svd(steps.transpose(0, 2, 1), compute_uv=False)
    cosine = float(np.median(strengths[:, 1] / strengths[:, 0]))
    if cosine >= _LEAST_COSINE:
        return None
    angle = np.degrees(np.arccos(cosine))
    return Refused(Reason.OBLIQUE, f"seen at {angle:.0f} deg from its normal; up to 70 serve")


def _uneven(fit: CornerFit, side: float, board: Checkerboard) -> Refused | None:
    """Corners that a plane behind a lens cannot give: a homography and a smooth bend of it."""
    homography, _ = cv2.findHomography(board.grid, fit.uv)
    if homography is None:
        return Refused(Reason.UNEVEN, "the corners are on a line")
    flat = cv2.perspectiveTransform(board.grid[None], homography)[0]
    shapes = _bends(board)
    off = fit.uv - flat
    off -= shapes @ np.linalg.lstsq(shapes, off, rcond=None)[0]
    worst = float(np.hypot(*off.T).max())
    if worst <= _UNEVEN * side + _SIGMAS * _sigma(fit):
        return None
    return Refused(Reason.UNEVEN, f"a corner is off by {worst:.1f} px; is the board flat?")


def _bends(board: Checkerboard) -> Array:
    """(count, K) polynomials of third degree, of lower where a side has few corners."""
    x, y = ((board.grid / (np.array(board.size) - 1)) * 2 - 1).T
    most = min(3, board.columns - 2), min(3, board.rows - 2)
    powers = [(i, j) for i in range(most[0] + 1) for j in range(most[1] + 1) if i + j <= max(most)]
    return np.stack([x**i * y**j for i, j in powers], 1)


def _continued(
    sharp: npt.NDArray[np.float32], fit: CornerFit, board: Checkerboard
) -> Refused | None:
    """A board that goes on beyond its corners has more squares than it should."""
    grid = fit.uv.reshape(board.rows, board.columns, 2)
    steps = steps_of(fit.uv, board).reshape(board.rows, board.columns, 2, 2)
    sides = [
        (grid[:, 0] - steps[:, 0, 0], steps[:, 0]),
        (grid[:, -1] + steps[:, -1, 0], steps[:, -1]),
        (grid[0] - steps[0, :, 1], steps[0]),
        (grid[-1] + steps[-1, :, 1], steps[-1]),
    ]
    usual = np.median(np.abs(fit.contrast))
    for corners, step in sides:
        beyond = fit_corners(sharp, corners, step)
        # Where one quarter alone differs, as at a plain margin, all three contrasts are equal.
        lone = np.abs(beyond.steps).max(1)
        sure = np.nan_to_num(np.maximum(np.abs(beyond.contrast) - lone, 0.0))
        turning = sure * np.sign(np.nan_to_num(beyond.contrast))
        turning *= np.where(np.arange(len(sure)) % 2, -1, 1)
        if abs(np.median(turning)) > _RING * usual:
            return Refused(Reason.OTHER_BOARD, f"it has more corners than {_name(board)}")
    return None


def _name(board: Checkerboard) -> str:
    return f"{board.columns}x{board.rows}"


def _not_found(grey: Picture, board: Checkerboard) -> Refused:
    """Whether a part of a board is to be seen."""
    flags = _DETECTION | cv2.CALIB_CB_LARGER
    form = stretched(_shrunk(grey)[0])
    found = cv2.findChessboardCornersSBWithMeta(form, (3, 3), flags)
    if not found[0]:
        return Refused(Reason.NO_BOARD, "none is seen")
    rows, columns = found[2].shape[:2]
    seen = f"{columns}x{rows} corners are seen, {_name(board)} were looked for"
    more = max(rows, columns) > max(board.size) or min(rows, columns) > min(board.size)
    return Refused(Reason.OTHER_BOARD if more else Reason.PARTIAL, seen)
