"""The paired t-test: the paper's own columns, and columns that no test can be made of."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dev.paper_tables import TABLE_6_AVERAGE_M, TABLE_6_M, TABLE_7
from tirgeo_ros.tools.evaluate.result import paired_tests


def test_the_columns_of_table_6_give_table_7():
    found = {(one.first, one.second): one for one in paired_tests(TABLE_6_M)}
    assert len(found) == 6
    assert round(found["raw", "rtk"].p_value, 4) == TABLE_7["raw", "rtk"] == 0.0008
    proposed = ("ekf", "ekf_heading")
    assert round(found[proposed].p_value, 4) == TABLE_7[proposed] == 0.0005
    for pair in (("rtk", "ekf"), ("rtk", "ekf_heading")):  # printed at the printer's smallest
        assert found[pair].p_value < TABLE_7[pair]
    assert all(one.points == 20 and not one.note for one in found.values())
    for method, column in TABLE_6_M.items():
        # printed to two decimals, of values printed to two decimals
        assert np.mean(list(column.values())) == pytest.approx(TABLE_6_AVERAGE_M[method], abs=0.01)


def test_only_points_that_both_have_are_compared():
    first = {"a": 3.0, "b": 5.0, "c": 4.0, "only here": 900.0}
    second = {"c": 2.5, "b": 2.0, "a": 2.0, "only there": 0.0}
    (found,) = paired_tests({"x": first, "y": second})
    # differences 1, 3, 1.5: mean 11/6, standard deviation of 3; t by hand
    differences = np.array([1.0, 3.0, 1.5])
    t = differences.mean() / (differences.std(ddof=1) / math.sqrt(3))
    assert (found.points, found.note) == (3, "")
    assert found.mean_difference_m == pytest.approx(11 / 6)
    assert found.t == pytest.approx(t, rel=1e-12)
    # two degrees of freedom have a closed form
    assert found.p_value == pytest.approx(1 - t / math.sqrt(2 + t * t), rel=1e-9)


@pytest.mark.parametrize(
    ("first", "second", "points", "mean", "note"),
    [
        ({"a": 1.0}, {"b": 1.0}, 0, None, "fewer than 2 points"),
        ({"a": 3.0, "b": 1.0}, {"a": 1.0}, 1, 2.0, "fewer than 2 points"),
        ({"a": 0.3, "b": 0.1}, {"a": 0.2, "b": 0.0}, 2, 0.1, "all differences are alike"),
    ],
)
def test_what_no_test_can_be_made_of_has_no_p_value(first, second, points, mean, note):
    (found,) = paired_tests({"x": first, "y": second})  # a RuntimeWarning is an error here
    assert (found.points, found.t, found.p_value, found.note) == (points, None, None, note)
    assert found.mean_difference_m == (None if mean is None else pytest.approx(mean))
