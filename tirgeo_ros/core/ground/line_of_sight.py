"""Find which points of an elevation model the camera sees, and which it does not."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.types.arrays import Array, BoolArray

#: Places along a line of sight at which the terrain is compared with it.
_PLACES = 48
#: The terrain hides what is behind it if it is this much higher than the line of sight: elevation
#: models are hardly ever better, and the point itself lies on the surface.
_CLEAR_M = 0.1


def hidden(terrain: Terrain, plane: TangentPlane, eye_n: Array, points_n: Array) -> BoolArray:
    """Return for points (N, 3) of the terrain whether it hides them from a place ``eye_n`` (3,).

    Both are NED in the map's plane, m. Between the ends column, row and height are taken as
    linear: the height is then off by 2 cm in the middle of a line of 1 km. An obstacle shorter
    than a 48th of the line may be missed. A place without a height hides nothing.
    """
    ends = np.concatenate([np.asarray(points_n), np.asarray(eye_n)[None]])
    latitude, longitude, height = plane.geodetic_from_ned(ends)
    column, row = terrain.grid_of(latitude, longitude)
    share = np.arange(1, _PLACES) / _PLACES
    columns, rows, heights = (
        ends[:-1, None] + share * (ends[-1] - ends[:-1, None]) for ends in (column, row, height)
    )
    with np.errstate(invalid="ignore"):
        above = terrain.at(columns, rows) > heights + _CLEAR_M
    return np.asarray(above.any(axis=1))
