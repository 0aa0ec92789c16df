"""Compute the errors of 90 % that video systems and TAK exchange: CE90 and LE90."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.types.arrays import Array

#: 90 % of a normal distribution lie within this many standard deviations.
_LINEAR_90 = 1.6448536269514722
#: 90 % of a circular normal distribution lie within this many standard deviations of an axis.
_CIRCULAR_90 = math.sqrt(-2 * math.log(0.1))
_ANGLES = (np.arange(32) + 0.5) * (math.pi / 64)
_NEWTON_STEPS = 6


def linear_error_90(covariance_n: Array) -> float:
    """Return LE90, m: a height is within plus or minus this of the true one with 90 %.

    ``covariance_n`` (3, 3) is that of a point, NED, m2.
    """
    return _LINEAR_90 * math.sqrt(covariance_n[2, 2])


def circular_error_90(covariance_n: Array) -> float:
    """Return CE90, m: the radius about a point that holds the true place with 90 %.

    ``covariance_n`` (3, 3) is that of the point, NED, m2. For semi-axes 1 and c of the ellipse of
    one sigma, the radius k solves 1 - mean(exp(-k^2 / 2 s^2)) = 0.9, with the mean over all
    directions t and s^2 = cos^2 t + c^2 sin^2 t. Newton's method, from c = 1.
    """
    minor, major = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance_n[:2, :2]), 0.0)).tolist()
    if not major > 0:
        return float(major)
    squares = np.cos(_ANGLES) ** 2 + (minor / major * np.sin(_ANGLES)) ** 2
    k = _CIRCULAR_90
    for _ in range(_NEWTON_STEPS):
        outside = np.exp(-(k**2) / (2 * squares))
        k += (float(outside.mean()) - 0.1) / (k * float((outside / squares).mean()))
    return float(major) * k
