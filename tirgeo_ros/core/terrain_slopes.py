"""How steep an elevation model is around a point, over steps of any length."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.terrain import Terrain

_PROBE_M = 1.0


class Slopes:
    """The terrain around a point (3,), NED in the map's plane.

    ``axes_n`` (3, 3) are north, east and down at the point, as columns. ``cell_m`` is about the
    longer side of a cell there.
    """

    def __init__(
        self, terrain: Terrain, plane: TangentPlane, point_n: Array, axes_n: Array
    ) -> None:
        self._terrain, self._axes_n = terrain, axes_n
        probes_n = point_n + _PROBE_M * np.vstack([np.zeros(3), axes_n.T[:2]])
        latitude, longitude, _ = plane.geodetic_from_ned(probes_n)
        grid = np.stack(terrain.grid_of(latitude, longitude))
        self._place = grid[:, 0]
        self._by_m = (grid[:, 1:] - grid[:, :1]) / _PROBE_M  # columns and rows a metre
        self.cell_m = 1.0 / max(float(np.hypot(*self._by_m).min()), 1e-9)

    def normal_n(self, step_m: float) -> Array:
        """(3,) the surface's normal, 1 along up, from differences over a step to both sides.

        Beside the model or a gap over the other side alone; level where both lack, as a model of
        one cell has no more to say.
        """
        steps = step_m * np.array([0.0, -1.0, 1.0])
        column, row = self._place[:, None, None] + self._by_m[:, :, None] * steps
        here, before, after = self._terrain.at(column, row).T
        rises = np.stack([here - before, after - here])
        known = np.isfinite(rises)
        slopes = np.where(known, rises, 0.0).sum(0) / (np.maximum(known.sum(0), 1) * step_m)
        normal: Array = -self._axes_n[:, 2] - self._axes_n[:, :2] @ slopes
        return normal
