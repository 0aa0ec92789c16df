"""Errors of ground points: Equation 24, means, the circular error."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tirgeo_ros.core.accuracy.ground_errors import GroundErrors


def test_equation_24_over_each_point():
    errors = GroundErrors(["B", "A", "A"], np.array([[0.0, 2.0], [3.0, 4.0], [0.0, 1.0]]))
    assert errors.point_rmse_m == {"B": pytest.approx(2), "A": pytest.approx(math.sqrt(13))}
    assert list(errors.point_rmse_m) == ["B", "A"]
    assert errors.mean_point_rmse_m == pytest.approx((math.sqrt(13) + 2) / 2)
    assert errors.rmse_m == pytest.approx(math.sqrt(30 / 3))
    np.testing.assert_allclose(errors.mean_error_en, [1, 7 / 3])


def test_the_circular_error_of_a_known_distribution():
    """Of a round Gaussian it is 2.146 sigma, as the tables of map accuracy say."""
    count, sigma = 40_000, 0.7
    errors = np.random.default_rng(8).normal(scale=sigma, size=(count, 2))
    found = GroundErrors(["P"] * count, errors)
    radius = sigma * math.sqrt(-2 * math.log(0.1))
    # 4 sigma of the quantile: sqrt(0.9 * 0.1 / N) over the density 0.1 * radius / sigma2 there
    slack = 4 * math.sqrt(0.09 / count) * sigma**2 / (0.1 * radius)
    assert found.ce90_m == pytest.approx(radius, abs=slack)


def test_nothing_located_is_no_number():
    errors = GroundErrors([], np.empty((0, 2)))
    assert errors.rmse_m is errors.mean_point_rmse_m is errors.ce90_m is None
    assert errors.mean_error_en is None
    assert errors.point_rmse_m == {}
