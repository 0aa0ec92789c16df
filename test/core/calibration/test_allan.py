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
"""Allan variances by definition and theory, the noise fitted to them, white noise in flight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from imu_noise import (
    FLIGHT_DENSITY as DENSITY,
    FLIGHT_HZ,
    flicker,
    flown,
    gauss_markov,
    noise,
    record,
    walk,
    white,
)

from tirgeo_ros.core.calibration import allan
from tirgeo_ros.core.calibration.allan import allan_curve, fit_noise
from tirgeo_ros.core.calibration.flight_noise import PIECE_S, pieces_of

HOURS_5 = 1_800_000  # samples at 100 Hz
STEP_S = 0.01


def curve_of(*runs, step_s=1.0):
    return allan_curve([run.reshape(len(run), -1) for run in runs], step_s)


def fit_of(record, step_s=STEP_S):
    return fit_noise(curve_of(record, step_s=step_s), 0)


def by_definition(values, m):
    """Return the variance of adjacent averages over ``m``, at every quarter of ``m``."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    starts = np.arange(0, len(values) - 2 * m + 1, max(m // 4, 1))
    steps = total[starts + 2 * m] - 2 * total[starts + m] + total[starts]
    return 0.5 * np.mean(steps**2) / m**2


@settings(max_examples=25, deadline=None)
@given(size=st.integers(15, 700), seed=st.integers(0, 99))
def test_the_curve_is_the_definition(size, seed):
    values = np.cumsum(np.random.default_rng(seed).standard_normal((size, 2)), axis=0) + 9.8
    curve = curve_of(values)
    assert size < 8 * curve.tau_s.max() <= 2.2 * size
    for tau_s, inverse, variances in zip(curve.tau_s, curve.white, curve.variances, strict=True):
        assert inverse == pytest.approx(1 / tau_s)
        # The sums of some hundred numbers near 10 keep 12 digits.
        wanted = [by_definition(channel, int(tau_s)) for channel in values.T]
        assert variances == pytest.approx(wanted, rel=1e-9)


def test_a_break_is_not_compared_across():
    values = np.random.default_rng(1).standard_normal(400)
    whole, curve = curve_of(values), curve_of(values, values + 1e3)
    np.testing.assert_allclose(curve.variances[: len(whole.tau_s)], whole.variances, rtol=1e-8)


def test_missing_samples_leave_the_noise_as_it_is():
    rng = np.random.default_rng(2)
    values = white(rng, 200_000, 1e-3, STEP_S)
    values[rng.random(len(values)) < 0.15] = np.nan
    # A sixth of the samples is missing: if that were ignored, N would be 8 % too large.
    assert fit_of(values).white.value == pytest.approx(1e-3, rel=0.015)


@pytest.mark.parametrize(("make", "term"), [(white, 0), (flicker, 1), (walk, 2)])
def test_variances_and_their_scatter_against_simulation(make, term):
    """400 records: variances within 5 sigma of their mean, scatter as the degrees predict."""
    rng = np.random.default_rng(3)
    runs, step_s = 400, 0.5
    records = np.stack([make(rng, 4096, 2.0, step_s) for _ in range(runs)], axis=1)
    curve = curve_of(records, step_s=step_s)
    used = curve.tau_s >= 4 * step_s  # with fewer samples it is not flicker noise
    tau_s, variances = curve.tau_s[used], curve.variances[used]
    theory = 4.0 * [1 / tau_s, np.full(len(tau_s), 2 * np.log(2) / np.pi), tau_s / 3][term]
    if make is walk:  # it steps once a sample, in theory at every instant
        theory *= 1 + 0.5 * (step_s / tau_s) ** 2
    spread = variances.std(axis=1)
    bias = 0.02 if make is flicker else 0.0  # of the filter that generates it, at short times
    error = np.abs(variances.mean(axis=1) - theory)
    assert (error < 5 * spread / math.sqrt(runs) + bias * theory).all()
    # The degrees are for flicker noise; for the others they differ by up to a factor of 1.6.
    ratio = 2 * theory**2 / spread**2 / curve.degrees[used]
    assert ((ratio > 0.6) & (ratio < 2.0)).all()


NOISES = {"gyro": (1.7e-4, 3.7e-5, 1e-6), "accel": (1.3e-2, 2.5e-3, 4e-5)}


@pytest.fixture(scope="module")
def five_hours():
    rng = np.random.default_rng(5)
    records = [noise(rng, HOURS_5, *known, STEP_S) for known in NOISES.values()]
    return curve_of(np.stack(records, axis=1), step_s=STEP_S)


@pytest.mark.slow
@pytest.mark.parametrize("sensor", NOISES)
def test_known_noise_is_found_again(five_hours, sensor):
    n, b, k = NOISES[sensor]
    fit = fit_noise(five_hours, list(NOISES).index(sensor))
    assert fit.white.value == pytest.approx(n, rel=0.03)
    assert fit.flicker.value == pytest.approx(b, rel=0.15)
    assert abs(fit.white.value - n) < 4 * fit.white.sigma
    assert abs(fit.flicker.value - b) < 4 * fit.flicker.sigma
    if fit.walk.value is None:  # 5 h do not always show it
        assert fit.walk.upper > 0.7 * k
    else:
        assert abs(fit.walk.value - k) < 4 * fit.walk.sigma
    assert fit.minimum == pytest.approx(0.664 * b, rel=0.4)
    assert fit.misfit < 1.5


@pytest.mark.slow
def test_sigmas_are_honest():
    """60 records of 20 min: errors over sigma have a root mean square near 1, and no bias."""
    rng = np.random.default_rng(6)
    records = np.stack([noise(rng, 24_000, 1e-3, 2e-3, 0.0, 0.05) for _ in range(60)], axis=1)
    curve = curve_of(records, step_s=0.05)
    fits = [fit_noise(curve, channel) for channel in range(60)]
    for name, true in (("white", 1e-3), ("flicker", 2e-3)):
        terms = [getattr(fit, name) for fit in fits]
        errors = np.array([(term.value - true) / term.sigma for term in terms])
        # 0.5 to 1.5: 60 draws give a root mean square to 9 %, and sigmas are estimates too.
        assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.5, name
        assert abs(errors.mean()) < 0.8, name
    unseen = [fit for fit in fits if fit.walk.value is None]
    assert len(unseen) > 45  # two sigma, one-sided: 5 in 100 by chance, more with heavy tails


def test_a_term_that_is_not_there_is_none_and_bounded():
    rng = np.random.default_rng(7)
    fit = fit_of(white(rng, 60_000, 1e-3, STEP_S))
    assert fit.white.value == pytest.approx(1e-3, rel=0.03)
    assert fit.flicker.value is None
    assert fit.walk.value is None
    assert 0 < fit.flicker.upper < 1e-3
    assert not fit.bias.observed
    assert np.isfinite([fit.bias.sigma, fit.bias.time_s]).all()


def test_a_gauss_markov_bias_is_found_as_the_filter_models_it():
    rng = np.random.default_rng(9)
    size, sigma, time_s = 400_000, 5e-4, 30.0
    record = white(rng, size, 2e-4, 0.05) + gauss_markov(rng, size, sigma, time_s, 0.05)
    fit = fit_of(record, 0.05)
    assert fit.bias.observed
    # 20000 s hold some 330 times twice the correlation time: sigma to 5 %, and the time likewise.
    assert fit.bias.sigma == pytest.approx(sigma, rel=0.15)
    assert fit.bias.time_s == pytest.approx(time_s, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(("b", "k"), [(3e-4, 0.0), (1e-4, 3e-6), (5e-5, 0.0)])
def test_flicker_is_modelled_by_its_own_b(b, k):
    """The parameter bias instability is B, as in data sheets."""
    size = 360_000  # 5 h at 20 Hz
    record = noise(np.random.default_rng(1), size, 2e-4, b, k, 0.05)
    curve = curve_of(record, step_s=0.05)
    fit = fit_noise(curve, 0)
    assert fit.flicker.value == pytest.approx(b, rel=0.15)  # as B is asked for
    assert fit.bias.sigma == fit.flicker.value
    # The process's highest deviation is 0.618 s, the floor 0.664 B, both near its time.
    peak = curve.tau_s[np.argmax(fit.bias_model - fit.white.value**2 / curve.tau_s)]
    floor = np.sqrt(fit.variances - fit.white.value**2 / curve.tau_s)
    at = np.argmin(np.abs(curve.tau_s - peak))
    assert floor[at] == pytest.approx(0.664 * b, rel=0.25)  # the walk raises it, noise scatters it


def test_a_bias_that_walks_is_more_than_b():
    size = 360_000
    record = noise(np.random.default_rng(1), size, 2e-4, 1e-4, 2e-5, 0.05)
    fit = fit_of(record, 0.05)
    assert fit.bias.sigma > 2 * fit.flicker.value
    # the noise that drives the bias is that of the walk: K, within a half
    driven = fit.bias.sigma * math.sqrt(2 / fit.bias.time_s)
    assert driven == pytest.approx(2e-5, rel=0.6)


def test_gauss_markov_variances_against_theory():
    tau_s = np.geomspace(1e-4, 1e6, 200)
    result = allan.gauss_markov(tau_s, 10.0)
    assert (result > 0).all()
    assert result.max() == pytest.approx(0.382, abs=0.002)  # 0.437^2 * 2: IEEE Std 952, C.1.5
    assert tau_s[np.argmax(result)] == pytest.approx(18.9, rel=0.1)
    np.testing.assert_allclose(result[tau_s < 0.01], 2 * tau_s[tau_s < 0.01] / 30, rtol=1e-3)
    np.testing.assert_allclose(result[tau_s > 1e5], 20 / tau_s[tau_s > 1e5], rtol=1e-3)


def test_a_low_pass_filter_of_the_sensor_does_not_pull_the_random_walk_down():
    rng = np.random.default_rng(10)
    record = white(rng, 300_000, 1e-3, STEP_S)
    smooth = np.convolve(record, np.ones(6) / 6, mode="valid")
    fit = fit_of(smooth)
    assert fit.shortest_s > 0.1
    assert fit.white.value == pytest.approx(1e-3, rel=0.03)


@pytest.mark.filterwarnings("error")
def test_a_curve_without_any_of_the_lasting_terms_divides_by_nothing():
    """An oscillation's variance falls with the square of time; no white noise is left."""
    swing = np.sin(np.arange(60_000) / 40) + 1e-3 * np.random.default_rng(9).standard_normal(
        60_000
    )
    fit = fit_of(swing)
    assert fit.flicker.value is None
    assert fit.misfit > 2  # a warning follows from it


def test_a_drift_is_taken_out():
    record = noise(np.random.default_rng(12), 200_000, 1e-3, 1e-3, 0.0, 0.05)
    drifting = record + 1e-5 * 0.05 * np.arange(len(record))
    result = allan_curve([drifting[:, None]], 0.05, np.array([1e-5]))
    np.testing.assert_allclose(
        result.variances, curve_of(record, step_s=0.05).variances, rtol=1e-6
    )


FLIGHT_STEP_S = 1 / FLIGHT_HZ
DURATION_S = 120
T_S = np.arange(DURATION_S * FLIGHT_HZ) * FLIGHT_STEP_S


def white_noise(seed, density=DENSITY):
    return white(np.random.default_rng(seed), (len(T_S), 6), density, FLIGHT_STEP_S)


def measured(values, lost=None):
    return pieces_of(record(values, FLIGHT_STEP_S, lost))


@pytest.mark.parametrize("frequency_hz", [20.0, 61.3, 88.8])
def test_lines_are_found_with_frequency_and_amplitude(frequency_hz):
    values = flown(5, DURATION_S)
    values[:, 3] += 2.0 * np.sin(2 * np.pi * frequency_hz * T_S)
    result = measured(values)
    (line,) = result.lines(3)
    assert line.frequency_hz == pytest.approx(frequency_hz, abs=0.2)
    # The noise adds 2 % to the line's power; subtraction of the median leaves only its scatter.
    assert line.amplitude == pytest.approx(2.0, rel=0.02)
    assert result.lines(4) == []


def test_a_wandering_line_is_one():
    values = white_noise(6)
    hz = 50 + 4 * np.sin(2 * np.pi * T_S / 17)
    values[:, 5] += 8.0 * np.sin(2 * np.pi * np.cumsum(hz) * FLIGHT_STEP_S)
    (line,) = measured(values).lines(5)
    assert line.frequency_hz == pytest.approx(50, abs=0.5)
    assert line.amplitude == pytest.approx(8.0, rel=0.03)


def test_what_motion_leaves_above_eight_hertz_is_no_line():
    values = white_noise(7)
    values[:, 0] += np.cumsum(np.random.default_rng(1).standard_normal(len(T_S))) * 0.02
    assert measured(values).lines(0) == []


def test_idling_rotors_and_slow_turns_are_no_rest():
    for channel, motion in ((5, 9.8 + 1.5 * np.sin(2 * np.pi * 42 * T_S)), (2, 0.2)):
        values = white_noise(10, np.repeat([1.7e-4, 1.3e-2], 3))
        values[:, channel] += motion
        assert not measured(values).at_rest.any()


def test_a_few_lost_samples_are_bridged_and_gaps_passed_by():
    values = white_noise(13)
    lost = np.random.default_rng(2).random(len(values)) < 0.005
    lost[30 * FLIGHT_HZ : 34 * FLIGHT_HZ] = True
    result = measured(values, lost)
    assert len(result.floors) == DURATION_S // PIECE_S - 2
    # 0.5 % of the samples are interpolated, which removes part of their noise.
    np.testing.assert_allclose(np.median(result.floors, axis=0), DENSITY, rtol=0.045)


@pytest.mark.parametrize("rate_hz", [5, 10, 17, 18])
def test_a_record_too_slow_for_vibration_has_no_pieces(rate_hz):
    values = white(np.random.default_rng(0), (60 * rate_hz, 6), DENSITY, 1 / rate_hz)
    assert not len(pieces_of(record(values, 1 / rate_hz)).floors)
