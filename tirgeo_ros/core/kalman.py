"""The Kalman update of an error state, with its gate."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.samples import Array

#: Up to here a float holds the probability of an excess to all its digits.
_RAREST_SIGMA = 30.0


@dataclass(frozen=True, slots=True)
class Measurement:
    """A measurement as the filter sees it: ``innovation = design @ error + noise``."""

    innovation: Array  # (m,) measured minus predicted
    design: Array  # (m, 15) H, for error states truth minus estimate
    noise: Array  # (m, m) R
    gate_sigma: float


@dataclass(frozen=True, slots=True)
class Update:
    """What an update gives; ``error`` and ``covariance`` are None where the gate refused."""

    test_ratio: float
    error: Array | None  # (15,)
    covariance: Array | None  # (15, 15)


def update(covariance: Array, measurement: Measurement) -> Update:
    """One update in Joseph's form; refused where the test ratio is not in 0 to 1.

    A ratio that is negative or not a number comes of a noise that is no covariance.
    """
    design, noise = measurement.design, measurement.noise
    cross = np.dot(covariance, design.T)
    spread = np.dot(design, cross) + noise
    inverse = 1 / spread if len(spread) == 1 else np.linalg.inv(spread)
    weighted = np.dot(inverse, measurement.innovation)
    distance = float(np.dot(measurement.innovation, weighted))
    ratio = distance / chi_square_limit(measurement.gate_sigma, len(measurement.innovation))
    if not 0 <= ratio <= 1:
        return Update(ratio, None, None)
    gain = np.dot(cross, inverse)
    keep = np.eye(len(covariance)) - np.dot(gain, design)
    joseph = np.dot(np.dot(keep, covariance), keep.T) + np.dot(np.dot(gain, noise), gain.T)
    return Update(ratio, np.dot(cross, weighted), 0.5 * (joseph + joseph.T))


@functools.lru_cache(maxsize=64)
def chi_square_limit(sigma: float, degrees: int) -> float:
    """The squared distance that is exceeded as rarely as ``sigma`` in one dimension.

    ``degrees`` is 1, 2 or 3; the survival functions are closed forms, inverted by bisection.
    """
    if sigma > _RAREST_SIGMA:  # beyond, the limit grows as the square but for a logarithm
        rarest = chi_square_limit(_RAREST_SIGMA, degrees)
        return rarest + sigma * sigma - _RAREST_SIGMA * _RAREST_SIGMA
    wanted = math.erfc(sigma / math.sqrt(2))
    low, high = 0.0, (sigma + 4) ** 2
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _survival(middle, degrees) > wanted else (low, middle)
    return 0.5 * (low + high)


def _survival(squared: float, degrees: int) -> float:
    if degrees == 2:
        return math.exp(-squared / 2)
    tail = math.erfc(math.sqrt(squared / 2))
    if degrees == 1:
        return tail
    return tail + math.sqrt(2 * squared / math.pi) * math.exp(-squared / 2)
