"""Compute a camera's field of view and upper bounds of its lens's curvature and scale."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Array

#: Lines are clipped this far outside the image, so that their cut ends are not visible.
_BORDER_PX = 8.0
_EDGE_SAMPLES = 33


def field_of_view(camera: Camera) -> tuple[float, float, float, float]:
    """Return left, right, top, bottom of a rectangle on the plane z = 1 that holds the image.

    The image is taken with a border of 8 px. If the lens model does not reach all of the border,
    the rectangle is the square around the model's ``max_radius``.
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
