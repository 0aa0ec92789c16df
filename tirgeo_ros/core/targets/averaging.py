"""Average positions whose errors are correlated, and test whether they agree.

Clicks of one flight share errors that no averaging removes: boresight, lens, height of the ground,
base station. Clicks of about the same moment share the filter's errors too. So the errors of
clicks i and j are taken to be correlated by

    r_ij = COMMON + (1 - COMMON) exp(-|t_i - t_j| / MEMORY_S),    r_ii = 1.

The mean is weighted by information, and clicks of one moment share one weight:

    W_i = S u_i Q_i^-1,    S = (sum_i u_i Q_i^-1)^-1,
    1 / u_i = sum_j exp(-|t_i - t_j| / MEMORY_S).

Q_i is P_i with no direction much surer than the others: two positions that are very sure in
slightly different directions would meet far from both. The best weights for r_ij would be
negative for a poor click beside a good one, so that all would depend on r_ij being right. The
covariance is that of this mean:

    P = sum_ij r_ij (W_i L_i) (W_j L_j)^T,    L_i the symmetric root of P_i.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array

#: Share of a click's variance that is common to all clicks of a flight. From 60 m up, seen 45 deg
#: down, the default sigmas of ground and lens give 0.11 m along the ray, the filter gives 0.1 m.
COMMON = 0.5
#: The filter's part: over simulated flights its error on the ground is correlated by 0.7 after
#: 8 s, 0.4 after 30 s and 0.2 after 60 s (``test/core/targets/test_filter_memory.py``).
MEMORY_S = 30.0
#: Clicks disagree where independent errors would differ so much once in a thousand times
#: (standard deviations of one tail).
_RARE_SIGMA = 3.09
#: The least standard deviation in Q_i, m, and as a share of the largest one.
_LEAST_M, _LEAST_SHARE = 0.01, 0.05


class Combined(NamedTuple):
    """Hold the average of some positions."""

    position: Array  # (3,) m
    covariance: Array  # (3, 3) m2
    test_ratio: float  # squared differences over their limit: above 1 the positions disagree


def combined(positions: Array, covariances: Array, times_s: Array) -> Combined:
    """Return the average of positions (n, 3), m, with covariances (n, 3, 3), m2, at times (n,).

    n is 2 or more. Where the positions disagree, their own scatter is added to the covariance.
    """
    values, vectors = np.linalg.eigh(covariances)  # ascending
    values = np.maximum(values, 0.0)
    least = np.maximum(_LEAST_M**2, _LEAST_SHARE**2 * values[:, 2:])

    def of_values(changed: Array) -> Array:
        return np.asarray((vectors * changed[:, None, :]) @ vectors.transpose(0, 2, 1))

    moment = np.exp(-np.abs(times_s[:, None] - times_s) / MEMORY_S)
    information = of_values(1 / np.maximum(values, least))
    weighted = information / moment.sum(axis=1)[:, None, None]
    weights = np.linalg.solve(weighted.sum(axis=0), weighted)
    # From the first one on, so that rounding is that of the differences.
    position = positions[0] + np.einsum("nij,nj->i", weights, positions - positions[0])
    parts = weights @ of_values(np.sqrt(values))
    shares = COMMON + (1 - COMMON) * moment
    covariance = np.einsum("nm,nij,mkj->ik", shares, parts, parts)
    off = positions - position
    squared = float(np.einsum("ni,nij,nj->", off, information, off))
    degrees = 3 * (len(positions) - 1)
    ratio = squared / _limit(degrees)
    if ratio > 1:
        covariance += off.T @ off / (len(off) - 1)
    return Combined(position, 0.5 * (covariance + covariance.T), ratio)


def _limit(degrees: int) -> float:
    """Return the chi-square that is exceeded rarely; Wilson and Hilferty, within 1 %."""
    spread = 2 / (9 * degrees)
    return degrees * (1 - spread + _RARE_SIGMA * math.sqrt(spread)) ** 3
