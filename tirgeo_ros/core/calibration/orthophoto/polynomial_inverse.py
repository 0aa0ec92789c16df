"""Convert places on the ground plane back to pixels of an orthophoto."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.calibration.orthophoto.polynomial_transform import PolynomialTransform
from tirgeo_ros.core.types.arrays import Array

_STEPS = 12
_CLOSE_PX = 1e-3


def pixels_of(found: PolynomialTransform, plane: Array) -> Array:
    """Return (n, 2) column, row of metres (n, 2) by Newton's method; nan without convergence."""
    middle = found.pixels.middle[None]
    start = np.linalg.solve(found.jacobian(middle)[0], (plane - found(middle)).T).T
    pixels = middle + start
    for _ in range(_STEPS):
        with np.errstate(all="ignore"):  # divergence is detected by the last step
            step = _step(found, pixels, plane)
            pixels = pixels + step
    far = ~(np.hypot(*step.T) < _CLOSE_PX)
    return np.asarray(np.where(far[:, None], np.nan, pixels))


def _step(found: PolynomialTransform, pixels: Array, plane: Array) -> Array:
    miss = plane - found(pixels)
    (a, b), (c, d) = np.moveaxis(found.jacobian(pixels), 0, -1)
    x, y = miss.T
    return np.asarray(np.stack([d * x - b * y, a * y - c * x], axis=1) / (a * d - b * c)[:, None])
