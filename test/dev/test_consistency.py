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
"""Thirty seeded flights of three shapes: accuracy, and whether the covariance is honest.

The half of ``make consistency`` with the IMU at 100 Hz, and the statistics themselves.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dev.consistency import (
    Case,
    cases,
    chi_square_bounds,
    fly_case,
    groups,
    pooled_nis,
    report,
)
from dev.judging import in_processes
from tirgeo_ros.core.types.measurements import Source

pytestmark = [pytest.mark.slow, pytest.mark.long]

SEEDS, DURATION_S = 10, 107.0


@pytest.fixture(scope="module")
def found():
    return in_processes(fly_case, cases(SEEDS, [100.0], DURATION_S), workers=2)


@pytest.fixture(scope="module")
def one():
    return fly_case(Case("lawnmower", 100.0, 5, 40.0))


def test_thirty_flights_miss_no_figure(found):
    """Accuracy by shape, error over sigma by state; NEES and NIS within bounds of 99.9 %."""
    assert [len(flights) for flights in groups(found).values()] == [SEEDS] * 3
    lines, missed = report(found)
    assert not missed, "\n".join(lines)
    for source, nis in pooled_nis(found).items():
        # 5 Hz after 20 s: 13 000 degrees of position and of velocity, 4350 of heading.
        axes = 1 if source is Source.RTK_HEADING else 3
        assert nis.degrees >= axes * len(found) * (DURATION_S - 21.0) * 5


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
    squares = replace(one.squares, rpy=np.full(3, 1e-2), ratio=np.full(9, 4.0))
    bad = replace(one, squares=squares, nees=math.nan)
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
