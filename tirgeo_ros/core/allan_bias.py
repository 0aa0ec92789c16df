"""The filter's model of a bias, fitted to an Allan curve.

``error_state`` models a bias as a first-order Gauss-Markov process of standard deviation ``s`` and
correlation time ``T``, driven by ``s sqrt(2 / T)``. A sensor's bias is flicker noise and a random
walk rather, which no such process is; the nearest one is wanted at all averaging times alike, from
the shortest to a quarter of the record, so that no point weighs more than a fifth's error allows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.samples import Array

#: The process is told from none by so many standard deviations of its power.
_SEEN_SIGMA = 2.0
_MODEL = 0.2  # relative error of the model of variances
_TIMES = 200


class GaussMarkov(NamedTuple):
    """A first-order Gauss-Markov process; the unit is that of the record."""

    sigma: float
    time_s: float
    sigma_of_sigma: float
    time_factor: float  # the time is known to within this factor
    seen: bool  # False: ``sigma`` is an upper bound, at the longest time that a record tells of

    def variances(self, tau_s: Array) -> Array:
        """(k,) Allan variances."""
        return self.sigma**2 * gauss_markov(tau_s, self.time_s)


class _Trial(NamedTuple):
    time_s: float
    power: float
    sigma: float  # of the power
    cost: float


def gauss_markov(tau_s: Array, time_s: float) -> Array:
    """Allan variance of a first-order Gauss-Markov process of standard deviation 1.

    IEEE Std 952, annex C.1.5, with the driving noise ``sqrt(2 / time_s)`` of ``error_state``.
    """
    r = np.asarray(tau_s / time_s)
    decay = -np.expm1(-r)
    # 3 - 4 exp(-r) + exp(-2 r) = 2 r - (2 (r - decay) - decay^2) keeps its digits down to 1e-3.
    closed = 2 / r * (1 - (2 * decay + decay**2) / (2 * r))
    return np.where(r < 1e-3, 2 * r / 3, closed)


def fit_bias(
    tau_s: Array, variances: Array, model: Array, covariance: Array, used: slice
) -> GaussMarkov:
    """The process nearest to Allan variances (k,) that white noise has been taken out of.

    ``model`` (k,) and ``covariance`` (k, k) are of the whole variances, with the white noise.
    Correlation times reach from four of the shortest averaging time to four of the longest: the
    length of the record.
    """
    weights = 1 / (model[used] * np.sqrt(covariance.diagonal() / model**2 + _MODEL**2)[used])
    times_s = np.geomspace(4 * tau_s[0], 4 * tau_s[-1], _TIMES)
    part = covariance[used, used]
    trials = [
        _trial(float(t), gauss_markov(tau_s[used], float(t)), variances[used], weights, part)
        for t in times_s
    ]
    best = min(trials, key=lambda trial: trial.cost)
    if best.power <= _SEEN_SIGMA * best.sigma:
        last = trials[-1]
        bound = math.sqrt(last.power + _SEEN_SIGMA * last.sigma)
        return GaussMarkov(bound, last.time_s, last.sigma / (2 * bound), math.inf, seen=False)
    # A misfit of the model counts as the points' error.
    limit = best.cost + max(1.0, best.cost / len(weights))
    near = [trial.time_s for trial in trials if trial.cost <= limit]
    factor = max(near[-1] / best.time_s, best.time_s / near[0])
    sigma = math.sqrt(best.power)
    return GaussMarkov(sigma, best.time_s, best.sigma / (2 * sigma), factor, seen=True)


def _trial(time_s: float, shape: Array, values: Array, weights: Array, part: Array) -> _Trial:
    """The best process of one correlation time."""
    gain = weights**2 * shape / float((weights * shape) @ (weights * shape))
    power = max(float(gain @ values), 0.0)
    cost = float(((weights * (values - power * shape)) ** 2).sum())
    return _Trial(time_s, power, math.sqrt(float(gain @ part @ gain)), cost)
