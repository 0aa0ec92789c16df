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
"""Compute the Kalman update of an error state, with its gate; link changes of the covariance.

A smoother goes back through the changes, from each mark to the mark before it. If a late
measurement makes the filter compute again, new marks continue from the state that it goes back to,
and the replaced marks are discarded with their states.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array

#: Up to this sigma a float holds the probability of an exceedance to full precision.
_RAREST_SIGMA = 30.0


class Correction(NamedTuple):
    """Hold the measurement of a Kalman update (m rows)."""

    design: Array  # (m, n) H
    weight: Array  # (m, m) inverse of the innovation's covariance
    innovation: Array  # (m,)


class Change(NamedTuple):
    """Hold one change of the covariance of the error states.

    The error after the change is ``transition @ error`` plus noise (None: identity), or the
    update by ``correction``.
    """

    covariance: Array  # (n, n) after the change
    transition: Array | None = None  # (n, n)
    correction: Correction | None = None
    step_s: float = 0.0  # length of a propagation


@dataclass(slots=True, eq=False)
class Mark:
    """Hold a change, and the mark of the change before it."""

    change: Change
    before: Mark | None = None
    number: int = -1  # index in the flight record, once recorded


def cut(states: int, *blocks: slice) -> Array:
    """Return the transition (states, states) that discards the errors of some states."""
    transition = np.eye(states)
    for block in blocks:
        transition[block, :] = 0.0
    return transition


class Measurement(NamedTuple):
    """Hold a measurement as the filter needs it: ``innovation = design @ error + noise``."""

    innovation: Array  # (m,) measured minus predicted
    design: Array  # (m, n) H, for error states truth minus estimate
    noise: Array  # (m, m) R
    gate_sigma: float
    ease: float = 0.0  # see ``update``


class Update(NamedTuple):
    """Hold an update; its results are None if the gate refused it."""

    test_ratio: float
    error: Array | None  # (n,)
    covariance: Array | None  # (n, n)
    predicted: Array  # (m, m) H P H^T, covariance of the prediction
    correction: Correction | None = None


def update(covariance: Array, measurement: Measurement) -> Update:
    """Return the update of a covariance (n, n); refused if the test ratio is outside 0 to 1.

    A negative ratio or nan means that the noise is no covariance matrix. With the optimal gain
    Joseph's form is ``P - K H P``, made symmetric. ``ease`` k limits the correction to 1 / (k + 1)
    of the innovation: after the gate, k times the prediction's covariance is added to the noise.
    """
    innovation, design, noise = measurement.innovation, measurement.design, measurement.noise
    cross = covariance.dot(design.T)
    predicted = design.dot(cross)
    inverse = _inverse(predicted + noise)
    weighted = inverse.dot(innovation)
    limit = chi_square_limit(measurement.gate_sigma, len(innovation))
    ratio = float(innovation.dot(weighted)) / limit
    if not 0 <= ratio <= 1:
        return Update(ratio, None, None, predicted)
    if measurement.ease:
        noise = noise + measurement.ease * predicted
        inverse = _inverse(predicted + noise)
        weighted = inverse.dot(innovation)
    reduced = covariance - cross.dot(inverse).dot(cross.T)
    reduced += reduced.T.copy()
    reduced *= 0.5
    correction = Correction(design, inverse, innovation)
    return Update(ratio, cross.dot(weighted), reduced, predicted, correction)


def _inverse(spread: Array) -> Array:
    """Return the inverse of a symmetric matrix (m, m).

    Closed forms for m = 1 and 3 cost a tenth of the general one. A singular (3, 3) gives nan.
    """
    if len(spread) == 1:
        return np.asarray(1 / spread)
    if len(spread) != 3:
        return np.asarray(np.linalg.inv(spread), float)
    (a, b, c), (_, d, e), (_, _, f) = spread.tolist()
    x, y, z = d * f - e * e, c * e - b * f, b * e - c * d
    scale = a * x + b * y + c * z
    if scale == 0.0:
        return np.full((3, 3), math.nan)
    scale = 1 / scale
    x, y, z = x * scale, y * scale, z * scale
    p, q, r = (a * f - c * c) * scale, (b * c - a * e) * scale, (a * d - b * b) * scale
    return np.array(((x, y, z), (y, p, q), (z, q, r)))


@functools.lru_cache(maxsize=64)
def chi_square_limit(sigma: float, degrees: int) -> float:
    """Return the squared distance exceeded with the probability of ``sigma`` in one dimension.

    ``degrees`` (of freedom) is 1, 2 or 3; the survival functions are closed forms, inverted by
    bisection.
    """
    if sigma > _RAREST_SIGMA:  # beyond, the limit grows as sigma^2, except for a logarithm
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
