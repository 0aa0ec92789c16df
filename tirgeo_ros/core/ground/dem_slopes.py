"""Measure the slope of an elevation model around a point, over steps of any length."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.frames.wgs84 import earth_at
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.types.arrays import Array

_PROBE_M = 1.0


class Slopes:
    """Measure the terrain's slope around one place, given by latitude and longitude (rad).

    ``axes_n`` (3, 3) has north, east and down at that place as columns. ``cell_m`` is about the
    longer side of a cell there.
    """

    def __init__(
        self, terrain: Terrain, latitude_rad: float, longitude_rad: float, axes_n: Array
    ) -> None:
        self._terrain, self._axes_n = terrain, axes_n
        _, cosine, meridian_m, transverse_m, _ = earth_at(latitude_rad, 0.0)
        north_rad = _PROBE_M / meridian_m
        east_rad = _PROBE_M / max(transverse_m * cosine, _PROBE_M)
        latitudes = np.array([latitude_rad, latitude_rad + north_rad, latitude_rad])
        longitudes = np.array([longitude_rad, longitude_rad, longitude_rad + east_rad])
        columns, rows = (x.tolist() for x in terrain.grid_of(latitudes, longitudes))
        by_m = [[x[k] - x[0] for k in (1, 2)] for x in (columns, rows)]
        self._place = np.array([columns[0], rows[0]])
        self._by_m = np.array(by_m) / _PROBE_M  # (2, 2) columns and rows per metre north and east
        least = min(math.hypot(by_m[0][k], by_m[1][k]) for k in (0, 1)) / _PROBE_M
        self.cell_m = 1.0 / max(least, 1e-9)

    def normal_n(self, step_m: float) -> Array:
        """Return the surface's normal (3,), with 1 along up, from differences over a step (m).

        The differences are to both sides. Where one side has no height (edge or gap), the other
        side is used alone. Where neither has one, the surface counts as level in that direction.
        """
        steps = step_m * np.array([0.0, -1.0, 1.0])
        column, row = self._place[:, None, None] + self._by_m[:, :, None] * steps
        heights = self._terrain.at(column, row).tolist()
        slopes = [_rise(before, here, after) / step_m for here, before, after in heights]
        normal: Array = -self._axes_n[:, 2] - self._axes_n[:, :2] @ slopes
        return normal


def _rise(before: float, here: float, after: float) -> float:
    """Return the mean of the known rises before and after a place; 0 if none is known."""
    rises = [x for x in (here - before, after - here) if math.isfinite(x)]
    return sum(rises) / max(len(rises), 1)
