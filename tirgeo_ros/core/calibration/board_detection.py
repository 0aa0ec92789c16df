"""Detect a checkerboard in a thermal picture: all its corners, or the reason for rejecting them.

Foil on a board gives a contrast of a few degrees, of either sign, and unevenly. The picture is
given to OpenCV's detector in several forms until it finds the board. The corners are then fitted
in the original picture, to a few hundredths of a pixel: two straight edges cross, each blurred by
its own width, and the four quarters around them have their own temperatures:

    I(p) = a + b s1 + c s2 + d s1 s2,    s_i = tanh(n_i . (p - corner) / w_i)

If the foil is warmer on one square than on the next, b and c take the difference, and it does not
move the corner as it moves a saddle point. The residuals give the corner's covariance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

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
_STEPS = 15
_SETTLED_PX = 1e-3
_WIDTHS_PX = 0.25, 8.0
_PARAMETERS = 10  # u, v, two angles, two logarithms of widths, four levels


@dataclass(frozen=True)
class CornerFit:
    """Hold N fitted corners; nan where the fit failed."""

    uv: Array  # (N, 2) px
    covariance: Array  # (N, 2, 2) px^2, from the residuals
    contrast: Array  # (N,) grey values: d, half the step; its sign alternates over a board
    steps: Array  # (N, 2) grey values: b and c, half of each edge's own step
    left: Array  # (N,) grey values: rms of the residuals
    blur_px: Array  # (N, 2) sigma of the blur across each edge


def fit_corners(image: npt.NDArray[np.float32], uv: Array, steps_px: Array) -> CornerFit:
    """Refine corners (N, 2) of an image (h, w) with squares' sides ``steps_px`` (N, 2, 2).

    ``steps_px[:, 0]`` goes from a corner to the next along its row, ``[:, 1]`` along its column.
    """
    reach = np.clip(_REACH * np.linalg.norm(steps_px, axis=2).min(1), _LEAST_PX, _MOST_PX)
    middles = np.rint(uv)
    low, high = middles - reach[:, None], middles + reach[:, None]
    height, width = image.shape
    inside = (low >= 0).all(1) & (high <= [width - 1, height - 1]).all(1)
    fits = _Fits(image, middles[inside], uv[inside], steps_px[inside], reach[inside])
    fits.solve()

    def placed(values: Array) -> Array:
        """Return values in the order of all corners, nan for those without a good fit."""
        out = np.full((len(inside), *values.shape[1:]), np.nan)
        out[inside] = np.where(fits.good.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)
        return out

    return CornerFit(
        uv=placed(fits.middles + fits.p[:, :2]),
        covariance=placed(fits.covariance),
        contrast=placed(fits.p[:, 9]),
        steps=placed(fits.p[:, 7:9]),
        left=placed(np.sqrt(fits.variance)),
        blur_px=placed(_SIGMA_OF_WIDTH * np.exp(fits.p[:, 4:6])),
    )


class _Fits:
    """Fit all corners at once by the Levenberg-Marquardt method."""

    def __init__(
        self,
        image: npt.NDArray[np.float32],
        middles: Array,
        uv: Array,
        steps_px: Array,
        reach: Array,
    ) -> None:
        half = math.ceil(float(reach.max(initial=_LEAST_PX)))
        dv, du = np.mgrid[-half : half + 1, -half : half + 1].reshape(2, -1)
        columns = middles[:, 0, None].astype(int) + du
        rows = middles[:, 1, None].astype(int) + dv
        height, width = image.shape
        self._weights = (du**2 + dv**2 <= reach[:, None] ** 2).astype(float)
        self._seen = image[rows.clip(0, height - 1), columns.clip(0, width - 1)].astype(float)
        self._du, self._dv = du.astype(float), dv.astype(float)
        self.middles, self._reach = middles, reach
        self.p = np.zeros((len(uv), _PARAMETERS))
        self.p[:, :2] = uv - middles
        self.p[:, 2:4] = np.arctan2(steps_px[..., 1], steps_px[..., 0])
        # The four levels begin with linear least squares.
        model = self._shapes(self.p)[2]
        weighted = model * self._weights[:, None]
        normal = weighted @ model.transpose(0, 2, 1) + 1e-9 * np.eye(4)
        right = (weighted * self._seen[:, None]).sum(2)
        self.p[:, 6:] = np.linalg.solve(normal, right[..., None])[..., 0]

    def _shapes(self, p: Array) -> tuple[Array, Array, Array]:
        """Return places along and across both edges (N, 2, M), and four shapes (N, 4, M)."""
        x, y = self._du - p[:, :1], self._dv - p[:, 1:2]
        cosine, sine = np.cos(p[:, 2:4, None]), np.sin(p[:, 2:4, None])
        along = cosine * x[:, None] + sine * y[:, None]
        across = cosine * y[:, None] - sine * x[:, None]
        s = np.tanh(across * np.exp(-p[:, 4:6, None]))
        constant = np.ones_like(s[:, 0])
        shapes = np.stack([constant, s[:, 0], s[:, 1], s[:, 0] * s[:, 1]], 1)
        return along, across, shapes

    def _errors(self, p: Array) -> Array:
        model = (p[:, 6:, None] * self._shapes(p)[2]).sum(1)
        return np.asarray((self._seen - model) * self._weights)

    def _slopes(self, p: Array) -> Array:
        """Return (N, 10, M) derivatives of the model, weighted."""
        along, across, shapes = self._shapes(p)
        s = shapes[:, 1:3]
        other = p[:, 7:9, None] + p[:, 9, None, None] * s[:, ::-1]  # dI/ds1, dI/ds2
        steep = other * (1 - s * s) * np.exp(-p[:, 4:6, None])  # dI/d(across)
        cosine, sine = np.cos(p[:, 2:4, None]), np.sin(p[:, 2:4, None])
        by_u, by_v = (steep * sine).sum(1), -(steep * cosine).sum(1)
        parts = [by_u[:, None], by_v[:, None], -steep * along, -steep * across, shapes]
        return np.asarray(np.concatenate(parts, 1) * self._weights[:, None])

    def solve(self) -> None:
        """Fit the corners, and decide which fits are good."""
        damping = np.full(len(self.p), 1e-3)
        errors = self._errors(self.p)
        cost = (errors**2).sum(1)
        for _ in range(_STEPS):
            slopes = self._slopes(self.p)
            normal = slopes @ slopes.transpose(0, 2, 1)
            right = (slopes * errors[:, None]).sum(2)
            damped = normal + _ridge(normal, damping[:, None])
            step = np.linalg.solve(damped, right[..., None])[..., 0]
            tried = self.p + step
            tried[:, 4:6] = np.clip(tried[:, 4:6], *np.log(_WIDTHS_PX))
            new_errors = self._errors(tried)
            new_cost = (new_errors**2).sum(1)
            better = new_cost <= cost
            self.p[better], errors[better] = tried[better], new_errors[better]
            cost = np.where(better, new_cost, cost)
            damping = np.where(better, damping / 5, damping * 10)
            if np.abs(step[:, :2]).max(initial=0.0) < _SETTLED_PX:
                break
        slopes = self._slopes(self.p)
        normal = slopes @ slopes.transpose(0, 2, 1)
        freedom = np.maximum(self._weights.sum(1) - _PARAMETERS, 1)
        self.variance = cost / freedom
        spread = np.linalg.inv(normal + _ridge(normal, 1e-9))[:, :2, :2]
        self.covariance = spread * self.variance[:, None, None]
        moved = np.hypot(*self.p[:, :2].T)
        self.good = np.isfinite(self.p).all(1) & (moved < self._reach)


def _ridge(normal: Array, share: float | Array) -> Array:
    """Return a diagonal matrix, relative to each parameter's own size, and never zero."""
    own = np.diagonal(normal, axis1=1, axis2=2)
    return np.asarray(
        (share * own + 1e-12 * own.max(1, keepdims=True) + 1e-30)[:, None] * np.eye(_PARAMETERS)
    )


_MOST_BLUR = 0.22  # of a square's side
_MOST_BLUR_PX = 3.0
_MOST_SMEAR_PX = 2.2  # extra blur in one direction: 8 px of motion
_LEAST_CONTRAST = 0.3  # of a corner, relative to the median of all
_MOST_SIGMA_PX = 0.25
_MOST_STRUCTURE = 0.2  # largest residual that is not noise, relative to the contrast
_LEAST_COSINE = 0.34  # of the angle between the view and the board's normal: 70 deg
_UNEVEN = 0.025  # largest deviation of a corner, in squares, and
_SIGMAS = 4.0  # in addition this many sigmas of a corner
_RING = 0.4  # contrast of a corner beyond the board, less a lone square's, relative to the median


def doubt(
    sharp: npt.NDArray[np.float32], fit: CornerFit, side_px: float, board: Checkerboard
) -> Refused | None:
    """Return why a picture's (h, w) corners are rejected, or None; ``side_px`` is the shortest."""
    return (
        _covered(fit, board)
        or _blurred(fit, side_px)
        or _faint(sharp, fit)
        or _oblique(steps_of(fit.uv, board))
        or _uneven(fit, side_px, board)
        or _continued(sharp, fit, board)
    )


def sigma_px(fit: CornerFit) -> float:
    """Return the standard deviation of a coordinate of the median corner, px."""
    return float(np.sqrt(np.median(np.trace(fit.covariance, axis1=1, axis2=2)) / 2))


def _covered(fit: CornerFit, board: Checkerboard) -> Refused | None:
    """Reject corners without contrast, or with light and dark the wrong way round."""
    signed = fit.contrast * np.where(board.grid.sum(1) % 2 == 0, 1.0, -1.0)  # in turns
    median = np.nanmedian(signed) if np.isfinite(signed).any() else 0.0
    there = signed * np.sign(median) > _LEAST_CONTRAST * abs(median)  # nan compares false
    missing = int(len(there) - there.sum())
    if missing == 0:
        return None
    return Refused(
        RefusalReason.COVERED, f"{missing} of {len(there)} corners are not those of squares"
    )


def _blurred(fit: CornerFit, side: float) -> Refused | None:
    across = np.median(fit.blur_px, 0)
    smear = float(np.sqrt(abs(across[0] ** 2 - across[1] ** 2)))
    if smear > _MOST_SMEAR_PX:
        return Refused(
            RefusalReason.SMEARED,
            f"more blurred in one direction than in the other, by {smear:.1f} px",
        )
    blur, most = float(across.max()), min(_MOST_BLUR_PX, _MOST_BLUR * side)
    if blur > most:
        return Refused(
            RefusalReason.BLURRED, f"edges blurred by {blur:.1f} px, more than {most:.1f}"
        )
    return None


def _faint(sharp: npt.NDArray[np.float32], fit: CornerFit) -> Refused | None:
    sigma = sigma_px(fit)
    if sigma > _MOST_SIGMA_PX:
        return Refused(
            RefusalReason.FAINT, f"corners known to {sigma:.2f} px; more contrast is needed"
        )
    noise = _noise(sharp, fit.uv)
    contrast = float(np.median(np.abs(fit.contrast)))
    left = float(np.sqrt(max(np.median(fit.left) ** 2 - noise**2, 0.0)))
    if left > max(_MOST_STRUCTURE * contrast, noise / 2):
        share = 100 * left / contrast
        return Refused(
            RefusalReason.UNCLEAN, f"{share:.0f} % of the contrast is not from the squares"
        )
    return None


def _noise(sharp: npt.NDArray[np.float32], uv: Array) -> float:
    """Return the standard deviation of the pixels' noise around the board.

    The filter is zero on planes and on straight edges along either axis (Immerkaer, Fast noise
    variance estimation, 1996). The median of its output ignores the remaining edges.
    """
    low = np.floor(uv.min(0)).astype(int).clip(0)
    high = np.ceil(uv.max(0)).astype(int) + 1
    part = sharp[low[1] : high[1], low[0] : high[0]]
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    return float(np.median(np.abs(cv2.filter2D(part, -1, kernel))) / 0.6745 / 6)


def _oblique(steps: Array) -> Refused | None:
    """Reject by the ratio of the axes of the ellipse that a circle on the board becomes."""
    strengths = np.linalg.svd(steps.transpose(0, 2, 1), compute_uv=False)
    cosine = float(np.median(strengths[:, 1] / strengths[:, 0]))
    if cosine >= _LEAST_COSINE:
        return None
    angle = np.degrees(np.arccos(cosine))
    return Refused(
        RefusalReason.OBLIQUE, f"seen at {angle:.0f} deg from its normal; at most 70 can be used"
    )


def _uneven(fit: CornerFit, side: float, board: Checkerboard) -> Refused | None:
    """Reject corners that a plane behind a lens cannot give: a homography plus a smooth bend."""
    homography, _ = cv2.findHomography(board.grid, fit.uv)
    if homography is None:
        return Refused(RefusalReason.UNEVEN, "the corners are on a line")
    flat = cv2.perspectiveTransform(board.grid[None], homography)[0]
    shapes = _bends(board)
    off = fit.uv - flat
    off -= shapes @ np.linalg.lstsq(shapes, off, rcond=None)[0]
    worst = float(np.hypot(*off.T).max())
    if worst <= _UNEVEN * side + _SIGMAS * sigma_px(fit):
        return None
    return Refused(RefusalReason.UNEVEN, f"a corner is off by {worst:.1f} px; is the board flat?")


def _bends(board: Checkerboard) -> Array:
    """Return (count, K) polynomials of third degree, of lower degree if a side has few corners."""
    x, y = ((board.grid / (np.array(board.size) - 1)) * 2 - 1).T
    most = min(3, board.columns - 2), min(3, board.rows - 2)
    powers = [(i, j) for i in range(most[0] + 1) for j in range(most[1] + 1) if i + j <= max(most)]
    return np.stack([x**i * y**j for i, j in powers], 1)


def _continued(
    sharp: npt.NDArray[np.float32], fit: CornerFit, board: Checkerboard
) -> Refused | None:
    """Reject a board that continues beyond its corners, so that it has more squares than given."""
    grid = fit.uv.reshape(board.rows, board.columns, 2)
    steps = steps_of(fit.uv, board).reshape(board.rows, board.columns, 2, 2)
    sides = [
        (grid[:, end] + way * steps[:, end, 0], steps[:, end]) for end, way in ((0, -1), (-1, 1))
    ] + [(grid[end] + way * steps[end, :, 1], steps[end]) for end, way in ((0, -1), (-1, 1))]
    usual = np.median(np.abs(fit.contrast))
    for corners, step in sides:
        beyond = fit_corners(sharp, corners, step)
        # At a plain margin only one quarter differs, and all three contrasts are equal.
        lone = np.abs(beyond.steps).max(1)
        sure = np.nan_to_num(np.maximum(np.abs(beyond.contrast) - lone, 0.0))
        turning = sure * np.sign(np.nan_to_num(beyond.contrast))
        turning *= np.where(np.arange(len(sure)) % 2, -1, 1)
        if abs(np.median(turning)) > _RING * usual:
            return Refused(
                RefusalReason.OTHER_BOARD, f"it has more corners than {board.columns}x{board.rows}"
            )
    return None


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
