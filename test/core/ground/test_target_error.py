"""CE90 and LE90: against tables of the normal distribution, and by counting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.frames.rotations import rotation_z
from tirgeo_ros.core.ground.ground_point import circular_error_90, linear_error_90

RUNS = 200_000


def covariance(major_m, minor_m, azimuth_rad=0.0, down_m=1.0):
    turn = rotation_z(azimuth_rad)
    return turn @ np.diag([major_m**2, minor_m**2, down_m**2]) @ turn.T


@pytest.mark.parametrize(("minor", "table"), [(1.0, 2.1460), (0.5, 1.7371), (0.0, 1.6449)])
def test_tables(minor, table):
    """The last digit of the tables: a circle, half as wide as long, a line."""
    assert circular_error_90(covariance(3.0, 3.0 * minor)) == pytest.approx(3 * table, abs=3e-4)
    assert linear_error_90(covariance(1.0, 1.0, down_m=2.0)) == pytest.approx(2 * 1.6449, abs=2e-4)


@given(st.floats(0, 1), st.floats(0, math.pi), st.floats(1e-3, 1e3))
def test_nine_of_ten_are_within(ratio, azimuth, sigma):
    spread = covariance(sigma, sigma * ratio, azimuth)
    drawn = np.random.default_rng(5).standard_normal((RUNS, 2)) * [sigma, sigma * ratio]
    share = np.mean(np.hypot(*drawn.T) <= circular_error_90(spread))
    # Four standard deviations of a share of RUNS.
    assert share == pytest.approx(0.9, abs=4 * math.sqrt(0.09 / RUNS))


def test_nothing_known_and_nothing_wrong():
    assert circular_error_90(np.zeros((3, 3))) == 0.0
    assert linear_error_90(np.zeros((3, 3))) == 0.0
