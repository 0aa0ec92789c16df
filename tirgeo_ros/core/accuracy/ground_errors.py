"""How far off ground points come out: root mean squares by point and in all, circular error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array

#: The circular error that maps are judged by holds so many of the errors.
CIRCULAR_SHARE = 0.9


@dataclass(frozen=True)
class GroundErrors:
    """Horizontal errors of N measurements of ground points: located less surveyed."""

    ids: Sequence[str]  # N; a point that was measured more than once stands more than once
    error_en: Array  # (N, 2) east, north in a plane of metres

    @cached_property
    def distance_m(self) -> Array:
        """(N,) the length of each error."""
        return np.asarray(np.hypot(self.error_en[:, 0], self.error_en[:, 1]))

    @property
    def rmse_m(self) -> float | None:
        """Root mean square of all lengths; None without any."""
        return float(rms(self.distance_m)) if len(self.ids) else None

    @cached_property
    def point_rmse_m(self) -> dict[str, float]:
        """Equation 24 of Ren et al. 2022 for each point, over its measurements."""
        distances: dict[str, list[float]] = {name: [] for name in self.ids}
        for name, distance_m in zip(self.ids, self.distance_m.tolist(), strict=True):
            distances[name].append(distance_m)
        return {name: float(rms(d)) for name, d in distances.items()}

    @property
    def mean_point_rmse_m(self) -> float | None:
        """Mean of Equation 24 over the points, the last row of Table 6; None without any."""
        each = list(self.point_rmse_m.values())
        return float(np.mean(each)) if each else None

    @property
    def ce90_m(self) -> float | None:
        """The radius that holds 90 % of the errors; None without any.

        The 90th percentile of the lengths, linear between the two nearest of them.
        """
        if not len(self.distance_m):
            return None
        return float(np.quantile(self.distance_m, CIRCULAR_SHARE))

    @property
    def mean_error_en(self) -> Array | None:
        """(2,) what all errors have in common, east, north, m; None without any."""
        return np.asarray(self.error_en.mean(axis=0)) if len(self.error_en) else None


def rms(values: npt.ArrayLike) -> Array:
    """Return the root mean square over the first axis: (N, ...) to (...)."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))
