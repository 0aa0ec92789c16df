"""Summarise the measured errors of ground points: rms by point and in all, circular error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array

#: The share of errors within the circular error CE90, the usual figure for maps.
CIRCULAR_SHARE = 0.9


@dataclass(frozen=True)
class GroundErrors:
    """Hold the horizontal errors of N measurements of ground points: located minus surveyed."""

    ids: Sequence[str]  # N; a point that was measured several times occurs several times
    error_en: Array  # (N, 2) east, north in a plane, m

    @cached_property
    def distance_m(self) -> Array:
        """Return the length (N,) of each error, m."""
        return np.asarray(np.hypot(self.error_en[:, 0], self.error_en[:, 1]))

    @property
    def rmse_m(self) -> float | None:
        """Return the rms of all errors, m; None without any."""
        return float(rms(self.distance_m)) if len(self.ids) else None

    @cached_property
    def point_rmse_m(self) -> dict[str, float]:
        """Return each point's rms error (m) over its measurements: Ren et al. 2022, Eq. 24."""
        distances: dict[str, list[float]] = {name: [] for name in self.ids}
        for name, distance_m in zip(self.ids, self.distance_m.tolist(), strict=True):
            distances[name].append(distance_m)
        return {name: float(rms(d)) for name, d in distances.items()}

    @property
    def mean_point_rmse_m(self) -> float | None:
        """Return the mean of Equation 24 over the points, m; None without any.

        It is the last row of Table 6.
        """
        each = list(self.point_rmse_m.values())
        return float(np.mean(each)) if each else None

    @property
    def ce90_m(self) -> float | None:
        """Return the circular error CE90, m: the radius that holds 90 % of the errors.

        It is the 90th percentile of the lengths, with linear interpolation; None without errors.
        """
        if not len(self.distance_m):
            return None
        return float(np.quantile(self.distance_m, CIRCULAR_SHARE))

    @property
    def mean_error_en(self) -> Array | None:
        """Return the mean error (2,), east, north, m: the common offset; None without any."""
        return np.asarray(self.error_en.mean(axis=0)) if len(self.error_en) else None


def rms(values: npt.ArrayLike) -> Array:
    """Return the root mean square over the first axis: (N, ...) to (...)."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))
