"""Run the paired t-test of Table 7, whether two methods' errors differ by more than chance.

The pairs are a point's root mean square errors (Eq. 24) under both methods.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

#: Differences within this are equal: a nanometre is rounding.
_ALIKE_M = 1e-9


@dataclass(frozen=True, slots=True)
class PairedTest:
    """Hold the comparison of two methods over the points that both have."""

    first: str
    second: str
    points: int
    mean_difference_m: float | None  # first minus second
    t: float | None
    p_value: float | None  # two-sided
    note: str  # why there is no p-value, else empty


def paired_test(
    first: str, second: str, errors_m: Mapping[str, Mapping[str, float]]
) -> PairedTest:
    """Compare two methods; ``errors_m`` is method -> point -> error."""
    common = sorted(errors_m[first].keys() & errors_m[second].keys())
    columns = [np.array([errors_m[name][point] for point in common]) for name in (first, second)]
    differences = columns[0] - columns[1]
    mean = float(differences.mean()) if common else None
    note = ""
    if len(common) < 2:
        note = "fewer than 2 points"
    elif np.ptp(differences) <= _ALIKE_M:
        note = "all differences are alike"
    if note:
        return PairedTest(first, second, len(common), mean, None, None, note)
    from scipy import stats  # noqa: PLC0415  slow to import

    found = stats.ttest_rel(*columns)
    t, p_value = float(found.statistic), float(found.pvalue)
    return PairedTest(first, second, len(common), mean, t, p_value, "")


def paired_tests(errors_m: Mapping[str, Mapping[str, float]]) -> list[PairedTest]:
    """Compare each pair of methods once, in their order."""
    return [paired_test(a, b, errors_m) for a, b in combinations(errors_m, 2)]
