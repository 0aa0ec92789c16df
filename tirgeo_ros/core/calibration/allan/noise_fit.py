"""Fit noise terms to an Allan curve, and the nearest noise model of the filter.

The curve is ``s^2(tau) = N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3 + 3 Q^2/tau^2``: white noise (angle
or velocity random walk), flicker noise (bias instability), rate random walk, and quantisation
where the curve shows it. IEEE Std 952, annex C. The floor of flicker noise is 0.664 B.

The squares of the terms enter linearly. So a fit is non-negative least squares of the relative
residuals ``s^2 / model - 1``, weighted by the degrees of freedom of the previous step's model.
This is the likelihood of chi-square variables, without the downward bias of logarithms with few
degrees of freedom. The terms describe a sensor only to some per cent, which limits the weight of
a point. Standard deviations come from the whole covariance of the curve, because neighbouring
averaging times share their data; a misfit beyond it enlarges them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.allan.bias_instability import GaussMarkov, Term, fit_bias
from tirgeo_ros.core.calibration.allan.deviation import AllanCurve
from tirgeo_ros.core.calibration.allan.deviation_covariance import covariance, products, shapes
from tirgeo_ros.core.types.arrays import Array

#: The floor of flicker noise of bias instability 1: sqrt(2 ln 2 / pi).
FLICKER_FLOOR = math.sqrt(2 * math.log(2) / math.pi)
#: A term is significant beyond this many standard deviations of its square.
_SEEN_SIGMA = 2.0
#: Longer averages, relative to the record, have too few neighbours to be useful.
_LONGEST = 0.25
_MODEL = 0.02  # relative error of the terms as a model of variances
_BARE_MISFIT = 0.06  # relative misfit at which a variance at the shortest times is not explained
_REACH = 4.0  # times the first time that fits: the unexplained effect decays slowly
_STEPS = 8
_FEWEST = 8  # points that a fit must keep
_LEAST_DEGREES = 10.0  # degrees of freedom that the curve's minimum must have


class NoiseFit(NamedTuple):
    """Hold the noise of one axis; terms are in the units of the record and seconds."""

    white: Term  # N, unit sqrt(s)
    flicker: Term  # B, unit: the floor divided by 0.664
    walk: Term  # K, unit / sqrt(s)
    quantisation: Term  # Q, unit s
    minimum: float  # of the measured Allan deviation
    minimum_sigma: float
    minimum_at_s: float
    minimum_reached: bool  # False: the curve is white noise up to the record's end
    bias: GaussMarkov
    shortest_s: float  # shorter averaging times fit no term and were left out
    misfit: float  # rms of the weighted residuals, about 1 or less
    degrees: Array  # (k,) equivalent degrees of freedom
    variances: Array  # (k,) as measured, with the drift removed
    model: Array  # (k,) fitted variances
    bias_model: Array  # (k,) variances of the filter's model


class AllanAnalysis:
    """Hold what all axes of a record share: averaging times and their covariance."""

    def __init__(self, curve: AllanCurve, step_s: float) -> None:
        spans = (curve.pairs - 1) * curve.strides + 2 * curve.slots
        used = curve.slots <= _LONGEST * spans
        self.curve = AllanCurve(*(column[used] for column in curve))
        self.tau_s = self.curve.slots * step_s
        self.span_s = float(spans.max()) * step_s
        self._columns = shapes(self.tau_s, self.curve.inverse_counts / step_s)
        self._products = products(self.curve, step_s)

    def fit(self, channel: int, ramp: float = 0.0) -> NoiseFit:
        """Return the fit of one channel; a steady drift ``ramp`` (unit/s) is removed first."""
        rise = ramp * self.tau_s  # what a drift adds to each difference
        steps, measured = (
            column[:, channel] for column in (self.curve.steps, self.curve.variances)
        )
        variances = measured - rise * steps + 0.5 * rise**2
        columns = np.column_stack([self._columns, 3 / self.tau_s**2])
        start, powers = self._powers(variances, columns)
        model = columns @ powers
        spread = covariance(powers[:3], self._products)
        degrees = 2 * (columns[:, :3] @ powers[:3]) ** 2 / spread.diagonal()
        sigmas, misfit = _sigmas(variances, columns, model, spread, start)
        without = self._without(variances, columns, powers, start)
        sigmas *= max(misfit, 1.0)
        random_walk, flicker, walk, quantisation = (
            _term(*one)
            for one in zip(*(part.tolist() for part in (powers, sigmas, without)), strict=True)
        )
        white = powers[0] * columns[:, 0]
        # The lowest point among those with enough degrees of freedom.
        at = int(np.argmin(np.where(degrees >= _LEAST_DEGREES, variances, np.inf)))
        lowest = math.sqrt(variances[at])
        part = slice(start, None)
        bias = fit_bias(self.tau_s, variances - white, model, spread, part, flicker)
        return NoiseFit(
            white=random_walk,
            flicker=flicker,
            walk=walk,
            quantisation=quantisation,
            minimum=lowest,
            minimum_sigma=lowest / math.sqrt(2 * degrees[at]),
            minimum_at_s=float(self.tau_s[at]),
            minimum_reached=flicker.value is not None or walk.value is not None,
            bias=bias,
            shortest_s=float(self.tau_s[start]),
            misfit=misfit,
            degrees=degrees,
            variances=variances,
            model=model,
            bias_model=white + bias.variances(self.tau_s),
        )

    def _powers(self, variances: Array, columns: Array) -> tuple[int, Array]:
        """Return the index of the first point that the terms explain, and their squares (4,).

        A sensor's low-pass filter lowers the variances at the shortest times, and vibration raises
        them. Such points are left out one by one.
        """
        plain, start = columns.copy(), 0
        plain[:, 3] = 0.0
        while True:
            powers = self._weighted(variances, plain, start)
            misfit = variances / (plain @ powers) - 1
            if abs(misfit[start]) < _BARE_MISFIT or start + _FEWEST >= len(variances):
                break
            start += 1
        if start:  # try quantisation, and use it only if it explains all the points
            with_steps = self._weighted(variances, columns, 0)
            if abs(variances[0] / (columns[0] @ with_steps) - 1) < _BARE_MISFIT:
                return 0, with_steps
            reach = self.tau_s >= _REACH * self.tau_s[start]
            start = min(int(np.argmax(reach)) if reach.any() else start, len(variances) - _FEWEST)
            powers = self._weighted(variances, plain, start)
        return start, powers

    def _without(self, variances: Array, columns: Array, powers: Array, start: int) -> Array:
        """Return (4,) the scatter that each squared term would have if it were absent.

        Significance is judged by this, not by the scatter with the term present: long averaging
        times have few degrees of freedom, but a curve far above the other terms is not by chance.
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
        """Return the squares of the terms, fitted to the points from ``start`` on."""
        model = variances
        degrees = self.span_s / self.tau_s  # first guess: averages without overlap
        for _ in range(_STEPS):
            weights = _weights(model, degrees)[start:]
            powers = _non_negative(columns[start:] * weights[:, None], variances[start:] * weights)
            noise = columns[:, :3] @ powers[:3]
            model = np.maximum(columns @ powers, 1e-9 * variances)
            spread = covariance(powers[:3], self._products).diagonal()
            floor = np.maximum(spread, 1e-30 * noise**2)
            degrees = np.divide(2 * noise**2, floor, out=degrees.copy(), where=noise > 0)
        return powers


def deviation_band(variances: Array, degrees: Array, share: float = 0.95) -> tuple[Array, Array]:
    """Return the lowest and highest Allan deviation (k,) at a confidence level (chi-square)."""
    from scipy.special import chdtri  # noqa: PLC0415  slow to import

    high, low = (
        chdtri(degrees, tail) / degrees for tail in (0.5 - 0.5 * share, 0.5 + 0.5 * share)
    )
    return np.sqrt(variances / high), np.sqrt(variances / low)


def _non_negative(columns: Array, values: Array) -> Array:
    """Solve least squares (n, k), (n,) with no negative coefficient; the columns are scaled."""
    from scipy.optimize import nnls  # noqa: PLC0415  slow to import

    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    return np.asarray(nnls(columns / scale, values)[0] / scale)


def _weights(model: Array, degrees: Array) -> Array:
    return np.asarray(1 / (model * np.sqrt(2 / np.maximum(degrees, 1e-3) + _MODEL**2)))


def _sigmas(
    variances: Array, columns: Array, model: Array, spread: Array, start: int
) -> tuple[Array, float]:
    """Return the standard deviations (4,) of the squared terms, and the misfit."""
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
