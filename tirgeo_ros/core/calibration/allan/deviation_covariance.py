"""Compute the covariance of Allan variances, also between averaging times.

The difference of two neighbouring averages is a second difference of the integrated signal ``x``.
For white noise, flicker noise and a random walk of the rate, the generalised autocovariance of
``x`` is

    white  -N^2 |t| / 2      flicker  B^2 t^2 ln|t| / (2 pi)      walk  K^2 |t|^3 / 12

The covariance of any two such differences is a sum of nine terms of it. Its square, summed over
the record, gives the covariance of two Allan variances of Gaussian noise. This is the method of
C. Greenhall and W. Riley, "Uncertainty of stability variances based on finite differences" (PTTI
2003), extended to the record's mixture of noises instead of one kind, and to pairs of averaging
times. Equivalent degrees of freedom are ``2 mean^2 / variance``.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.calibration.allan.deviation import AllanCurve
from tirgeo_ros.core.types.arrays import Array

#: Number of terms of the model: white noise, flicker noise, random walk.
TERMS = 3
_LAGS = 800  # of the sum over the record; more change variances by less than 1 %
_SIGNS = np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0]).ravel()  # of two second differences
_REACH = 3.0  # averaging times after which the covariance of flicker noise is negligible


def shapes(tau_s: Array, white: Array) -> Array:
    """Return (k, 3) Allan variances of the terms for ``N = B = K = 1`` (IEEE Std 952, annex C).

    ``white`` (k,) is that of white noise, ``1 / tau`` if no sample is missing.
    """
    flicker = np.full(len(tau_s), 2 * np.log(2) / np.pi)
    return np.stack([white, flicker, tau_s / 3], axis=1)


def products(curve: AllanCurve, step_s: float) -> Array:
    """Return (3, 3, k, k); the covariance of the variances is the sum of ``p_i p_j`` times it.

    ``p`` holds ``N^2, B^2, K^2``.
    """
    size = len(curve.slots)
    found = np.zeros((TERMS, TERMS, size, size))
    for b in range(size):
        for a in range(b + 1):
            found[:, :, a, b] = found[:, :, b, a] = _product(curve, step_s, a, b)
    return found


def covariance(powers: Array, made: Array) -> Array:
    """Return the covariance (k, k) of Allan variances of noise with ``powers`` (3,)."""
    return np.asarray(np.einsum("i,j,ijab->ab", powers, powers, made))


def _product(curve: AllanCurve, step_s: float, a: int, b: int) -> Array:
    """Return the products (3, 3) for averaging times ``a <= b``."""
    near, far = curve.slots[a] * step_s, curve.slots[b] * step_s
    lags_s, spacing_s = _lags(curve.strides[a] * step_s, near, far)
    lengths = curve.pairs[[a, b]] * curve.strides[[a, b]] * step_s
    # The share of all pairs of comparisons, one at a and one at b, that have each lag.
    shift = lags_s + far - near  # between the middles of the two spans
    both = np.clip(0.5 * lengths.sum() - np.abs(shift), 0, lengths.min())
    share = both * spacing_s / (lengths[0] * lengths[1])
    terms = _crossed(lags_s, near, far)
    # Each variance is half a mean square, and cov(u^2, v^2) = 2 cov(u, v)^2.
    return np.asarray(0.5 * np.einsum("il,jl,l->ij", terms, terms, share))


def _lags(stride_s: float, near: float, far: float) -> tuple[Array, float]:
    """Return the lags (l,) at which two differences are compared, and the spacing of the lags."""
    begin, end = -2 * far - _REACH * far, 2 * near + _REACH * far
    spacing_s = stride_s * max(1.0, np.ceil((end - begin) / stride_s / _LAGS))
    count_below, count_above = int(-begin / spacing_s), int(end / spacing_s)
    return np.arange(-count_below, count_above + 1) * spacing_s, spacing_s


def _crossed(lags_s: Array, near: float, far: float) -> Array:
    """Return (3, l) covariances of a difference over ``near`` with a later one over ``far``."""
    ends = (np.arange(3) * far - np.arange(3)[:, None] * near).reshape(-1, 1)
    # In units of ``far``, whose logarithm cancels in the second differences. The limit of
    # t^2 ln t at t = 0 is 0.
    t = np.maximum(np.abs(lags_s + ends) / far, 1e-9)
    square = t * t
    white, walk = _SIGNS @ t, _SIGNS @ (square * t)
    flicker = _SIGNS @ (square * np.log(t))
    return np.stack(
        [
            white * (-0.5 / near),
            flicker * (far / (2 * np.pi * near)),
            walk * (far**2 / (12 * near)),
        ]
    )
