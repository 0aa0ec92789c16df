"""Splines and random processes have the derivatives and the statistics that they claim."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.tools.simulate.processes import (
    DEGREE,
    Spline,
    gauss_markov,
)


@given(st.lists(st.floats(-5, 5), min_size=2, max_size=4), st.floats(0.05, 3.0))
def test_a_spline_on_a_straight_line_is_that_line(slope, spacing_s):
    times = np.arange(30) * spacing_s
    line = Spline(np.outer(times, slope), spacing_s)
    # Uniform B-splines reproduce straight lines, where no edge is nearer than half the degree.
    inner = np.linspace(4 * spacing_s, 25 * spacing_s, 50)
    np.testing.assert_allclose(line(inner), np.outer(inner, slope), atol=1e-9)
    np.testing.assert_allclose(line(inner, 1), np.tile(slope, (50, 1)), atol=1e-9)
    np.testing.assert_allclose(line(inner, 2), 0.0, atol=1e-7)


@pytest.mark.parametrize("derivative", range(DEGREE - 2))
def test_each_derivative_is_the_difference_of_the_one_below(derivative):
    curve = Spline(np.random.default_rng(5).normal(size=(20, 2)), 0.5)
    times, h = np.linspace(-1.0, 11.0, 301), 1e-4
    slope = (curve(times + h, derivative) - curve(times - h, derivative)) / (2 * h)
    # Two derivatives above it is up to (2 / 0.5 s)^2 larger: h^2 / 6 of that is 3e-8 of the scale.
    scale = np.abs(slope).max()
    np.testing.assert_allclose(slope, curve(times, derivative + 1), atol=1e-5 * scale)


def test_gauss_markov_has_its_size_and_correlation_time():
    tau, std, step = np.array([2.0, 8.0]), np.array([3.0, 0.5]), 0.5
    x = gauss_markov(np.random.default_rng(1), 60_000, step, tau, std)
    # 30 000 s hold 30 000 / (2 tau) independent values: 1 sigma of the std is 1.2 % (tau 8 s).
    np.testing.assert_allclose(x.std(axis=0), std, rtol=4 * 0.012)
    lagged = (x[4:] * x[:-4]).mean(axis=0) / x.var(axis=0)
    np.testing.assert_allclose(lagged, np.exp(-4 * step / tau), atol=0.05)
