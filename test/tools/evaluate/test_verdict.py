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
"""The sentence on an evaluation, and the paired t-test on the paper's own columns."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from dev.reproduction.paper import TABLE_6_AVERAGE_M, TABLE_6_M, TABLE_7
from tirgeo_ros.core.ground.ground_point import Ellipse
from tirgeo_ros.tools.evaluate.report import is_honest, verdict
from tirgeo_ros.tools.evaluate.result import LocatedPoint, ground_errors, paired_tests

COUNT = 24


def method(*, sigma_m, pictures=COUNT, error_m=3.0):
    """A method's points, each with an error to the east and a circular sigma."""
    located = [
        LocatedPoint(
            *(f"P{k}", k % pictures, (0.0, 0.0), np.zeros(2), 0.0, np.array([error_m, 0.0])),
            sigma_m**2 * np.eye(2),
            Ellipse(1.0, 1.0, 0.0),
        )
        for k in range(COUNT)
    ]
    return SimpleNamespace(
        method="ekf", located=located, refused=[], errors=ground_errors(located)
    )


@pytest.mark.parametrize(
    ("points", "text"),
    [
        (
            {"sigma_m": 2.0},
            r"24 of 24 lie in their ellipse of 95 %, 3\.00 m off on average \(ekf\)",
        ),
        (
            {"sigma_m": 0.1},
            r"0 of 24 .* error of \+3\.00 m east and \+0\.00 m north.* boresight.*",
        ),
        ({"sigma_m": 0.1, "pictures": 1}, r"0 of 24 .* 3\.00 m off on average \(ekf\)"),
        ({"sigma_m": 0.1, "error_m": 430e3}, "the observed .* 430 km from the surveyed .*"),
    ],
)
def test_the_verdict_says_whether_errors_are_as_predicted(points, text):
    assert re.fullmatch(text, verdict([method(**points)]))


def test_shares_that_are_chance_with_ellipses_of_95_percent():
    # binomial with 0.95: at most 54 of 60 in 8 of 100 experiments, at most 50 in 1 of 900
    assert is_honest(54 / 60, 60)
    assert not is_honest(50 / 60, 60)
    assert is_honest(50 / 60, 6)  # all of one picture share its pose


def test_the_columns_of_table_6_give_table_7():
    result = {(item.first, item.second): item for item in paired_tests(TABLE_6_M)}
    assert len(result) == 6
    assert round(result["raw", "rtk"].p_value, 4) == TABLE_7["raw", "rtk"] == 0.0008
    proposed = ("ekf", "ekf_heading")
    assert round(result[proposed].p_value, 4) == TABLE_7[proposed] == 0.0005
    for pair in (("rtk", "ekf"), ("rtk", "ekf_heading")):  # printed at the printer's smallest
        assert result[pair].p_value < TABLE_7[pair]
    assert all(item.points == 20 and not item.note for item in result.values())
    for method, column in TABLE_6_M.items():
        # printed to two decimals, of values printed to two decimals
        assert np.mean(list(column.values())) == pytest.approx(TABLE_6_AVERAGE_M[method], abs=0.01)


def test_only_points_of_both_methods_are_compared():
    first = {"a": 3.0, "b": 5.0, "c": 4.0, "only here": 900.0}
    second = {"c": 2.5, "b": 2.0, "a": 2.0, "only there": 0.0}
    (result,) = paired_tests({"x": first, "y": second})
    # differences 1, 3, 1.5: mean 11/6, standard deviation of 3; t by hand
    differences = np.array([1.0, 3.0, 1.5])
    t = differences.mean() / (differences.std(ddof=1) / math.sqrt(3))
    assert (result.points, result.note) == (3, "")
    assert result.mean_difference_m == pytest.approx(11 / 6)
    assert result.t == pytest.approx(t, rel=1e-12)
    # two degrees of freedom have a closed form
    assert result.p_value == pytest.approx(1 - t / math.sqrt(2 + t * t), rel=1e-9)


@pytest.mark.parametrize(
    ("first", "second", "points", "mean", "note"),
    [
        ({"a": 1.0}, {"b": 1.0}, 0, None, "fewer than 2 points"),
        ({"a": 3.0, "b": 1.0}, {"a": 1.0}, 1, 2.0, "fewer than 2 points"),
        ({"a": 0.3, "b": 0.1}, {"a": 0.2, "b": 0.0}, 2, 0.1, "all differences are equal"),
    ],
)
def test_too_few_or_equal_differences_have_no_p_value(first, second, points, mean, note):
    (result,) = paired_tests({"x": first, "y": second})  # a RuntimeWarning is an error here
    assert (result.points, result.t, result.p_value, result.note) == (points, None, None, note)
    assert result.mean_difference_m == (None if mean is None else pytest.approx(mean))
