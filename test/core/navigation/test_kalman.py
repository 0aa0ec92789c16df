"""The update against the information form, its gate, and what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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
def test_covariance_stays_symmetric_and_positive_and_shrinks(seed, size):
    covariance, measurement = problem(seed, size)
    found = update(covariance, measurement).covariance
    np.testing.assert_array_equal(found, found.T)
    assert np.linalg.eigvalsh(found)[0] > 0
    assert np.linalg.eigvalsh(covariance - found)[0] > -1e-13


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


def test_one_dimension_by_hand():
    covariance = np.diag(np.r_[4.0, np.ones(14)])
    design = np.zeros((1, 15))
    design[0, 0] = 1.0
    found = update(covariance, Measurement(np.array([1.0]), design, np.array([[1.0]]), 3.0))
    assert found.error[0] == pytest.approx(0.8)  # gain 4 / 5
    assert found.covariance[0, 0] == pytest.approx(0.8)
    assert found.test_ratio == pytest.approx(1 / 5 / 9)  # 1^2 / (4 + 1), over 3 sigma squared
    np.testing.assert_array_equal(found.error[1:], 0)
    np.testing.assert_array_equal(np.diag(found.covariance)[1:], 1)


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


def test_five_eased_updates_are_five_equal_steps():
    """An exact measurement that is asked for again and again: a fifth, a quarter, ... all."""
    covariance, place = np.eye(15), 0.0
    places = []
    for ease in (4.0, 3.0, 2.0, 1.0, 0.0):
        innovation = np.array([1.0 - place])
        noise = np.array([[1e-12]])
        found = update(covariance, Measurement(innovation, np.eye(15)[:1], noise, 1e6, ease))
        place += found.error[0]
        covariance = found.covariance
        places.append(place)
    # With P in the gain 1 / (k + 1) and 1e-12 of noise.
    assert places == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0], abs=1e-10)


@pytest.mark.parametrize(("off", "accepted"), [(-1e-9, True), (1e-9, False)])
def test_gate_is_at_its_sigma(off, accepted):
    design = np.eye(15)[:1]
    innovation = np.array([5 * math.sqrt(2) * (1 + off)])
    found = update(np.eye(15), Measurement(innovation, design, np.eye(1), 5.0))
    assert (found.error is not None) is accepted
    assert (found.covariance is not None) is accepted


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


@pytest.mark.parametrize(
    ("probability", "degrees", "printed"),
    [
        # Abramowitz and Stegun, table 26.8: percentage points of the chi-square distribution.
        (0.05, 1, "3.84146"),
        (0.05, 2, "5.99146"),
        (0.05, 3, "7.81473"),
        (0.01, 1, "6.63490"),
        (0.01, 2, "9.21034"),
        (0.01, 3, "11.3449"),
        (0.001, 1, "10.828"),
        (0.001, 2, "13.816"),
        (0.001, 3, "16.266"),
    ],
)
def test_limit_against_the_tables(probability, degrees, printed):
    half_a_digit = 0.5 * 10.0 ** -len(printed.partition(".")[2])
    limit = chi_square_limit(sigma_of(probability), degrees)
    assert limit == pytest.approx(float(printed), abs=half_a_digit)


def sigma_of(probability: float) -> float:
    """The standard deviations that are exceeded, on both sides together, this rarely."""
    low, high = 0.0, 10.0
    for _ in range(60):
        middle = (low + high) / 2
        rarer = math.erfc(middle / math.sqrt(2)) < probability
        low, high = (low, middle) if rarer else (middle, high)
    return low


@given(st.floats(1, 1e6))
def test_limit_of_one_degree_is_the_square(sigma):
    assert chi_square_limit(sigma, 1) == pytest.approx(sigma**2, rel=1e-12)


@given(st.floats(1, 30))
def test_limit_of_two_degrees_is_a_logarithm(sigma):
    expected = -2 * math.log(math.erfc(sigma / math.sqrt(2)))
    assert chi_square_limit(sigma, 2) == pytest.approx(expected, rel=1e-12)


@given(st.floats(1, 1e6), st.floats(1, 1.5))
def test_limit_grows_with_sigma_and_degrees(sigma, factor):
    limits = [chi_square_limit(sigma, degrees) for degrees in (1, 2, 3)]
    assert limits == sorted(limits)
    for degrees, limit in enumerate(limits, start=1):
        assert chi_square_limit(sigma * factor, degrees) >= limit * (1 - 1e-12)


def test_three_degrees_by_counting():
    """A Monte Carlo of a million draws: 2 sigma, so 4.55 % beyond, with sigma 0.02 %."""
    draws = np.random.default_rng(1).normal(size=(1_000_000, 3))
    beyond = np.mean((draws**2).sum(1) > chi_square_limit(2.0, 3))
    assert beyond == pytest.approx(math.erfc(math.sqrt(2)), abs=4 * 2.1e-4)
