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
"""Compute the Allan curve of a record; fit noise terms and the filter's nearest bias model to it.

Overlapping variances at averaging times in octaves: an average over ``m`` slots is compared with
the average over the next ``m``, at every slot for ``m`` up to 4 and at every quarter of the
averaging time beyond. This uses nearly all the information of full overlap.

The curve is ``s^2(tau) = N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3``: white noise (angle or velocity
random walk), flicker noise (bias instability) and rate random walk. IEEE Std 952, annex C. The
floor of flicker noise is 0.664 B.

The squares of the terms enter linearly. So a fit is non-negative least squares of the relative
residuals ``s^2 / model - 1``, weighted by their degrees of freedom: the likelihood of chi-square
variables, without the downward bias of logarithms. The terms describe a sensor only to some per
cent, which limits the weight of a point. Neighbouring octaves share part of their data, and a
misfit beyond the expected scatter enlarges the standard deviations.

The filter models a bias as a first-order Gauss-Markov process of standard deviation ``s`` and
correlation time ``T``, driven by ``s sqrt(2 / T)``. No such process reproduces flicker noise and a
random walk; the nearest to the curve is used, with about equal weight at all averaging times.
If a process whose ``s`` is B is about as near, it is used instead, because B is the number in
data sheets and in other tools. For a bias that walks, or that is truly such a process, B alone
would be too small.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array

#: An average is used if at least this share of its samples is present.
_PRESENT = 0.75
#: Longer averages, relative to the record, have too few neighbours to be useful.
_LONGEST = 0.25

# Fits to the curve.
#: The floor of flicker noise of bias instability 1: sqrt(2 ln 2 / pi).
FLICKER_FLOOR = math.sqrt(2 * math.log(2) / math.pi)
_MODEL = 0.02  # relative error of the terms as a model of variances
_SHARED = 2.0  # by simulation: variances of the terms over those of independent octaves
_SIGMAS = 2.0  # from which a term or a bias is significant
_BARE_MISFIT = 0.06  # relative misfit at which a variance at the shortest times is not explained
_REACH = 2  # octaves left out beyond the first that fits: an unexplained effect decays slowly
_STEPS = 12
_FEWEST = 5  # points that a fit must keep
_LEAST_DEGREES = 10.0  # degrees of freedom that the curve's minimum must have
_BIAS_MODEL = 0.2  # relative error of a Gauss-Markov process as a model of variances
#: A sum of squared misfits within this factor of the least is about as near. For pure flicker
#: noise s = 1.25 B fits best, and B gives 1.3 to 2.5 times the sum; for a process or a walk, B
#: gives 6 to 200 times the sum.
_AS_NEAR = 3.0
_TIMES = 200  # correlation times that are tried


class AllanCurve(NamedTuple):
    """Hold overlapping Allan variances over increasing averaging times."""

    tau_s: Array  # (k,) averaging times
    degrees: Array  # (k,) equivalent degrees of freedom
    white: Array  # (k,) variances of white noise with N = 1: mean of 1 / (sampled time), 1/s
    variances: Array  # (k, channels)
    span_s: float  # length of the longest comparison of averages


def allan_curve(runs: Sequence[Array], step_s: float, ramps: Array | None = None) -> AllanCurve:
    """Return the curve of runs (n, channels), NaN where a sample is missing.

    No comparison crosses a break. ``ramps`` (channels,), unit/s, are steady drifts to remove. The
    degrees of freedom are those of flicker noise (Lesage and Audoin, NIST SP 1065, table 5), which
    are between those of white noise and of a random walk.
    """
    longest = max(map(len, runs))
    sizes = [1 << level for level in range(longest.bit_length()) if 2 << level <= longest]
    slopes = np.zeros(runs[0].shape[1]) if ramps is None else ramps * step_s
    counts = [_total(np.isfinite(run[:, 0])) for run in runs]
    sums = np.zeros((len(sizes), len(slopes), 3))
    for channel, slope in enumerate(slopes.tolist()):
        # Subtract a common value, which cancels in the differences: sums of gravity lose digits.
        level = np.nanmean(runs[0][:, channel])
        for run, count in zip(runs, counts, strict=True):
            values = run[:, channel] - level
            values -= slope * np.arange(len(run))
            total = _total(np.nan_to_num(values, copy=False))
            sums[:, channel] += [_compared(total, count, size) for size in sizes]
    has_pairs = sums[:, 0, 0] > 0
    m, pairs = np.array(sizes, float)[has_pairs], sums[has_pairs, 0, 0]
    spans = (pairs - 1) * np.maximum(m // 4, 1) + 2 * m
    used = m <= _LONGEST * spans
    degrees = np.maximum(1.25 * spans**2 / (m * (spans + 3 * m)), 1.0)
    means = sums[has_pairs] / pairs[:, None, None]
    return AllanCurve(
        tau_s=(m * step_s)[used],
        degrees=degrees[used],
        white=means[used, 0, 1] / step_s,
        variances=means[used, :, 2] / 2,
        span_s=float(spans.max(initial=0.0)) * step_s,
    )


def _total(values: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(values)])


def _compared(sums: Array, counts: Array, m: int) -> tuple[int, float, float]:
    """Return the number of pairs of averages, the sums of 1 / count and of squared steps."""
    stride = max(m // 4, 1)
    stops = max(len(sums) - 2 * m, 0), max(len(sums) - m, 0), len(sums)
    ends = [slice(i * m, stop, stride) for i, stop in enumerate(stops)]
    first, second = (counts[ends[i + 1]] - counts[ends[i]] for i in (0, 1))
    enough = np.minimum(first, second) >= _PRESENT * m
    first, second = first[enough], second[enough]
    before, after = ((sums[ends[i + 1]] - sums[ends[i]])[enough] for i in (0, 1))
    steps = after / second - before / first
    return len(steps), float(0.5 * (1 / first + 1 / second).sum()), float(steps @ steps)


class Term(NamedTuple):
    """Hold a noise term: ``value`` is None if not significant: then it is below ``upper``."""

    value: float | None
    sigma: float
    upper: float  # two standard deviations above


class GaussMarkov(NamedTuple):
    """Hold a first-order Gauss-Markov process, in the unit of the record."""

    sigma: float
    time_s: float
    observed: bool  # False: ``sigma`` is an upper bound, at the longest time of the record


class NoiseFit(NamedTuple):
    """Hold the noise of one axis; terms are in the units of the record and seconds."""

    white: Term  # N, unit sqrt(s)
    flicker: Term  # B, unit: the floor divided by 0.664
    walk: Term  # K, unit / sqrt(s)
    minimum: float  # of the measured Allan deviation
    minimum_at_s: float
    bias: GaussMarkov
    shortest_s: float  # shorter averaging times fit no term and were left out
    misfit: float  # rms of the weighted residuals, about 1 or less
    variances: Array  # (k,) as measured
    model: Array  # (k,) fitted variances
    bias_model: Array  # (k,) variances of the filter's model


def fit_noise(curve: AllanCurve, channel: int) -> NoiseFit:
    """Return the fit of one channel."""
    tau_s, variances = curve.tau_s, curve.variances[:, channel]
    floor = np.full(len(tau_s), FLICKER_FLOOR**2)
    columns = np.stack([curve.white, floor, tau_s / 3], axis=1)
    start, powers = _explained(columns, variances, curve.degrees)
    model, used = columns @ powers, slice(start, None)
    white = powers[0] * curve.white
    # The lowest point among those with enough degrees of freedom.
    at = int(np.argmin(np.where(curve.degrees >= _LEAST_DEGREES, variances, np.inf)))
    part = columns[used], variances[used], curve.degrees[used]
    (random_walk, flicker, walk), misfit = _terms(*part, powers)
    spread = np.sqrt(2 / curve.degrees) * model
    bias = _fit_bias(tau_s[used], (variances - white)[used], model[used], spread[used], flicker)
    return NoiseFit(
        white=random_walk,
        flicker=flicker,
        walk=walk,
        minimum=math.sqrt(variances[at]),
        minimum_at_s=float(tau_s[at]),
        bias=bias,
        shortest_s=float(tau_s[start]),
        misfit=misfit,
        variances=variances,
        model=model,
        bias_model=white + bias.sigma**2 * gauss_markov(tau_s, bias.time_s),
    )


def gauss_markov(tau_s: Array, time_s: float | Array) -> Array:
    """Return the Allan variance of a first-order Gauss-Markov process of standard deviation 1.

    IEEE Std 952, annex C.1.5, with the driving noise ``sqrt(2 / time_s)`` of ``propagation``.
    """
    r = np.asarray(tau_s / time_s)
    decay = -np.expm1(-r)
    # 3 - 4 exp(-r) + exp(-2 r) = 2 decay + decay^2, which is accurate down to r = 1e-3.
    closed = 2 / r * (1 - (2 * decay + decay**2) / (2 * r))
    return np.where(r < 1e-3, 2 * r / 3, closed)


def _explained(columns: Array, variances: Array, degrees: Array) -> tuple[int, Array]:
    """Return the index of the first point that the terms explain, and their squares (3,).

    A sensor's low-pass filter lowers the variances at the shortest times, and vibration or coarse
    readings raise them. Such points are left out one by one.
    """
    last = max(len(variances) - _FEWEST, 0)
    for start in range(last + 1):
        powers = _weighted(columns[start:], variances[start:], degrees[start:])
        if abs(variances[start] / (columns[start] @ powers) - 1) < _BARE_MISFIT:
            break
    if start:
        start = min(start + _REACH, last)
        powers = _weighted(columns[start:], variances[start:], degrees[start:])
    return start, powers


def _weighted(columns: Array, variances: Array, degrees: Array) -> Array:
    """Return the squares (p,) of the terms with these columns (k, p)."""
    from scipy.optimize import nnls  # noqa: PLC0415  slow to import

    model = variances
    for _ in range(_STEPS):
        weights = _weights(model, degrees)
        weighted = columns * weights[:, None]
        scale = np.linalg.norm(weighted, axis=0)
        powers = np.asarray(nnls(weighted / scale, variances * weights)[0] / scale)
        model = np.maximum(columns @ powers, 1e-9 * variances)
    return powers


def _weights(model: Array, degrees: Array) -> Array:
    return np.asarray(1 / (model * np.sqrt(2 / degrees + _MODEL**2)))


def _terms(
    columns: Array, variances: Array, degrees: Array, powers: Array
) -> tuple[list[Term], float]:
    """Return the terms whose squares are ``powers`` (3,), and the misfit.

    A term is significant if the deviance of chi-square variables grows enough without it.
    """

    def deviance(model: Array) -> float:
        ratio = variances / model
        return float((2 * (ratio - 1 - np.log(ratio)) / (2 / degrees + _MODEL**2)).sum())

    model = columns @ powers
    weights = _weights(model, degrees)
    misfit = math.sqrt(float(np.mean((weights * (variances - model)) ** 2)))
    weighted = columns * weights[:, None]
    scale = np.linalg.norm(weighted, axis=0)
    inverse = np.linalg.pinv((weighted / scale).T @ (weighted / scale), hermitian=True)
    sigmas = np.sqrt(_SHARED * np.diag(inverse)) / scale * max(misfit, 1.0)
    least = deviance(model) + _SIGMAS**2 * _SHARED * max(misfit, 1.0) ** 2
    terms = []
    for k, (power, sigma) in enumerate(zip(powers.tolist(), sigmas.tolist(), strict=True)):
        others = np.delete(columns, k, axis=1)
        without = np.maximum(others @ _weighted(others, variances, degrees), 1e-9 * variances)
        shown = power > 0 and deviance(without) > least
        value = math.sqrt(power) if shown else None
        own_sigma = sigma / (2 * math.sqrt(power)) if shown else math.nan
        terms.append(Term(value, own_sigma, math.sqrt(power + 2 * sigma)))
    return terms, misfit


def _fit_bias(
    tau_s: Array, variances: Array, model: Array, spread: Array, flicker: Term
) -> GaussMarkov:
    """Return the process nearest to Allan variances (k,) from which white noise is subtracted.

    ``model`` (k,) and ``spread`` (k,), its sigma, are of the complete variances. Correlation times
    are tried from four times the shortest averaging time to four times the longest, which is the
    record's length.
    """
    weights = 1 / np.hypot(spread, _BIAS_MODEL * model)
    times_s = np.geomspace(4 * tau_s[0], 4 * tau_s[-1], _TIMES)
    shapes = weights * gauss_markov(tau_s, times_s[:, None])  # (times, k)
    gains = shapes / (shapes**2).sum(axis=1, keepdims=True)
    powers = np.maximum(gains @ (weights * variances), 0.0)
    sigmas = np.sqrt(_SHARED * ((gains * weights * spread) ** 2).sum(axis=1))

    def costs(tried: Array) -> Array:
        return np.asarray(((weights * variances - tried[:, None] * shapes) ** 2).sum(axis=1))

    cost = costs(powers)
    best = int(np.argmin(cost))
    if powers[best] <= _SIGMAS * sigmas[best]:
        bound = math.sqrt(powers[-1] + _SIGMAS * sigmas[-1])
        return GaussMarkov(bound, float(times_s[-1]), observed=False)
    if flicker.value is not None:
        of_flicker = costs(np.full(_TIMES, flicker.value**2))
        if of_flicker.min() <= _AS_NEAR * cost[best]:
            time_s = float(times_s[np.argmin(of_flicker)])
            return GaussMarkov(flicker.value, time_s, observed=True)
    return GaussMarkov(math.sqrt(powers[best]), float(times_s[best]), observed=True)
