"""Fit the corners of a checkerboard to a few hundredths of a pixel, in blur and noise.

Two straight edges cross, each blurred by its own width, and the four quarters around them have
their own temperatures:

    I(p) = a + b s1 + c s2 + d s1 s2,    s_i = tanh(n_i . (p - corner) / w_i)

This is fitted to the pixels around a corner by least squares. If the foil is warmer on one square
than on the next, b and c take the difference, and it does not move the corner as it moves a saddle
point. The blur is estimated with the corner, and the residuals give the corner's covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array

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
        placed(fits.middles + fits.p[:, :2]),
        placed(fits.covariance),
        placed(fits.p[:, 9]),
        placed(fits.p[:, 7:9]),
        placed(np.sqrt(fits.variance)),
        placed(_SIGMA_OF_WIDTH * np.exp(fits.p[:, 4:6])),
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
        one = np.ones_like(s[:, 0])
        shapes = np.stack([one, s[:, 0], s[:, 1], s[:, 0] * s[:, 1]], 1)
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
