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
"""The filter's step: the covariance's own rate, bridged gaps, noise of the IMU, the update."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from motions import difference, state_at
from scipy import stats

from tirgeo_ros.core.config import EkfConfig, ImuConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.navigation.ins.error_states import ANTENNA
from tirgeo_ros.core.navigation.ins.kalman import Measurement, chi_square_limit, update
from tirgeo_ros.core.navigation.ins.propagation import (
    STILL,
    CovariancePropagation,
    Epoch,
    NoisePowers,
    Propagated,
    Propagation,
    VibrationMeter,
    densities,
)
from tirgeo_ros.core.navigation.ins.strapdown import propagate
from tirgeo_ros.core.types.measurements import ImuSample

CONFIG = config_from(EkfConfig, {"aircraft.rtk_antenna_sigma_m": (0.0, 0.0, 0.0)})
START = state_at(0.695, 2.04, 31.5, (3.0, -1.0, 0.2), (0.05, -0.03, 0.4))
SIGMAS = np.r_[[2e-3] * 3, [0.03] * 3, [0.02] * 3, [3e-4] * 3, [5e-3] * 3, [0.5] * 4, [0.1] * 3]


def estimate(state=START, states=ANTENNA.start) -> Propagated:
    sigmas = np.r_[SIGMAS, 0.02][:states]
    return Propagated(state, np.diag(sigmas**2))


def turning(t_s):
    """Readings of an aircraft that rolls, brakes and turns."""
    force = np.array(
        [1.5 * math.sin(3 * t_s), 1.0 * math.cos(2 * t_s), -9.8 + 0.5 * math.sin(t_s)]
    )
    rate = np.array([0.5 * math.cos(4 * t_s), 0.3 * math.sin(3 * t_s), 0.6 * math.cos(t_s)])
    return force, rate


def epochs_of(stamps_s, readings=turning, first=None):
    first_sample, *samples = (ImuSample(round(t * 1e9), *readings(t)) for t in stamps_s)
    epochs = [Epoch.first(first_sample.stamp_ns, first_sample, first or estimate())]
    meter = VibrationMeter()
    for sample in samples:
        epochs.append(Epoch.after(epochs[-1], sample, meter))
    return epochs


def propagated_through(epochs):
    """The state at the last epoch, its covariance too."""
    mechanisation, now = Propagation(CONFIG), epochs[0].propagated
    for start, end in pairwise(epochs):
        start.propagated = now
        now = mechanisation.whole(now, start, end)
    return mechanisation.followed(now)


@pytest.mark.parametrize("rate_hz", [50, 100, 200, 400])
def test_covariance_at_its_lower_rate_is_that_of_small_steps(rate_hz):
    """Two seconds of turns, against a covariance that follows at 400 Hz."""
    stamps = np.arange(0, 2.0 + 1e-9, 1 / rate_hz)
    result = propagated_through(epochs_of(stamps))
    state, covariance = estimate()[:2]
    propagation = CovariancePropagation(CONFIG)
    for k in range(800):
        force, rate = turning((k + 0.5) / 400)
        after, rates = propagate(state, tuple(force), tuple(rate), 1 / 400)
        covariance = propagation.step(covariance, state, rates, rates.specific_force_n, 1 / 400)
        state = after
    sigmas = np.sqrt(np.diag(covariance))
    # Steps of 50 ms in turns of 1 rad/s: of second order, (0.05)^2 / 2 at each quarter turn.
    np.testing.assert_allclose(np.sqrt(np.diag(result.covariance)), sigmas, rtol=5e-3)
    correlations = (result.covariance - covariance) / np.outer(sigmas, sigmas)
    assert np.abs(correlations).max() < 0.02


@pytest.mark.parametrize("cuts_s", [(0.004,), (0.001, 0.0035, 0.0081), (0.01,)])
def test_parts_of_an_interval_are_the_whole(cuts_s):
    """Readings are linear in between, so the cuts do not matter to second order."""
    epochs = epochs_of([0.0, 0.01])
    mechanisation = Propagation(CONFIG)
    start, end = epochs
    whole = mechanisation.whole(start.propagated, start, end)
    now, now_ns = start.propagated, 0
    for cut_s in (*cuts_s, 0.01):
        now = mechanisation.part(now, start, end, now_ns, round(cut_s * 1e9))
        now_ns = round(cut_s * 1e9)
    # Third order: 0.01^3 x (2 m/s3 x 1 rad/s) / 12.
    np.testing.assert_allclose(now.state.velocity_n, whole.state.velocity_n, atol=1e-6)
    np.testing.assert_allclose(now.state.q_nb, whole.state.q_nb, atol=1e-7)
    assert now.lag_s == pytest.approx(whole.lag_s, abs=1e-12)


# Gaps


@pytest.mark.parametrize(("gap_s", "bridged"), [(0.02, False), (0.035, False), (0.04, True)])
def test_lost_samples_enlarge_the_covariance(gap_s, bridged):
    """One sample of a 50 Hz IMU with jitter is not a loss, two are."""
    result = propagated_through(epochs_of([0.0, gap_s]))
    plain = np.diag(estimate().covariance)[:3]
    widened = np.diag(result.covariance)[:3] - plain > (0.05 * gap_s) ** 2 * 0.9
    assert widened.all() == bridged


def flown(rng, seconds, rate_hz=400):
    """A manoeuvre drawn at random: sums of sines as the gusts and the pilot make them."""
    times = np.arange(0, seconds + 1e-9, 1 / rate_hz)
    force = np.tile([0.0, 0.0, -9.8], (len(times), 1))
    rate = np.zeros((len(times), 3))
    for hz in (0.3, 0.7, 1.5):
        phase = rng.uniform(0, 2 * math.pi, 6)
        waves = np.sin(2 * math.pi * hz * times[:, None] + phase)
        force += waves[:, :3] * 0.8 * rng.normal(size=3) / (1 + hz)
        rate += waves[:, 3:] * 0.25 * rng.normal(size=3) / (1 + hz)
    return times, force, rate


@pytest.mark.parametrize("gap_s", [0.06, 0.12, 0.2])
def test_monte_carlo_of_lost_samples(gap_s):
    """The added variance covers the errors of bridging: error over sigma is at most one."""
    rng = np.random.default_rng(9)
    ratios = []
    for _ in range(60):
        times, force, rate = flown(rng, 0.5)
        begin, end = 40, 40 + round(gap_s * 400)
        truth = START
        for k in range(end):
            if k == begin:
                certain = Propagated(truth, np.zeros((ANTENNA.start,) * 2))
            mean = tuple((force[k] + force[k + 1]) / 2), tuple((rate[k] + rate[k + 1]) / 2)
            truth, _ = propagate(truth, *mean, 1 / 400)
        read = {times[k]: (force[k], rate[k]) for k in (begin, end)}
        result = propagated_through(epochs_of(read, read.get, certain))
        error = difference(truth, result.state)[:9]
        ratios.append(error / np.sqrt(np.diag(result.covariance)[:9]))
    blocks = np.sqrt(np.mean(np.square(ratios), axis=0)).reshape(3, 3)
    assert (blocks <= 1.1).all()


def test_a_gap_covers_a_clock_that_was_set_forward():
    """0.15 s never happened, so the state is too far ahead; its covariance covers that."""
    readings = np.array([0.5, 0, -9.8]), np.zeros(3)
    result = propagated_through(epochs_of([0.0, 0.15], lambda _: readings))
    moved_m = 0.15 * math.hypot(*START.velocity_n)
    sigma_m = math.sqrt(max(np.diag(result.covariance)[6:9]))
    assert moved_m < 3 * sigma_m


RATE_HZ = 100.0
GYRO, ACCEL = np.array([1e-3, 3e-3, 5e-4]), np.array([0.1, 0.05, 0.4])


def white(seconds, seed=0, rate_hz=RATE_HZ):
    """Readings (n, 3) of both sensors with the densities GYRO and ACCEL."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate_hz)
    return tuple(rng.normal(size=(n, 3)) * density * np.sqrt(rate_hz) for density in (GYRO, ACCEL))


def measured(rates, forces, step_s=1 / RATE_HZ, meter=None):
    meter = meter or VibrationMeter()
    for rate, force in zip(rates.tolist(), forces.tolist(), strict=True):
        powers = meter.add(step_s, tuple(force), tuple(rate))
    return np.array(densities(powers))


# The squares of second differences of white noise are correlated: the mean of n has the relative
# spread sqrt(2 (1 + 2 (4/6)^2 + 2 (1/6)^2) / n), and a density has half of it. Of averages of
# three samples, for 3 s at 100 Hz with a decay that halves what counts: 0.14; three of these.
MEMORY_SPREAD = 3 * 0.5 * np.sqrt(2 * (1 + 2 * (4 / 6) ** 2 + 2 / 36) / 200)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 400.0])
def test_white_noise_is_measured_whatever_the_rate(rate_hz):
    result = measured(*white(12.0, 1, rate_hz), 1 / rate_hz)
    assert result == pytest.approx(
        [*GYRO, *ACCEL], rel=MEMORY_SPREAD * np.sqrt(max(100 / rate_hz, 1))
    )


def test_motion_does_not_count_as_noise():
    """A roll of 30 deg in half a second and a push of 5 m/s2 beside the shipped densities."""
    t_s = np.arange(0, 6, 1 / RATE_HZ)
    turn = np.outer(np.sin(2 * np.pi * t_s), [1.0, 0.5, 0.6])
    push = np.outer(np.cos(2 * np.pi * t_s), [5.0, 3.0, 2.0])
    imu = ImuConfig()
    result = measured(turn, push)
    assert np.all(result[:3] * imu.gyro_vibration_share < imu.angle_random_walk)
    assert np.all(result[3:] * imu.accel_vibration_share < imu.velocity_random_walk)


def test_lines_near_half_the_sampling_rate_hardly_count():
    """A line at 53 Hz, sampled at 120 Hz, five times the white noise's rms on each axis.

    An average of three samples leaves 0.27 of the line, at 13 Hz: in second differences, where the
    average's white noise counts with sqrt(6 / 3), that is 5 x 0.27 x 2.9 / 1.4 = 2.8 densities;
    by samples it would be 5 x 3.9 / sqrt(6) = 7.9.
    """
    rates, forces = white(12.0, 5, 120.0)
    line = 5 * np.sqrt(2) * np.sin(2 * np.pi * 53 * np.arange(0, 12, 1 / 120))[:, None]
    line = line * np.sqrt(120.0)
    shaken = measured(rates + line * GYRO, forces + line * ACCEL, 1 / 120)
    ratio = shaken / [*GYRO, *ACCEL]
    assert ratio == pytest.approx(np.hypot(1, 2.8), rel=MEMORY_SPREAD)


def test_densities_fall_again_after_some_seconds_of_calm():
    meter = VibrationMeter()
    shaken = measured(*white(6.0, 3), meter=meter)
    calm = measured(np.zeros((900, 3)), np.zeros((900, 3)), meter=meter)
    # Nine seconds are three memories: exp(-3) of the power.
    assert calm == pytest.approx(shaken * np.exp(-1.5), rel=0.15)


def test_differences_across_lost_samples_are_left_out():
    meter = VibrationMeter()
    for k in range(50):
        before = meter.add(0.01, (0.0, 0.0, 0.1 * (k % 2)), (0.0, 0.0, 0.0))
    after = meter.add(0.1, (50.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    assert after == before
    meter.add(0.01, (50.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    assert meter.add(0.01, (50.0, 0.0, 0.0), (2.0, 0.0, 0.0)) == before


def test_never_below_the_configured_noise():
    config = config_from(EkfConfig, {"imu.velocity_random_walk": (0.01, 0.02, 0.03)})
    powers = NoisePowers(config.imu)
    still = np.square([*config.imu.angle_random_walk, 0.01, 0.02, 0.03])
    assert powers.under(STILL) == pytest.approx(still)
    shaken = np.array(powers.under((1.0,) * 6))
    shares = config.imu.gyro_vibration_share, config.imu.accel_vibration_share
    assert shaken == pytest.approx(np.repeat(shares, 3) ** 2)


seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 3)


def problem(seed: int, size: int, gate_sigma: float = 1e6):
    """A well-conditioned covariance and a measurement of it."""
    rng = np.random.default_rng(seed)
    root, noise_root = rng.normal(size=(15, 30)), rng.normal(size=(size, 6))
    return root @ root.T / 30, Measurement(
        rng.normal(size=size),
        rng.normal(size=(size, 15)),
        noise_root @ noise_root.T / 6 + 0.1 * np.eye(size),
        gate_sigma,
    )


@given(seeds, sizes)
def test_update_is_the_information_form(seed, size):
    """P+ = (P^-1 + H' R^-1 H)^-1, error = P+ H' R^-1 innovation."""
    covariance, measurement = problem(seed, size)
    result = update(covariance, measurement)
    weight = measurement.design.T @ np.linalg.inv(measurement.noise)
    expected = np.linalg.inv(np.linalg.inv(covariance) + weight @ measurement.design)
    # Inversions of matrices whose condition is below 1e4: 1e4 roundings of 1e-16.
    np.testing.assert_allclose(result.covariance, expected, atol=1e-10)
    np.testing.assert_allclose(
        result.error, expected @ weight @ measurement.innovation, atol=1e-10
    )


@given(seeds, sizes)
def test_nearly_exact_measurement_stays_positive(seed, size):
    """Where (I - K H) P would lose its sign: noise 1e-12 of the covariance."""
    covariance, measurement = problem(seed, size)
    exact = measurement._replace(innovation=np.zeros(size), noise=1e-12 * np.eye(size))
    result = update(covariance, exact).covariance
    np.testing.assert_array_equal(result, result.T)
    assert np.linalg.eigvalsh(result)[0] > -1e-14


@given(seeds, sizes, st.floats(1, 10))
def test_ratio_is_the_squared_distance_over_the_limit(seed, size, gate_sigma):
    covariance, measurement = problem(seed, size, gate_sigma)
    spread = measurement.design @ covariance @ measurement.design.T + measurement.noise
    distance = measurement.innovation @ np.linalg.solve(spread, measurement.innovation)
    result = update(covariance, measurement)
    limit = chi_square_limit(gate_sigma, size)
    assert result.test_ratio == pytest.approx(distance / limit, rel=1e-9)
    assert (result.error is None) == (result.test_ratio > 1)


@given(seeds, sizes, st.floats(0.1, 10))
def test_ease_is_more_noise_behind_the_same_gate(seed, size, ease):
    """Noise larger by k H P H': at most 1 / (k + 1) of the innovation is corrected."""
    covariance, plain = problem(seed, size)
    predicted = plain.design @ covariance @ plain.design.T
    eased = update(covariance, plain._replace(ease=ease))
    expected = update(covariance, plain._replace(noise=plain.noise + ease * predicted))
    assert eased.test_ratio == update(covariance, plain).test_ratio
    np.testing.assert_allclose(eased.error, expected.error, atol=1e-12)
    np.testing.assert_allclose(eased.covariance, expected.covariance, atol=1e-12)
    exact = plain._replace(noise=1e-12 * np.eye(size), ease=ease)
    moved = plain.design @ update(covariance, exact).error
    # The condition of H P H' is below 1e4; noise is 1e-12 of it.
    np.testing.assert_allclose(moved, plain.innovation / (ease + 1), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("value", [math.nan, 1e200])
@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.filterwarnings("ignore:overflow")
def test_absurd_innovation_is_refused(value, size):
    innovation = np.zeros(size)
    innovation[-1] = value
    result = update(np.eye(15), Measurement(innovation, np.eye(15)[:size], np.eye(size), 1e6))
    assert result.error is None
    assert result.covariance is None
    assert not result.test_ratio <= 1


def test_noise_that_is_no_covariance_is_refused():
    """Correlation 3 between two axes: the squared distance becomes negative."""
    noise = np.array([[1.0, 3.0], [3.0, 1.0]])
    innovation = np.array([1.0, -1.0])
    result = update(1e-3 * np.eye(15), Measurement(innovation, np.eye(15)[:2], noise, 5.0))
    assert result.test_ratio < 0
    assert result.error is None


@pytest.mark.parametrize("degrees", [1, 2, 3])
@pytest.mark.parametrize("sigma", [1e-3, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 29.9, 35.0])
def test_limit_is_the_chi_squares(sigma, degrees):
    """As rare as ``sigma`` on both sides of a normal, by SciPy's logarithms of the tails."""
    tail = stats.chi2.logsf(chi_square_limit(sigma, degrees), degrees)
    # Beyond 30 sigma the limit leaves out a logarithm: 3 ln(35 / 30) of some 1200.
    rarer = 1e-3 if sigma > 30 else 1e-9
    assert tail == pytest.approx(math.log(2) + stats.norm.logsf(sigma), rel=rarer, abs=1e-12)
