"""The filter's model of a bias, fitted to an Allan curve.

``error_state`` models a bias as a first-order Gauss-Markov process of standard deviation ``s`` and
correlation time ``T``, driven by ``s sqrt(2 / T)``. A sensor's bias is flicker noise and a random
walk rather, which no such process is; the nearest one is wanted at all averaging times alike, from
the shortest to a quarter of the record, so that no point weighs more than a fifth's error allows.

Where a process with the bias instability B for its ``s`` is about as near, it is taken: B is what
data sheets and other tools call so. Flicker noise is then modelled by B and the best time. Of a
bias that walks, or truly is such a process, B alone would say too little.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array

#: The process is told from none by so many standard deviations of its power.
_SEEN_SIGMA = 2.0
_MODEL = 0.2  # relative error of the model of variances
#: So many times the least sum of squared misfits is about as near. Pure flicker noise is fitted by
#: s = 1.25 B best, and by B with 1.3 to 2.5 times the sum; a process or a walk by B with 6 to 200.
_AS_NEAR = 3.0
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


class Instability(NamedTuple):
    """B and its standard deviation, in the unit of the record."""

    value: float
    sigma: float


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
    tau_s: Array,
    variances: Array,
    model: Array,
    covariance: Array,
    used: slice,
    instability: Instability | None = None,
) -> GaussMarkov:
    """The process nearest to Allan variances (k,) that white noise has been taken out of.

    ``model`` (k,) and ``covariance`` (k, k) are of the whole variances, with the white noise;
    ``instability`` is B where it is told from none: the standard deviation, if a process of it is
    about as near. Correlation times reach from four of the shortest averaging time to four of the
    longest: the length of the record.
    """
    weights = 1 / (model[used] * np.sqrt(covariance.diagonal() / model**2 + _MODEL**2)[used])
    times_s = np.geomspace(4 * tau_s[0], 4 * tau_s[-1], _TIMES)
    part, values = covariance[used, used], variances[used]
    shapes = [gauss_markov(tau_s[used], float(t)) for t in times_s]
    trials = [
        _trial(float(t), shape, values, weights, part)
        for t, shape in zip(times_s, shapes, strict=True)
    ]
    best = min(trials, key=lambda trial: trial.cost)
    if best.power <= _SEEN_SIGMA * best.sigma:
        last = trials[-1]
        bound = math.sqrt(last.power + _SEEN_SIGMA * last.sigma)
        return GaussMarkov(bound, last.time_s, last.sigma / (2 * bound), math.inf, seen=False)
    sigma = Instability(math.sqrt(best.power), best.sigma / (2 * math.sqrt(best.power)))
    if instability is not None:
        power = instability.value**2
        told = [
            one._replace(power=power, cost=_cost(weights * (values - power * shape)))
            for one, shape in zip(trials, shapes, strict=True)
        ]
        nearest = min(told, key=lambda trial: trial.cost)
        if nearest.cost <= _AS_NEAR * best.cost:
            trials, best, sigma = told, nearest, instability
    factor = _time_factor(trials, best, len(weights))
    return GaussMarkov(sigma.value, best.time_s, sigma.sigma, factor, seen=True)


def _time_factor(trials: list[_Trial], best: _Trial, points: int) -> float:
    """Within which factor the time is known: a misfit of the model counts as the points' error."""
    limit = best.cost + max(1.0, best.cost / points)
    near = [trial.time_s for trial in trials if trial.cost <= limit]
    return max(near[-1] / best.time_s, best.time_s / near[0])


def _trial(time_s: float, shape: Array, values: Array, weights: Array, part: Array) -> _Trial:
    """The best process of one correlation time."""
    gain = weights**2 * shape / float((weights * shape) @ (weights * shape))
    power = max(float(gain @ values), 0.0)
    spread = math.sqrt(float(gain @ part @ gain))
    return _Trial(time_s, power, spread, _cost(weights * (values - power * shape)))


def _cost(residuals: Array) -> float:
    return float(residuals @ residuals)
