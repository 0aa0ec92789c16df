"""Model ground that is not level, a slope with hills, and find where rays meet it.

Heights are above the plane of the site, and 0 at its origin. A flight stays above all ground.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.scenario_ground import ParkScenario

_STEPS = 32  # search steps of a ray between the highest and the lowest ground
_SETTLING = 4  # secant steps; each reduces the interval to about a hundredth
_NODE_DEG = 1e-5  # of the elevation model: 1.1 m along a meridian

Floats = npt.NDArray[np.floating]


class Relief:
    """Compute heights of the ground as a smooth function of position."""

    def __init__(self, scenario: ParkScenario, seed: int) -> None:
        """Draw where the hills lie."""
        margin_m = scenario.margin_m
        self._low = scenario.north_m[0] - margin_m, scenario.east_m[0] - margin_m
        self._high = scenario.north_m[1] + margin_m, scenario.east_m[1] + margin_m
        uphill = math.radians(scenario.uphill_deg)
        rise = math.tan(math.radians(scenario.slope_deg))
        self._rise = rise * math.cos(uphill), rise * math.sin(uphill)
        self._hills_m = scenario.hills_m
        self._per_m = 2 * math.pi / scenario.hill_size_m
        self._phase = generator(seed, "hills").uniform(0.0, 2 * math.pi, 2).tolist()
        self._at_origin = math.sin(self._phase[0]) * math.sin(self._phase[1])
        ends = np.array([self._low, self._high]) * self._rise
        self.lowest_m = float(ends.min(axis=0).sum()) - self._hills_m * (1 + self._at_origin)
        self.highest_m = float(ends.max(axis=0).sum()) + self._hills_m * (1 - self._at_origin)

    @property
    def corners(self) -> Array:
        """Return the ground's south-western and north-eastern corner: north, east (2, 2)."""
        return np.array([self._low, self._high])

    @property
    def is_level(self) -> bool:
        """Return whether it is the plane of the site."""
        return not any(self._rise) and not self._hills_m

    def height_m(self, north: Floats, east: Floats) -> Floats:
        """Return heights at positions of any shape.

        Outside the painted ground those of its edge.
        """
        # Python floats keep arrays in single precision, which is much faster.
        n = np.clip(north, self._low[0], self._high[0])
        e = np.clip(east, self._low[1], self._high[1])
        wave = np.sin(self._per_m * n + self._phase[0]) * np.sin(self._per_m * e + self._phase[1])
        hills = self._hills_m * (wave - self._at_origin)
        return np.asarray(self._rise[0] * n + self._rise[1] * e + hills)

    def places(self, level: Array) -> Array:
        """Return ground points (N, 3) in the plane of the site at north and east (N, 2)."""
        return np.column_stack([level, -self.height_m(level[:, 0], level[:, 1])])

    def met(self, position_p: Floats, rays_p: Floats) -> Floats:
        """Return the factors (N,) that scale rays (N, 3) from a point (3,) to the ground.

        The point is above all ground, and the rays lead down. The search may miss what is narrower
        than its step, such as a ridge that an almost level ray just grazes.
        """
        step = (self.highest_m - self.lowest_m) / rays_p[:, 2] / _STEPS
        before = (-self.highest_m - position_p[2]) / rays_p[:, 2]
        going = np.arange(len(rays_p))
        for _ in range(_STEPS):
            ends = before[going] + step[going]
            above = self._below(position_p, rays_p[going], ends) < 0
            going = going[above]
            before[going] = ends[above]
        return self._settled(position_p, rays_p, before, before + step)

    def _below(self, position_p: Floats, rays_p: Floats, times: Floats) -> Floats:
        """Return how far (m) the ends of rays are below the ground."""
        north, east, down = (position_p[k] + times * rays_p[:, k] for k in range(3))
        return np.asarray(down + self.height_m(north, east))

    def _settled(
        self, position_p: Floats, rays_p: Floats, before: Floats, after: Floats
    ) -> Floats:
        """Return the factor at the ground between one above and one below it, by secants."""
        for _ in range(_SETTLING):
            above = -self._below(position_p, rays_p, before)
            below = self._below(position_p, rays_p, after)
            share = np.clip(above / np.maximum(above + below, 1e-9), 0.0, 1.0)
            middle = before + share * (after - before)
            is_below = self._below(position_p, rays_p, middle) >= 0
            before, after = np.where(is_below, before, middle), np.where(is_below, middle, after)
        return np.asarray(middle)

    def hides(self, position_p: Array, places_p: Array) -> npt.NDArray[np.bool_]:
        """Return whether ground hides other ground points (N, 3) from a point (3,): (N,)."""
        return np.asarray(self.met(position_p, places_p - position_p) < 0.99)


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
LEVEL = Relief(ParkScenario(), 0)
#: Text of a ``.prj`` file beside an elevation model in WGS84 degrees.
WGS84_TEXT = (
    'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]\n'
)
