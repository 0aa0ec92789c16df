"""Allan variances: against their definition, against theory, and what is told from them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imu_noise import flicker, gauss_markov, noise, walk, white

from tirgeo_ros.core.calibration.allan.bias_instability import (
    gauss_markov as gauss_markov_variances,
)
from tirgeo_ros.core.calibration.allan.deviation import allan_curve
from tirgeo_ros.core.calibration.allan.deviation_covariance import covariance, products, shapes
from tirgeo_ros.core.calibration.allan.noise_fit import AllanAnalysis

HOURS_5 = 1_800_000  # samples at 100 Hz
STEP_S = 0.01


def curve_of(*runs):
    return allan_curve([run.reshape(len(run), -1) for run in runs])


def by_definition(values, m, stride):
    """The variance of averages over ``m`` beside each other, at every ``stride``."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    starts = np.arange(0, len(values) - 2 * m + 1, stride)
    steps = total[starts + 2 * m] - 2 * total[starts + m] + total[starts]
    return 0.5 * np.mean(steps**2) / m**2, len(starts)


@settings(max_examples=25, deadline=None)
@given(size=st.integers(15, 700), seed=st.integers(0, 99))
def test_the_curve_is_the_definition(size, seed):
    values = np.cumsum(np.random.default_rng(seed).standard_normal((size, 2)), axis=0) + 9.8
    curve = curve_of(values)
    assert size < 4 * curve.slots.max() <= 2 * size
    for slots, stride, pairs, inverse, variances, _ in zip(*curve, strict=True):
        wanted = [by_definition(channel, int(slots), int(stride)) for channel in values.T]
        assert pairs == wanted[0][1]
        assert inverse == pytest.approx(1 / slots)
        # The sums of some hundred numbers near 10 keep 12 digits.
        assert variances == pytest.approx([v for v, _ in wanted], rel=1e-9)


def test_a_break_is_not_compared_across():
    values = np.random.default_rng(1).standard_normal(400)
    whole, curve = curve_of(values), curve_of(values, values + 1e3)
    assert (curve.pairs == 2 * whole.pairs).all()
    np.testing.assert_allclose(curve.variances, whole.variances, rtol=1e-8)


def test_missing_samples_leave_the_noise_as_it_is():
    rng = np.random.default_rng(2)
    values = white(rng, 200_000, 1e-3, STEP_S)
    values[rng.random(len(values)) < 0.15] = np.nan
    analysis = AllanAnalysis(curve_of(values), STEP_S)
    # A sixth of the samples lacks: without regard for that N would be 8 % too large.
    assert analysis.fit(0).white.value == pytest.approx(1e-3, rel=0.015)


@pytest.mark.parametrize(
    ("make", "term"),
    [(white, 0), (flicker, 1), (walk, 2)],
)
def test_variances_and_their_covariance_against_simulation(make, term):
    """400 records: variances to 5 sigma of their mean, spreads to 5 sigma of a spread (18 %)."""
    rng = np.random.default_rng(3)
    runs, size, step_s = 400, 4096, 0.5
    records = np.stack([make(rng, size, 2.0, step_s) for _ in range(runs)], axis=1)
    curve = curve_of(records)
    used = curve.slots >= 4  # flicker noise of samples is none at fewer
    curve = type(curve)(*(column[used] for column in curve))
    tau_s = curve.slots * step_s
    theory = 4.0 * shapes(tau_s, 1 / tau_s)[:, term]
    if make is walk:  # a step a sample, where the theory has one at every instant
        theory *= 1 + 0.5 / curve.slots**2
    powers = np.eye(3)[term] * 4.0
    spread = covariance(powers, products(curve, step_s))
    error = (curve.variances.mean(axis=1) - theory) / np.sqrt(spread.diagonal() / runs)
    bias = 0.02 if make is flicker else 0.0  # of the filter that makes it, at short times
    assert (np.abs(error) < 5 + bias * theory / np.sqrt(spread.diagonal() / runs)).all()
    found = np.cov(curve.variances)
    ratio = found.diagonal() / spread.diagonal()
    # Variances of variances: chi-square of few degrees of freedom has heavy tails at long times.
    degrees = 2 * theory**2 / spread.diagonal()
    allowed = 5 * np.sqrt((2 + 12 / degrees) / runs) + 0.03
    assert (np.abs(ratio - 1) < allowed).all()
    scale = np.sqrt(np.outer(spread.diagonal(), spread.diagonal()))
    assert np.abs((found - spread) / scale).max() < 5 * np.sqrt(2 / runs) + 0.2


NOISES = {"gyro": (1.7e-4, 3.7e-5, 1e-6), "accel": (1.3e-2, 2.5e-3, 4e-5)}


@pytest.fixture(scope="module")
def five_hours():
    rng = np.random.default_rng(5)
    records = [noise(rng, HOURS_5, *known, STEP_S) for known in NOISES.values()]
    return AllanAnalysis(curve_of(np.stack(records, axis=1)), STEP_S)


@pytest.mark.slow
@pytest.mark.parametrize("sensor", NOISES)
def test_known_noise_is_found_again(five_hours, sensor):
    n, b, k = NOISES[sensor]
    fit = five_hours.fit(list(NOISES).index(sensor))
    assert fit.white.value == pytest.approx(n, rel=0.03)
    assert fit.flicker.value == pytest.approx(b, rel=0.15)
    assert abs(fit.white.value - n) < 4 * fit.white.sigma
    assert abs(fit.flicker.value - b) < 4 * fit.flicker.sigma
    if fit.walk.value is None:  # 5 h do not always show it
        assert fit.walk.upper > 0.7 * k
    else:
        assert abs(fit.walk.value - k) < 4 * fit.walk.sigma
    assert fit.minimum == pytest.approx(0.664 * b, rel=0.4)
    assert fit.minimum_reached
    assert fit.misfit < 1.5


@pytest.mark.slow
def test_sigmas_are_honest():
    """60 records of 20 min: errors over sigma have a root mean square near 1, and no bias."""
    rng = np.random.default_rng(6)
    records = np.stack([noise(rng, 24_000, 1e-3, 2e-3, 0.0, 0.05) for _ in range(60)], axis=1)
    analysis = AllanAnalysis(curve_of(records), 0.05)
    fits = [analysis.fit(channel) for channel in range(60)]
    for name, true in (("white", 1e-3), ("flicker", 2e-3)):
        terms = [getattr(fit, name) for fit in fits]
        errors = np.array([(term.value - true) / term.sigma for term in terms])
        # 0.5 to 1.5: 60 draws tell a root mean square to 9 %; sigmas are themselves estimates.
        assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.5, name
        assert abs(errors.mean()) < 0.8, name
    unseen = [fit for fit in fits if fit.walk.value is None]
    assert len(unseen) > 45  # two sigma, one-sided: 5 in 100 by chance, more with heavy tails


def test_a_term_that_is_not_there_is_none_and_bounded():
    rng = np.random.default_rng(7)
    fit = AllanAnalysis(curve_of(white(rng, 60_000, 1e-3, STEP_S)), STEP_S).fit(0)
    assert fit.white.value == pytest.approx(1e-3, rel=0.03)
    assert fit.flicker.value is None
    assert fit.walk.value is None
    assert fit.quantisation.value is None
    assert 0 < fit.flicker.upper < 1e-3
    assert not fit.minimum_reached
    assert not fit.bias.seen
    assert np.isfinite([fit.bias.sigma, fit.bias.time_s]).all()


def test_a_gauss_markov_bias_is_found_as_the_filter_models_it():
    rng = np.random.default_rng(9)
    size, sigma, time_s = 400_000, 5e-4, 30.0
    record = white(rng, size, 2e-4, 0.05) + gauss_markov(rng, size, sigma, time_s, 0.05)
    fit = AllanAnalysis(curve_of(record), 0.05).fit(0)
    assert fit.bias.seen
    # 20000 s hold some 330 times twice the correlation time: sigma to 5 %, and the time likewise.
    assert fit.bias.sigma == pytest.approx(sigma, rel=0.15)
    assert fit.bias.time_s == pytest.approx(time_s, rel=0.3)
    assert fit.bias.time_factor < 2


@pytest.mark.slow
@pytest.mark.parametrize(("b", "k"), [(3e-4, 0.0), (1e-4, 3e-6), (5e-5, 0.0)])
def test_flicker_is_modelled_by_its_own_b(b, k):
    """What the parameters call bias instability is B, as everywhere else."""
    size = 360_000  # 5 h at 20 Hz
    record = noise(np.random.default_rng(1), size, 2e-4, b, k, 0.05)
    analysis = AllanAnalysis(curve_of(record), 0.05)
    fit = analysis.fit(0)
    assert fit.flicker.value == pytest.approx(b, rel=0.15)  # as B is asked for
    assert fit.bias.sigma == fit.flicker.value
    # The process's own deviation is 0.618 s at its highest, the floor 0.664 B: where its time is.
    peak = analysis.tau_s[np.argmax(fit.bias_model - fit.white.value**2 / analysis.tau_s)]
    floor = np.sqrt(fit.variances - fit.white.value**2 / analysis.tau_s)
    at = np.argmin(np.abs(analysis.tau_s - peak))
    assert floor[at] == pytest.approx(0.664 * b, rel=0.25)  # the walk lifts it, noise shakes it


def test_a_bias_that_walks_is_more_than_b():
    size = 360_000
    record = noise(np.random.default_rng(1), size, 2e-4, 1e-4, 2e-5, 0.05)
    fit = AllanAnalysis(curve_of(record), 0.05).fit(0)
    assert fit.bias.sigma > 2 * fit.flicker.value
    # what it drives a bias with is what drives the walk: K, to a half of it
    driven = fit.bias.sigma * math.sqrt(2 / fit.bias.time_s)
    assert driven == pytest.approx(2e-5, rel=0.6)


def test_gauss_markov_variances_against_theory():
    tau_s = np.geomspace(1e-4, 1e6, 200)
    found = gauss_markov_variances(tau_s, 10.0)
    assert (found > 0).all()
    assert found.max() == pytest.approx(0.382, abs=0.002)  # 0.437^2 * 2: IEEE Std 952, C.1.5
    assert tau_s[np.argmax(found)] == pytest.approx(18.9, rel=0.1)
    np.testing.assert_allclose(found[tau_s < 0.01], 2 * tau_s[tau_s < 0.01] / 30, rtol=1e-3)
    np.testing.assert_allclose(found[tau_s > 1e5], 20 / tau_s[tau_s > 1e5], rtol=1e-3)


def test_a_low_pass_filter_of_the_sensor_does_not_pull_the_random_walk_down():
    rng = np.random.default_rng(10)
    record = white(rng, 300_000, 1e-3, STEP_S)
    smooth = np.convolve(record, np.ones(6) / 6, mode="valid")
    fit = AllanAnalysis(curve_of(smooth), STEP_S).fit(0)
    assert fit.shortest_s > 0.1
    assert fit.white.value == pytest.approx(1e-3, rel=0.03)


def test_quantisation_is_told_from_the_random_walk():
    rng = np.random.default_rng(11)
    step = 2e-5  # of the angle, so that Q is step / sqrt(12)
    angle = np.cumsum(white(rng, 400_000, 2e-4, STEP_S)) * STEP_S
    rate = np.diff(np.round(angle / step) * step) / STEP_S
    fit = AllanAnalysis(curve_of(rate), STEP_S).fit(0)
    assert fit.quantisation.value == pytest.approx(step / math.sqrt(12), rel=0.1)
    assert fit.white.value == pytest.approx(2e-4, rel=0.06)


@pytest.mark.filterwarnings("error")
def test_a_curve_without_any_of_the_lasting_terms_divides_by_nothing():
    """A swing falls with the square of time beyond its period, and no white noise is left."""
    swing = np.sin(np.arange(60_000) / 40) + 1e-3 * np.random.default_rng(9).standard_normal(
        60_000
    )
    fit = AllanAnalysis(curve_of(swing), STEP_S).fit(0)
    assert fit.flicker.value is None
    assert fit.walk.value is None


def test_a_drift_is_taken_out():
    rng = np.random.default_rng(12)
    record = noise(rng, 200_000, 1e-3, 1e-3, 0.0, 0.05)
    ramp = 1e-5
    drifting = record + ramp * 0.05 * np.arange(len(record))
    fit = AllanAnalysis(curve_of(drifting), 0.05).fit(0, ramp)
    assert fit.white.value == pytest.approx(1e-3, rel=0.03)
    assert fit.flicker.value == pytest.approx(1e-3, rel=0.25)
    whole = AllanAnalysis(curve_of(record), 0.05).fit(0)
    np.testing.assert_allclose(fit.variances, whole.variances, rtol=1e-6)
    assert fit.walk.value == whole.walk.value
