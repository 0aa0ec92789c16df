"""Noise terms from an Allan curve, and the noise model of the filter that comes nearest to it.

The curve is ``s^2(tau) = N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3 + 3 Q^2/tau^2``: white noise (angle
or velocity random walk), flicker noise (bias instability), rate random walk, and quantisation
where the curve shows it. IEEE Std 952, annex C. The floor of flicker noise is 0.664 B.

Squares of the terms enter linearly, so that a fit is non-negative least squares of the relative
residuals ``s^2 / model - 1``, weighted by the degrees of freedom for the model of the step before:
the likelihood of chi-square variables, without the downward pull that logarithms of few degrees of
freedom have. No term describes a sensor to better than some per cent, so that no point weighs
more than that allows. Standard deviations come from the whole covariance of the curve, for
neighbouring averaging times share their data; a misfit beyond it enlarges them.
"""

from __future__ import annotations

import itertools
import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.allan.bias_instability import GaussMarkov, Instability, fit_bias
from tirgeo_ros.core.calibration.allan.deviation import AllanCurve
from tirgeo_ros.core.calibration.allan.deviation_covariance import covariance, products, shapes
from tirgeo_ros.core.types.arrays import Array

#: The floor of flicker noise of bias instability 1: sqrt(2 ln 2 / pi).
FLICKER_FLOOR = math.sqrt(2 * math.log(2) / math.pi)
#: A term is told from none by so many standard deviations of its square.
_SEEN_SIGMA = 2.0
#: Averages of more than this part of the record have too few neighbours to say anything.
_LONGEST = 0.25
_MODEL = 0.02  # relative error of the terms as a model of variances
_BARE_MISFIT = 0.06  # of variances at the shortest times that no term explains
_REACH = 4.0  # times as long as the first time that fits: what does not fit dies away slowly
_STEPS = 8
_FEWEST = 8  # points that a fit keeps
_LEAST_DEGREES = 10.0  # degrees of freedom of a point that can be the minimum


class Term(NamedTuple):
    """A noise term: ``value`` is None where it is not told from none, and then below ``upper``."""

    value: float | None
    sigma: float
    upper: float  # two standard deviations up


class NoiseFit(NamedTuple):
    """The noise of one axis; terms in the units of the record and seconds."""

    white: Term  # N, unit sqrt(s)
    flicker: Term  # B, unit: the floor over 0.664
    walk: Term  # K, unit / sqrt(s)
    quantisation: Term  # Q, unit s
    minimum: float  # of the measured deviation
    minimum_sigma: float
    minimum_at_s: float
    minimum_reached: bool  # False: the curve is white noise as far as the record goes
    bias: GaussMarkov
    shortest_s: float  # averaging times below fit no term and were left out
    misfit: float  # root of the mean square of weighted residuals, about 1 or less
    degrees: Array  # (k,) equivalent degrees of freedom
    variances: Array  # (k,) as measured, without the drift
    model: Array  # (k,) fitted variances
    bias_model: Array  # (k,) variances of the filter's model


class AllanAnalysis:
    """What all axes of a record share: averaging times and their covariance."""

    def __init__(self, curve: AllanCurve, step_s: float) -> None:
        spans = (curve.pairs - 1) * curve.strides + 2 * curve.slots
        used = curve.slots <= _LONGEST * spans
        self.curve = AllanCurve(*(column[used] for column in curve))
        self.tau_s = self.curve.slots * step_s
        self.span_s = float(spans.max()) * step_s
        self._columns = shapes(self.tau_s, self.curve.inverse_counts / step_s)
        self._products = products(self.curve, step_s)

    def fit(self, channel: int, ramp: float = 0.0) -> NoiseFit:
        """Of one channel; a steady drift of ``ramp`` (unit/s) is taken out of its curve."""
        variances = self._without_ramp(channel, ramp)
        columns = np.column_stack([self._columns, 3 / self.tau_s**2])
        start, powers = self._powers(variances, columns)
        model = columns @ powers
        spread = covariance(powers[:3], self._products)
        degrees = 2 * (columns[:, :3] @ powers[:3]) ** 2 / spread.diagonal()
        sigmas, misfit = _sigmas(variances, columns, model, spread, start)
        without = self._without(variances, columns, powers, start)
        white = powers[0] * columns[:, 0]
        at = _minimum(variances, degrees)
        lowest = math.sqrt(variances[at])
        sigmas *= max(misfit, 1.0)
        terms = [
            _term(*one)
            for one in zip(*(part.tolist() for part in (powers, sigmas, without)), strict=True)
        ]
        flicker, part = terms[1], slice(start, None)
        told = None if flicker.value is None else Instability(flicker.value, flicker.sigma)
        bias = fit_bias(self.tau_s, variances - white, model, spread, part, told)
        return NoiseFit(
            white=terms[0],
            flicker=flicker,
            walk=terms[2],
            quantisation=terms[3],
            minimum=lowest,
            minimum_sigma=lowest / math.sqrt(2 * degrees[at]),
            minimum_at_s=float(self.tau_s[at]),
            minimum_reached=any(term.value is not None for term in terms[1:3]),
            bias=bias,
            shortest_s=float(self.tau_s[start]),
            misfit=misfit,
            degrees=degrees,
            variances=variances,
            model=model,
            bias_model=white + bias.variances(self.tau_s),
        )

    def _without_ramp(self, channel: int, ramp: float) -> Array:
        """Variances of the record less a steady drift: that of each difference is ``ramp tau``."""
        rise = ramp * self.tau_s
        measured = self.curve.variances[:, channel]
        return np.asarray(measured - rise * self.curve.steps[:, channel] + 0.5 * rise**2)

    def _powers(self, variances: Array, columns: Array) -> tuple[int, Array]:
        """Index of the first point that the terms explain, and squares of the terms (4,).

        A sensor's own low-pass filter holds the shortest times down and vibration lifts them:
        they are left out one by one.
        """
        plain, start = columns.copy(), 0
        plain[:, 3] = 0.0
        while True:
            powers = self._weighted(variances, plain, start)
            residuals = variances / (plain @ powers) - 1
            if _explained(residuals[start:]) or start + _FEWEST >= len(variances):
                break
            start += 1
        if start:  # quantisation is a reason too, where it takes all of it away
            with_steps = self._weighted(variances, columns, 0)
            if _explained(variances / (columns @ with_steps) - 1):
                return 0, with_steps
            reach = self.tau_s >= _REACH * self.tau_s[start]
            start = min(int(np.argmax(reach)) if reach.any() else start, len(variances) - _FEWEST)
            powers = self._weighted(variances, plain, start)
        return start, powers

    def _without(self, variances: Array, columns: Array, powers: Array, start: int) -> Array:
        """(4,) what each squared term would scatter by if it were not there.

        That, not its scatter where it is there, tells whether it is seen: long averaging times
        have few degrees of freedom, but a curve far above the other terms is no chance.
        """
        found = np.zeros(len(powers))
        for term in np.flatnonzero(powers):
            rest = columns.copy()
            rest[:, term] = 0.0
            others = self._weighted(variances, rest, start)
            spread = covariance(others[:3], self._products)
            model = np.maximum(rest @ others, 1e-9 * variances)
            found[term] = _sigmas(variances, columns, model, spread, start)[0][term]
        return found

    def _weighted(self, variances: Array, columns: Array, start: int) -> Array:
        """Squares of the terms from the points from ``start`` on."""
        model = variances
        degrees = self.span_s / self.tau_s  # of averages side by side, to begin with
        for _ in range(_STEPS):
            weights = _weights(model, degrees)[start:]
            powers = non_negative(columns[start:] * weights[:, None], variances[start:] * weights)
            noise = columns[:, :3] @ powers[:3]
            model = np.maximum(columns @ powers, 1e-9 * variances)
            spread = covariance(powers[:3], self._products).diagonal()
            floor = np.maximum(spread, 1e-30 * noise**2)
            degrees = np.divide(2 * noise**2, floor, out=degrees.copy(), where=noise > 0)
        return powers


def non_negative(columns: Array, values: Array) -> Array:
    """Least squares (n, k), (n,) with no coefficient below zero: the best of all subsets."""
    size = columns.shape[1]
    best, best_cost = np.zeros(size), float(values @ values)
    scale = np.linalg.norm(columns, axis=0)
    usable = [k for k in range(size) if scale[k] > 0]
    for count in range(1, len(usable) + 1):
        for chosen in map(list, itertools.combinations(usable, count)):
            part = columns[:, chosen] / scale[chosen]
            solved = np.linalg.lstsq(part, values, rcond=None)[0]
            cost = float(((part @ solved - values) ** 2).sum())
            if (solved >= 0).all() and cost < best_cost:
                best, best_cost = np.zeros(size), cost
                best[chosen] = solved / scale[chosen]
    return best


def deviation_band(variances: Array, degrees: Array, share: float = 0.95) -> tuple[Array, Array]:
    """Lowest and highest Allan deviation (k,) at a level of confidence.

    Chi-square quantiles by Wilson and Hilferty, within 1 % down to 3 degrees of freedom.
    """
    z = NormalDist().inv_cdf(0.5 + 0.5 * share)
    c = 2 / (9 * degrees)
    high = (1 - c + z * np.sqrt(c)) ** 3
    low = np.maximum(1 - c - z * np.sqrt(c), 0.05) ** 3
    return np.sqrt(variances / high), np.sqrt(variances / low)


def _weights(model: Array, degrees: Array) -> Array:
    return np.asarray(1 / (model * np.sqrt(2 / np.maximum(degrees, 1e-3) + _MODEL**2)))


def _explained(residuals: Array) -> bool:
    """Whether the first points lie on the model as well as any do."""
    return bool(np.abs(residuals[0]) < _BARE_MISFIT)


def _sigmas(
    variances: Array, columns: Array, model: Array, spread: Array, start: int
) -> tuple[Array, float]:
    """Standard deviations (4,) of the squared terms, and the misfit."""
    degrees = 2 * model**2 / np.maximum(spread.diagonal(), 1e-300)
    weights = _weights(model, degrees)[start:]
    scale = np.maximum(np.linalg.norm(columns[start:] * weights[:, None], axis=0), 1e-300)
    gain = np.linalg.pinv(columns[start:] * weights[:, None] / scale) * weights / scale[:, None]
    deviation = np.sqrt(np.einsum("ij,jk,ik->i", gain, spread[start:, start:], gain))
    misfit = math.sqrt(float(np.mean((weights * (variances - model)[start:]) ** 2)))
    return np.asarray(deviation), misfit


def _term(power: float, sigma: float, sigma_without: float) -> Term:
    upper = math.sqrt(max(power, 0.0) + 2 * sigma)
    if power <= _SEEN_SIGMA * sigma_without:
        return Term(None, math.nan, upper)
    value = math.sqrt(power)
    return Term(value, sigma / (2 * value), upper)


def _minimum(variances: Array, degrees: Array) -> int:
    """Where the curve is lowest among the points that can be trusted."""
    trusted = np.flatnonzero(degrees >= _LEAST_DEGREES)
    return int(trusted[np.argmin(variances[trusted])]) if len(trusted) else 0
