"""Run the paired t-test of Table 7, whether two methods' errors differ by more than chance.

The pairs are a point's root mean square errors (Eq. 24) under both methods.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

#: Differences within this are equal: a nanometre is rounding.
_ALIKE_M = 1e-9


class PairedTest(NamedTuple):
    """Hold the comparison of two methods over the points that both have."""

    first: str
    second: str
    points: int
    mean_difference_m: float | None  # first minus second
    t: float | None
    p_value: float | None  # two-sided
    note: str  # why there is no p-value, else empty


def paired_tests(errors_m: Mapping[str, Mapping[str, float]]) -> list[PairedTest]:
    """Compare each pair of methods once, in order; ``errors_m`` is method -> point -> error."""
    from scipy import stats  # noqa: PLC0415  slow to import

    tests = []
    for first, second in combinations(errors_m, 2):
        common = sorted(errors_m[first].keys() & errors_m[second].keys())
        columns = [np.array([errors_m[one][point] for point in common]) for one in (first, second)]
        apart_m = columns[0] - columns[1]
        mean_m = float(apart_m.mean()) if common else None
        t, p_value, note = None, None, ""
        if len(common) < 2:
            note = "fewer than 2 points"
        elif np.ptp(apart_m) <= _ALIKE_M:
            note = "all differences are alike"
        else:
            found = stats.ttest_rel(*columns)
            t, p_value = float(found.statistic), float(found.pvalue)
        tests.append(PairedTest(first, second, len(common), mean_m, t, p_value, note))
    return tests
