"""The update against the information form, its gate, and what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tirgeo_ros.core.navigation.kalman import Measurement, chi_square_limit, update

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
    found = update(covariance, measurement)
    weight = measurement.design.T @ np.linalg.inv(measurement.noise)
    expected = np.linalg.inv(np.linalg.inv(covariance) + weight @ measurement.design)
    # Inversions of matrices whose condition is below 1e4: 1e4 roundings of 1e-16.
    np.testing.assert_allclose(found.covariance, expected, atol=1e-10)
    np.testing.assert_allclose(found.error, expected @ weight @ measurement.innovation, atol=1e-10)


@given(seeds, sizes)
def test_nearly_exact_measurement_stays_positive(seed, size):
    """Where (I - K H) P would lose its sign: noise 1e-12 of the covariance."""
    covariance, measurement = problem(seed, size)
    exact = Measurement(
        np.zeros(size), measurement.design, 1e-12 * np.eye(size), measurement.gate_sigma
    )
    found = update(covariance, exact).covariance
    np.testing.assert_array_equal(found, found.T)
    assert np.linalg.eigvalsh(found)[0] > -1e-14


@given(seeds, sizes, st.floats(1, 10))
def test_ratio_is_the_squared_distance_over_the_limit(seed, size, gate_sigma):
    covariance, measurement = problem(seed, size, gate_sigma)
    spread = measurement.design @ covariance @ measurement.design.T + measurement.noise
    distance = measurement.innovation @ np.linalg.solve(spread, measurement.innovation)
    found = update(covariance, measurement)
    limit = chi_square_limit(gate_sigma, size)
    assert found.test_ratio == pytest.approx(distance / limit, rel=1e-9)
    assert (found.error is None) == (found.test_ratio > 1)


@given(seeds, sizes, st.floats(0.1, 10))
def test_ease_is_more_noise_behind_the_same_gate(seed, size, ease):
    """Noise larger by k H P H': of what is asked for, 1 / (k + 1) at the most."""
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
    found = update(np.eye(15), Measurement(innovation, np.eye(15)[:size], np.eye(size), 1e6))
    assert found.error is None
    assert found.covariance is None
    assert not found.test_ratio <= 1


def test_noise_that_is_no_covariance_is_refused():
    """Correlation 3 between two axes: the squared distance becomes negative."""
    noise = np.array([[1.0, 3.0], [3.0, 1.0]])
    innovation = np.array([1.0, -1.0])
    found = update(1e-3 * np.eye(15), Measurement(innovation, np.eye(15)[:2], noise, 5.0))
    assert found.test_ratio < 0
    assert found.error is None


@pytest.mark.parametrize("degrees", [1, 2, 3])
@pytest.mark.parametrize("sigma", [1e-3, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 29.9, 35.0])
def test_limit_is_the_chi_squares(sigma, degrees):
    """As rare as ``sigma`` on both sides of a normal, by SciPy's logarithms of the tails."""
    tail = stats.chi2.logsf(chi_square_limit(sigma, degrees), degrees)
    # Beyond 30 sigma the limit leaves out a logarithm: 3 ln(35 / 30) of some 1200.
    rarer = 1e-3 if sigma > 30 else 1e-9
    assert tail == pytest.approx(math.log(2) + stats.norm.logsf(sigma), rel=rarer, abs=1e-12)
