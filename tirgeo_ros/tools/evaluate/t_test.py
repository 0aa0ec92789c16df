"""Run the paired t-test of Table 7, whether two methods' errors differ by more than chance.

The pairs are a point's root mean square errors (Eq. 24) under both methods.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    differences = np.array([errors_m[first][name] - errors_m[second][name] for name in common])
    mean = float(differences.mean()) if common else None
    if len(common) < 2:
        return PairedTest(first, second, len(common), mean, None, None, "fewer than 2 points")
    if np.ptp(differences) <= _ALIKE_M:
        note = "all differences are alike"
        return PairedTest(first, second, len(common), mean, None, None, note)
    from scipy import stats  # noqa: PLC0415  slow to import

    columns = [[errors_m[method][name] for name in common] for method in (first, second)]
    found = stats.ttest_rel(*columns)
    return PairedTest(
        first, second, len(common), mean, float(found.statistic), float(found.pvalue), ""
    )


def paired_tests(errors_m: Mapping[str, Mapping[str, float]]) -> Sequence[PairedTest]:
    """Compare each pair of methods once, in their order."""
    return [paired_test(a, b, errors_m) for a, b in combinations(errors_m, 2)]
