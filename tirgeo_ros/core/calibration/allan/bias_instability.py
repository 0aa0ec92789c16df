"""Fit the filter's bias model, a Gauss-Markov process, to an Allan curve.

``ins_error_model`` models a bias as a first-order Gauss-Markov process of standard deviation ``s``
and correlation time ``T``, driven by ``s sqrt(2 / T)``. A sensor's bias is rather flicker noise
and a random walk, which no such process reproduces. The process nearest to the curve is wanted,
with equal weight at all averaging times from the shortest to a quarter of the record. So each
point is given a relative error of at least a fifth.

If a process whose ``s`` is the bias instability B is about as near, it is taken, because B is the
number in data sheets and in other tools. Flicker noise is then modelled by B and the best time.
For a bias that walks, or that is truly such a process, B alone would be too small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array

#: The process is significant beyond this many standard deviations of its power.
_SEEN_SIGMA = 2.0
_MODEL = 0.2  # relative error of the model of variances
#: A sum of squared misfits within this factor of the least is about as near. For pure flicker
#: noise s = 1.25 B fits best, and B gives 1.3 to 2.5 times the sum; for a process or a walk, B
#: gives 6 to 200 times the sum.
_AS_NEAR = 3.0
_TIMES = 200  # correlation times that are tried


class Term(NamedTuple):
    """Hold a noise term: ``value`` is None if it is not significant, and then below ``upper``."""

    value: float | None
    sigma: float
    upper: float  # two standard deviations above


class GaussMarkov(NamedTuple):
    """Hold a first-order Gauss-Markov process, in the unit of the record."""

    sigma: float
    time_s: float
    sigma_of_sigma: float
    time_factor: float  # the time is known to within this factor
    seen: bool  # False: ``sigma`` is an upper bound, at the longest time that the record shows

    def variances(self, tau_s: Array) -> Array:
        """Return the Allan variances (k,)."""
        return self.sigma**2 * gauss_markov(tau_s, self.time_s)


def gauss_markov(tau_s: Array, time_s: float | Array) -> Array:
    """Return the Allan variance of a first-order Gauss-Markov process of standard deviation 1.

    IEEE Std 952, annex C.1.5, with the driving noise ``sqrt(2 / time_s)`` of ``ins_error_model``.
    """
    r = np.asarray(tau_s / time_s)
    decay = -np.expm1(-r)
    # 3 - 4 exp(-r) + exp(-2 r) = 2 decay + decay^2, which is accurate down to r = 1e-3.
    closed = 2 / r * (1 - (2 * decay + decay**2) / (2 * r))
    return np.where(r < 1e-3, 2 * r / 3, closed)


def fit_bias(
    tau_s: Array,
    variances: Array,
    model: Array,
    covariance: Array,
    used: slice,
    flicker: Term,
) -> GaussMarkov:
    """Return the process nearest to Allan variances (k,) from which white noise is subtracted.

    ``model`` (k,) and ``covariance`` (k, k) are of the complete variances, with the white noise.
    ``flicker`` is B; if it is significant, it becomes the standard deviation if a process with it
    is about as near. Correlation times are tried from four times the shortest averaging time
    to four times the longest, which is the record's length.
    """
    weights = 1 / (model[used] * np.sqrt(covariance.diagonal() / model**2 + _MODEL**2)[used])
    times_s = np.geomspace(4 * tau_s[0], 4 * tau_s[-1], _TIMES)
    shapes = gauss_markov(tau_s[used], times_s[:, None])  # (times, k)
    values, weighted = variances[used], weights * shapes
    gains = weights * weighted / (weighted**2).sum(axis=1, keepdims=True)
    powers = np.maximum(gains @ values, 0.0)
    sigmas = np.sqrt(((gains @ covariance[used, used]) * gains).sum(axis=1))

    def costs(tried: Array) -> Array:
        return np.asarray(((weights * (values - tried[:, None] * shapes)) ** 2).sum(axis=1))

    cost = costs(powers)
    best = int(np.argmin(cost))
    if powers[best] <= _SEEN_SIGMA * sigmas[best]:
        bound = math.sqrt(powers[-1] + _SEEN_SIGMA * sigmas[-1])
        return GaussMarkov(
            bound, float(times_s[-1]), sigmas[-1] / (2 * bound), math.inf, seen=False
        )
    sigma = math.sqrt(powers[best])
    spread = float(sigmas[best]) / (2 * sigma)
    if flicker.value is not None:
        constrained = costs(np.full(_TIMES, flicker.value**2))
        if constrained.min() <= _AS_NEAR * cost[best]:
            cost, best = constrained, int(np.argmin(constrained))
            sigma, spread = flicker.value, flicker.sigma
    # A misfit of the model counts as error of the time.
    near = times_s[cost <= cost[best] + max(1.0, cost[best] / len(weights))]
    factor = float(max(near[-1] / times_s[best], times_s[best] / near[0]))
    return GaussMarkov(sigma, float(times_s[best]), spread, factor, seen=True)
