"""Elevation models of tests: grids along meridians and parallels."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.ground.dem import GridOf
from tirgeo_ros.core.types.arrays import Array


def graticule(
    south_west_deg: tuple[float, float], step_deg: tuple[float, float], rows: int
) -> GridOf:
    """Return ``grid_of`` for a grid along meridians and parallels, its first row in the north.

    The first two arguments are (latitude, longitude): the grid's south-western node and its step.
    ``rows`` is its number of rows.
    """
    south, west = south_west_deg
    step_lat, step_lon = step_deg

    def grid_of(latitude_rad: Array, longitude_rad: Array) -> tuple[Array, Array]:
        turned = np.degrees(longitude_rad) - west
        # Wrap to [-90, 270) deg east of the grid's west edge.
        turned = (turned + 90.0) % 360.0 - 90.0
        return turned / step_lon, rows - 1 - (np.degrees(latitude_rad) - south) / step_lat

    return grid_of
