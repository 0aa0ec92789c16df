"""Thirty seeded flights of three shapes: accuracy, and whether the covariance is honest.

The half of ``make consistency`` with the IMU at 100 Hz, and the statistics themselves.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from dev.consistency import (
    ASKED_POSITION_M,
    ASKED_RATIO,
    ASKED_RPY_DEG,
    groups,
    report,
)
from dev.flight_errors import STATE_NAMES
from dev.monte_carlo import (
    Case,
    cases,
    chi_square_bounds,
    fly_all,
    fly_case,
    pooled,
    pooled_nis,
)
from tirgeo_ros.core.types.measurements import Source

pytestmark = [pytest.mark.slow, pytest.mark.long]

SEEDS, DURATION_S = 10, 107.0


@pytest.fixture(scope="module")
def found():
    return fly_all(cases(SEEDS, [100.0], DURATION_S), workers=2)


@pytest.fixture(scope="module")
def one():
    return fly_case(Case("lawnmower", 100.0, 5, 40.0))


def test_accuracy_is_the_one_that_is_asked(found):
    by_shape = groups(found)
    assert [len(flights) for flights in by_shape.values()] == [SEEDS] * 3
    for name, flights in by_shape.items():
        rpy_deg = np.degrees(pooled(flights, "rpy_ms"))
        assert (rpy_deg <= ASKED_RPY_DEG).all(), f"{name}: roll, pitch, heading {rpy_deg} deg"
        position_m = pooled(flights, "position_ms")
        assert (position_m <= ASKED_POSITION_M).all(), f"{name}: position {position_m} m"


def test_errors_are_as_large_as_the_filter_says(found):
    low, high = ASKED_RATIO
    for name, ratio in zip(STATE_NAMES, pooled(found, "ratio_ms"), strict=True):
        assert low <= ratio <= high, f"{name}: error over sigma {ratio:.2f}"


def test_nees_is_chi_square(found):
    """One value of nine degrees a flight, at its end: 270 that have nothing in common."""
    degrees = len(STATE_NAMES) * len(found)
    low, high = chi_square_bounds(degrees)
    assert low <= sum(each.nees for each in found) / degrees <= high


@pytest.mark.parametrize("source", [Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING])
def test_nis_is_chi_square(found, source):
    """5 Hz after 20 s: 13 000 degrees of position and of velocity, 4350 * 3 of heading."""
    nis = pooled_nis(found)[source]
    axes = 1 if source is Source.RTK_HEADING else 3
    assert nis.degrees >= axes * len(found) * (DURATION_S - 21.0) * 5
    low, high = chi_square_bounds(nis.degrees)
    assert low <= nis.ratio <= high


@pytest.mark.parametrize(
    ("values", "source", "wanted"),
    [
        # The position's noise is 0.01, 0.01, 0.02 m: with 0.04 m on each axis squares are less
        # than a fourth of what they should be.
        ({"rtk__position_sigma_floor_m": 0.04}, Source.RTK_POSITION, "small"),
        # A delay of 0.1 s that is none: at 3 m/s the positions are 0.3 m off.
        ({"rtk__delay_s": 0.1}, Source.RTK_POSITION, "large"),
    ],
)
def test_a_filter_that_is_wrong_about_its_noise_is_found_out(one, values, source, wanted):
    nis = fly_case(one.case, **values).nis[source]
    low, high = chi_square_bounds(nis.degrees)
    assert nis.ratio < low if wanted == "small" else nis.ratio > high


def test_report_marks_what_is_missed(one):
    lines, missed = report([one])
    assert missed == sum(line.count("!") for line in lines)
    bad = type(one)(
        one.case, np.full(3, 1e-2), one.position_ms, np.full(9, 4.0), math.nan, one.nis
    )
    lines, now_missed = report([bad])
    text = "\n".join(lines)
    assert "5.730!" in text  # 0.1 rad
    assert "2.00!" in text
    assert "-!" in text
    assert now_missed >= 3 + 9 + 1


def test_bounds_are_those_of_the_tables():
    """Quantiles of 0.1 and 99.9 %, from any table of chi-square: 30 and 100 degrees."""
    for degrees, low, high in ((30, 11.588, 59.703), (100, 61.918, 149.449)):
        found = chi_square_bounds(degrees, sigma=3.0902)
        assert found == pytest.approx((low / degrees, high / degrees), rel=0.01)
