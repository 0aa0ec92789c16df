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
"""Model a camera with lens distortion: points to pixels, pixels to rays, and its valid radius.

The pinhole camera with Brown's distortion (Ren et al. 2022, Eq. 25-26) or the rational model, in
OpenCV's order of coefficients. Pixel (0, 0) is the centre of the first pixel, so the image spans
-0.5 to width - 0.5. A polynomial that was fitted inside the image is not valid far outside it: it
folds back or diverges, and a point outside the field of view would be drawn inside the image. Each
camera therefore has a radius up to which its model is valid, and gives no result beyond it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CameraError

T = TypeVar("T", Array, float)

#: Points nearer than this along the optical axis are not projected.
NEAR_M = 0.1

_SIZES = (0, 4, 5, 8)  # none, Brown, Brown with k3, rational
_WIDEST_RADIUS = 20.0  # 87 deg from the axis: no plane image reaches farther
_FOLD_MARGIN = 0.98
_CORNER_MARGIN = 1.1
_MOST_PIXELS = 1 << 28  # 268 million; the largest airborne camera has 150 million
# Far beyond any real lens or sensor. Larger values would overflow in later computations.
_LARGEST_PX = 1e6
_LARGEST_COEFFICIENT = 1e9
#: A model valid beyond this many times the farthest corner's radius needs a ray at every corner.
_TOO_FAR = 2.0
_TABLE_SIZE = 512
_NEWTON_STEPS = 5
_SETTLED = 1e-9  # size of the last Newton correction: the next is of the order of its square
_CONVERGED = 1e-12  # in normalised units: 1e-9 px with a focal length of 1000 px
#: Lines are clipped this far outside the image, so that their cut ends are not visible.
_BORDER_PX = 8.0
_EDGE_SAMPLES = 33


@dataclass(frozen=True)
class Camera:
    """Hold a calibrated camera; raise CameraError if the calibration is impossible.

    ``width``, ``height``, ``fx``, ``fy``, ``cx``, ``cy`` in pixels; ``distortion`` is k1, k2, p1,
    p2, then k3, then k4, k5, k6 (0, 4, 5 or 8 numbers).
    ``max_radius`` is the distance from the axis, on the plane z = 1, up to which the model is
    valid: 98 % of the radius at which the lens model folds, or 110 % of the farthest corner's
    radius if that is smaller.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    max_radius: float = field(init=False, compare=False)
    _k: tuple[float, ...] = field(init=False, repr=False, compare=False)
    _radii: tuple[Array, Array] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the calibration and compute the radius up to which it is valid."""
        size = f"{self.width}x{self.height}"
        numbers = (self.width, self.height, self.fx, self.fy, self.cx, self.cy, *self.distortion)
        if len(self.distortion) not in _SIZES:
            raise CameraError(
                f"camera: {len(self.distortion)} distortion coefficients; give 0, 4 or 5 "
                "(plumb_bob) or 8 (rational_polynomial)"
            )
        if not all(math.isfinite(number) for number in numbers):
            raise CameraError("camera: the calibration is not finite; calibrate the lens again")
        large = max(map(abs, (self.fx, self.fy, self.cx, self.cy))) > _LARGEST_PX
        if large or max(map(abs, self.distortion), default=0.0) > _LARGEST_COEFFICIENT:
            raise CameraError(
                "camera: the calibration has impossible values; calibrate the lens again"
            )
        if self.width * self.height > _MOST_PIXELS:
            raise CameraError(f"camera: size {size} is too large; check width and height")
        if min(self.width, self.height) < 1 or min(self.fx, self.fy) <= 0:
            raise CameraError(
                f"camera: size {size} and focal lengths {self.fx:g}, {self.fy:g} must be "
                "positive; is the camera calibrated?"
            )
        k = (*map(float, self.distortion), *[0.0] * (8 - len(self.distortion)))
        object.__setattr__(self, "_k", k)
        reach = min(_FOLD_MARGIN * _fold_radius(k), _WIDEST_RADIUS)
        self._limit(reach)
        corner = self._corner_radius()
        self._limit(min(reach, _CORNER_MARGIN * corner))
        reach_px = self._radii[0][-1] * min(self.fx, self.fy)
        if reach_px < min(self.width, self.height) / 2:
            raise CameraError(
                f"camera: the lens model {self.distortion} folds {reach_px:.0f} px from the "
                "principal point; calibrate the lens again"
            )

    def _limit(self, max_radius: float) -> None:
        """Set ``max_radius``, and tabulate the distorted radius and the radius up to it."""
        radius = np.linspace(0.0, max_radius, _TABLE_SIZE)
        object.__setattr__(self, "max_radius", float(max_radius))
        object.__setattr__(self, "_radii", (radius * _radial(self._k, radius**2), radius))

    def _corner_radius(self) -> float:
        """Return the radius of the farthest image corner; infinite if a corner has no ray.

        Raise CameraError if the model reaches far past such a corner: then it bends too steeply
        to be inverted there.
        """
        right, bottom = self.width - 0.5, self.height - 0.5
        corners = np.array([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]])
        radius = np.hypot(*self.rays(corners)[:, :2].T)
        if np.isfinite(radius).all():
            return float(radius.max())
        farthest = np.hypot(*((corners - [self.cx, self.cy]) / [self.fx, self.fy]).T).max()
        if self._radii[0][-1] > _TOO_FAR * farthest:
            raise CameraError(
                f"camera: the lens model {self.distortion} is too steep to be inverted; "
                "calibrate the lens again"
            )
        return math.inf

    @property
    def matrix(self) -> Array:
        """Return the camera matrix K, (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def pixels(self, x: Array, y: Array) -> Array:
        """Project points on the plane z = 1 to pixels (2, ...), columns and rows.

        ``x`` and ``y`` have the same shape (...); the points must lie within ``max_radius``.
        """
        x, y = _distort(self._k, x, y)
        uv = np.empty((2, *np.shape(x)))
        np.add(np.multiply(x, self.fx, out=uv[0, ...]), self.cx, out=uv[0, ...])
        np.add(np.multiply(y, self.fy, out=uv[1, ...]), self.cy, out=uv[1, ...])
        return uv

    def slopes(self, x: T, y: T) -> tuple[T, T, T, T]:
        """Return du/dx, du/dy, dv/dx, dv/dy (px) of ``pixels``; arrays of any shape, or floats."""
        xx, xy, yy = _slopes(self._k, x, y)
        return self.fx * xx, self.fx * xy, self.fy * xy, self.fy * yy

    def project(self, points_c: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Project points (N, 3) in the optical frame, m, to pixels (N, 2); also return valid (N,).

        Points nearer than NEAR_M along the axis or beyond ``max_radius`` are not valid; their
        pixels are nan.
        """
        x, y, z = np.asarray(points_c, float).reshape(-1, 3).T
        with np.errstate(invalid="ignore", over="ignore"):
            ahead = z > NEAR_M
            depth = np.where(ahead, z, 1.0)
            x, y = x / depth, y / depth
            valid = ahead & (x * x + y * y <= self.max_radius**2)
        uv = np.full((len(z), 2), np.nan)
        uv[valid] = self.pixels(x[valid], y[valid]).T
        return uv, valid

    def rays(self, uv: Array) -> Array:
        """Convert pixels (N, 2) to rays (N, 3) in the optical frame, z = 1; nan without a ray.

        The distortion is inverted by Newton's method. The first guess is from the table of the
        radial distortion.
        """
        uv = np.asarray(uv, float).reshape(-1, 2)
        if len(uv) == 1:
            return self._ray(*uv[0].tolist())
        xd, yd = ((uv - [self.cx, self.cy]) / [self.fx, self.fy]).T
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            distorted = np.hypot(xd, yd)
            shrink = np.interp(distorted, *self._radii) / np.maximum(distorted, 1e-300)
            x, y = xd * shrink, yd * shrink
            for _ in range(_NEWTON_STEPS):
                dx, dy = _newton_step(self._k, x, y, xd, yd)
                x, y = x - dx, y - dy
                if np.abs(dx).max(initial=0.0) + np.abs(dy).max(initial=0.0) < _SETTLED:
                    break
            reached = _distort(self._k, x, y)
            converged = np.hypot(reached[0] - xd, reached[1] - yd) <= _CONVERGED
            converged &= x * x + y * y <= self.max_radius**2
        return np.where(converged[:, None], np.stack([x, y, np.ones_like(x)], axis=1), np.nan)

    def _ray(self, u: float, v: float) -> Array:
        """Return ``rays`` (1, 3) of one pixel, computed in floats: a fifth of the time."""
        xd, yd = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        distorted = math.hypot(xd, yd)
        shrink = float(np.interp(distorted, *self._radii)) / max(distorted, 1e-300)
        x, y = xd * shrink, yd * shrink
        try:
            for _ in range(_NEWTON_STEPS):
                dx, dy = _newton_step(self._k, x, y, xd, yd)
                x, y = x - dx, y - dy
                if abs(dx) + abs(dy) < _SETTLED:
                    break
            reached = _distort(self._k, x, y)
        except ZeroDivisionError:
            return np.full((1, 3), np.nan)
        converged = math.hypot(reached[0] - xd, reached[1] - yd) <= _CONVERGED
        converged &= x * x + y * y <= self.max_radius**2
        return np.array([[x, y, 1.0]]) if converged else np.full((1, 3), np.nan)


def _fold_radius(k: tuple[float, ...]) -> float:
    """Return the smallest radius at which the distorted radius stops growing or has a pole.

    Infinite if there is none.
    With s = r^2 and r_d = r N(s) / D(s): dr_d/dr = ((N + 2 s N') D - 2 s N D') / D^2.
    """
    from numpy.polynomial import polynomial as poly  # noqa: PLC0415  nodes without camera: 1 MB

    top, bottom = [1.0, k[0], k[1], k[4]], [1.0, k[5], k[6], k[7]]
    two_s = [0.0, 2.0]
    rise = poly.polyadd(top, poly.polymul(two_s, poly.polyder(top)))
    fall = poly.polymul(two_s, poly.polymul(top, poly.polyder(bottom)))
    slope = poly.polysub(poly.polymul(rise, bottom), fall).astype(float)
    # Solved as polynomials in 1 / s: their leading coefficient is then the constant 1, so
    # distortion coefficients that are zero do no harm.
    widest = max(_largest_root(poly.polyroots(each[::-1])) for each in (slope, bottom))
    return math.sqrt(1 / widest) if widest > 0 else math.inf


def _largest_root(roots: Array) -> float:
    """Return the largest positive root, 0 if there is none."""
    # A polynomial that only touches zero has a double root, which numerically is a pair with a
    # tiny imaginary part. This counts as a fold too.
    real = np.abs(roots.imag) <= 1e-6 * np.abs(roots)
    return float(np.max(roots.real[real], initial=0.0))


def _radial(k: tuple[float, ...], s: T) -> T:
    """Return the radial distortion factor at s = r^2."""
    k1, k2, _, _, k3, k4, k5, k6 = k
    top = 1 + s * (k1 + s * (k2 + s * k3 if k3 else k2))
    return top if k4 == k5 == k6 == 0 else top / (1 + s * (k4 + s * (k5 + s * k6)))


def _radial_slope(k: tuple[float, ...], s: T) -> T:
    """Return the derivative of the radial distortion factor by s = r^2."""
    k1, k2, _, _, k3, k4, k5, k6 = k
    top = k1 + s * (2 * k2 + s * (3 * k3))
    if k4 == k5 == k6 == 0:
        return top
    bottom = k4 + s * (2 * k5 + s * (3 * k6))
    return (top - _radial(k, s) * bottom) / (1 + s * (k4 + s * (k5 + s * k6)))


def _distort(k: tuple[float, ...], x: T, y: T) -> tuple[T, T]:
    """Distort points of the plane z = 1 (Ren et al. 2022, Eq. 25-26)."""
    p1, p2 = k[2:4]
    s = x * x
    s += y * y
    factor = _radial(k, s)
    factor += 2 * p1 * y
    factor += 2 * p2 * x
    u, v = x * factor, y * factor
    u += p2 * s
    v += p1 * s
    return u, v


def _newton_step(k: tuple[float, ...], x: T, y: T, xd: T, yd: T) -> tuple[T, T]:
    """Return the step to subtract from (x, y) so that it distorts to (xd, yd), to first order."""
    reached = _distort(k, x, y)
    ex, ey = reached[0] - xd, reached[1] - yd
    xx, xy, yy = _slopes(k, x, y)
    determinant = xx * yy - xy * xy
    return (yy * ex - xy * ey) / determinant, (xx * ey - xy * ex) / determinant


def _slopes(k: tuple[float, ...], x: T, y: T) -> tuple[T, T, T]:
    """Return the distortion's derivatives: dxd/dx, dxd/dy (which equals dyd/dx), dyd/dy."""
    p1, p2 = k[2:4]
    s = x * x + y * y
    factor, slope = _radial(k, s), _radial_slope(k, s)
    xx = factor + 2 * slope * x * x + 2 * p1 * y + 6 * p2 * x
    xy = 2 * (slope * x * y + p1 * x + p2 * y)
    yy = factor + 2 * slope * y * y + 6 * p1 * y + 2 * p2 * x
    return xx, xy, yy


def field_of_view(camera: Camera) -> tuple[float, float, float, float]:
    """Return left, right, top, bottom of a rectangle on the plane z = 1 that contains the image.

    A border of 8 px around the image is included. If the lens model does not reach all of the
    border, the rectangle is the square around the model's ``max_radius``.
    """
    share = np.linspace(0, 1, _EDGE_SAMPLES)
    low, high = np.zeros_like(share), np.ones_like(share)
    edges = np.array([[*share, *share, *low, *high], [*low, *high, *share, *share]]).T
    size = np.array([camera.width, camera.height]) + 2 * _BORDER_PX
    x, y, _ = camera.rays(edges * size - 0.5 - _BORDER_PX).T
    radius = camera.max_radius
    if np.isnan(x).any():
        return -radius, radius, -radius, radius
    return float(x.min()), float(x.max()), float(y.min()), float(y.max())


def _rings(radius: float) -> tuple[Array, Array]:
    """Return x and y (N,) of points on rings up to a radius on the plane z = 1."""
    ring, turn = np.meshgrid(np.linspace(0, radius, 33), np.linspace(0, 2 * np.pi, 33))
    return (ring * np.cos(turn)).ravel(), (ring * np.sin(turn)).ravel()


def largest_bend(camera: Camera, radius: float) -> float:
    """Return an upper bound of the second derivative of pixels along any line on the plane z = 1.

    It is the largest norm of all second derivatives (px), from differences on rings up to
    ``radius``.
    """
    x, y = _rings(radius)
    h = 1e-3

    def at(i: int, j: int) -> Array:
        return camera.pixels(x + i * h, y + j * h)

    xx = at(1, 0) - 2 * at(0, 0) + at(-1, 0)
    yy = at(0, 1) - 2 * at(0, 0) + at(0, -1)
    xy = (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / 4
    return float(np.sqrt((xx**2 + 2 * xy**2 + yy**2).sum(axis=0).max()) / (h * h))


def largest_scale(camera: Camera, radius: float) -> float:
    """Return an upper bound, up to ``radius``, of pixels per angle between two rays (px/rad)."""
    x, y = _rings(radius)
    gradient = np.stack(camera.slopes(x, y), axis=-1).reshape(-1, 2, 2)
    # At radius r a small angle spans at most 1 + r^2 times as much on the plane z = 1.
    scale = np.linalg.norm(gradient, ord=2, axis=(1, 2)) * (1 + x * x + y * y)
    return float(scale.max())
