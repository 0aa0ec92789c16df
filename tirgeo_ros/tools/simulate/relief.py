"""Model ground that slopes evenly, and write it as an elevation model.

Heights are above the plane of the site, and 0 at its origin. A flight stays above all ground.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.scenario_ground import ParkScenario

_NODE_DEG = 1e-5  # of the elevation model: 1.1 m along a meridian

Floats = npt.NDArray[np.floating]


class Relief:
    """Compute heights of the ground."""

    def __init__(self, scenario: ParkScenario) -> None:
        edges = np.array([scenario.north_m, scenario.east_m]).T
        #: South-western and north-eastern corner of the ground: north, east (2, 2).
        self.corners: Array = edges + scenario.margin_m * np.array([[-1.0], [1.0]])
        uphill = math.radians(scenario.uphill_deg)
        rise = math.tan(math.radians(scenario.slope_deg))
        self._rise = rise * math.cos(uphill), rise * math.sin(uphill)
        self.highest_m = float((self.corners * self._rise).max(axis=0).sum())

    @property
    def is_level(self) -> bool:
        """Return whether it is the plane of the site."""
        return not any(self._rise)

    def places(self, level: Array) -> Array:
        """Return ground points (N, 3) in the plane of the site at north and east (N, 2)."""
        return np.column_stack([level, -level @ self._rise])

    def met(self, position_p: Floats, rays_p: Floats) -> tuple[Floats, Floats]:
        """Return the height (m) of a point (3,) over the ground there, and the loss of it (N,).

        The loss is along each ray (N, 3); the ray meets the ground where it has lost all.
        """
        # Python floats keep arrays in single precision, which is much faster.
        north, east = self._rise
        height = -(position_p[2] + north * position_p[0] + east * position_p[1])
        return height, rays_p[:, 2] + north * rays_p[:, 0] + east * rays_p[:, 1]


def elevation_text(relief: Relief, plane: TangentPlane) -> str:
    """Return the ground as an ESRI ASCII grid of WGS84 degrees, ellipsoidal heights."""
    lat, lon, _ = plane.geodetic_from_ned(np.pad(relief.corners, ((0, 0), (0, 1))))
    (south, north), (west, east) = np.degrees(lat), np.degrees(lon)
    rows, columns = (math.ceil(span / _NODE_DEG) + 1 for span in (north - south, east - west))
    lons = np.radians(west + _NODE_DEG * np.arange(columns))
    lines = [
        f"ncols {columns}",
        f"nrows {rows}",
        f"xllcenter {west:.10f}",
        f"yllcenter {south:.10f}",
        f"cellsize {_NODE_DEG:.10f}",
    ]
    for row in reversed(range(rows)):
        row_lat = np.full(columns, math.radians(south + _NODE_DEG * row))
        level = plane.ned_from_geodetic(row_lat, lons, np.full(columns, plane.height_m))
        _, _, height = plane.geodetic_from_ned(relief.places(level[:, :2]))
        lines.append(" ".join(f"{one:.3f}" for one in height.tolist()))
    return "\n".join(lines) + "\n"


#: The level ground of the paper's flight.
LEVEL = Relief(ParkScenario())
#: Text of a ``.prj`` file beside an elevation model in WGS84 degrees.
WGS84_TEXT = (
    'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]\n'
)
