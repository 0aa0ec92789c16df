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
"""Define polynomials from the pixels of a picture of the ground to a plane in metres.

Order 1 is affine (3 terms each way), 2 has 6 and 3 has 10 terms: the cubic with which Ren et al.
2022 (section 4.2) registered their orthophoto. Least squares uses coordinates relative to their
mean and scaled to unit size, because powers of pixel numbers would lose all digits. Between the
control points a polynomial is as good as its residuals; outside their convex hull it diverges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import CalibrationError

#: Number of control points that each order needs.
TERMS = {1: 3, 2: 6, 3: 10}
_CURVES = {1: "a line", 2: "a line or a conic", 3: "a line, a conic or a cubic"}
#: Least ratio of smallest to largest singular value; well spread points are above 0.03.
_DEGENERATE = 1e-3


class _Scale:
    """Scale coordinates, relative to the middle of points (n, 2) in units of their size."""

    def __init__(self, points: Array) -> None:
        self.middle = points.mean(axis=0)
        self.size = float(np.abs(points - self.middle).max()) or 1.0

    def of(self, points: Array) -> Array:
        return np.asarray((points - self.middle) / self.size)


@dataclass(frozen=True, slots=True)
class PolynomialTransform:
    """Convert pixels (column, row) to a plane (x, y, metres); made by ``fit_polynomial``."""

    order: int
    pixels: _Scale
    plane: _Scale
    coefficients: Array  # (terms, 2) between scaled coordinates
    inverse: Array  # (terms, terms) inverse of the normal matrix
    hull_px: Array  # (corners, 2) convex hull of the control points

    def __call__(self, pixels: Array) -> Array:
        """Return (n, 2) metres of pixels (n, 2)."""
        terms = _terms(self.pixels.of(pixels), self.order)
        return np.asarray(terms @ self.coefficients * self.plane.size + self.plane.middle)

    def jacobian(self, pixels: Array) -> Array:
        """Return (n, 2, 2) metres per pixel: rows x, y; columns column, row."""
        u, v = self.pixels.of(pixels).T
        powers = _powers(self.order)
        by_u = np.stack([i * u ** max(i - 1, 0) * v**j for i, j in powers], axis=1)
        by_v = np.stack([j * u**i * v ** max(j - 1, 0) for i, j in powers], axis=1)
        slopes = np.stack([by_u @ self.coefficients, by_v @ self.coefficients], axis=2)
        return np.asarray(slopes * (self.plane.size / self.pixels.size))

    def leverage(self, pixels: Array) -> Array:
        """Return (n,) variances of places relative to that of a control point, on either axis."""
        terms = _terms(self.pixels.of(pixels), self.order)
        return np.asarray(np.einsum("ij,jk,ik->i", terms, self.inverse, terms))

    def inside(self, pixels: Array) -> BoolArray:
        """Return (n,) which pixels lie within the control points' convex hull, or on its edge."""
        begin, end = self.hull_px, np.roll(self.hull_px, -1, axis=0)
        along, to = end - begin, pixels[:, None] - begin
        cross = along[:, 0] * to[..., 1] - along[:, 1] * to[..., 0]
        slack = 1e-6 * self.pixels.size * np.hypot(*along.T)
        return np.asarray((cross >= -slack).all(axis=1) | (cross <= slack).all(axis=1))

    def folded(self, pixels: Array) -> BoolArray:
        """Return (n,) where the polynomial mirrors the picture, so that it cannot be right."""
        signs = np.linalg.det(self.jacobian(pixels))
        middle = np.linalg.det(self.jacobian(self.pixels.middle[None]))
        return np.asarray(signs * np.sign(middle) <= 0)


@dataclass(frozen=True, slots=True)
class Residuals:
    """Hold the residuals at n control points."""

    metres: Array  # (n, 2) surveyed minus transformed
    pixels: Array  # (n, 2) the same as columns and rows
    left_out_m: Array  # (n,) residual length if the point is left out; inf: then not determined
    sigma_m: float  # of one coordinate, from the redundancy; nan without redundancy

    @property
    def lengths_m(self) -> Array:
        """Return (n,) lengths of the residuals, m."""
        return np.asarray(np.hypot(*self.metres.T))

    @property
    def lengths_px(self) -> Array:
        """Return (n,) lengths of the residuals, px."""
        return np.asarray(np.hypot(*self.pixels.T))


def fit_polynomial(
    pixels: Array, plane: Array, order: int
) -> tuple[PolynomialTransform, Residuals]:
    """Fit a polynomial to control points: pixels (n, 2) and metres (n, 2).

    Raises CalibrationError for too few points, or points that do not determine a coefficient.
    """
    needed = TERMS[order]
    if len(pixels) < needed:
        raise CalibrationError(
            f"order {order} needs {needed} control points, not {len(pixels)}; "
            "measure more or lower --order"
        )
    from_scale, to_scale = _Scale(pixels), _Scale(plane)
    terms = _terms(from_scale.of(pixels), order)
    u, singular, vt = np.linalg.svd(terms, full_matrices=False)
    if singular[-1] < _DEGENERATE * singular[0]:
        raise CalibrationError(
            f"the control points lie on {_CURVES[order]}, or some coincide: order {order} is "
            "not determined; spread them over the picture or lower --order"
        )
    coefficients = vt.T @ ((u.T @ to_scale.of(plane)) / singular[:, None])
    inverse = (vt.T / singular**2) @ vt
    hull_px = cv2.convexHull(pixels.astype(np.float32))[:, 0].astype(float)
    transform = PolynomialTransform(order, from_scale, to_scale, coefficients, inverse, hull_px)
    metres = plane - transform(pixels)
    in_pixels = np.linalg.solve(transform.jacobian(pixels), metres[..., None])[..., 0]
    spare = 1 - transform.leverage(pixels)
    free = len(pixels) - needed
    lengths = np.hypot(*metres.T)
    left_out = np.full(len(pixels), math.inf)
    np.divide(lengths, spare, out=left_out, where=spare > 1e-9)
    sigma_m = math.sqrt(float((metres**2).sum()) / (2 * free)) if free else math.nan
    return transform, Residuals(metres, np.asarray(in_pixels, float), left_out, sigma_m)


def _powers(order: int) -> list[tuple[int, int]]:
    return [(total - j, j) for total in range(order + 1) for j in range(total + 1)]


def _terms(points: Array, order: int) -> Array:
    u, v = points.T
    return np.stack([u**i * v**j for i, j in _powers(order)], axis=1)
