"""Compute the ground errors of sightings of surveyed points, given corrections of parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from tirgeo_ros.core.calibration.boresight.model import (
    PointSighting,
    SightedFlight,
    corrected_pose,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import locate
from tirgeo_ros.core.types.arrays import Array


def ground_errors(
    flight: SightedFlight,
    plane: TangentPlane,
    sightings: Sequence[PointSighting],
    corrections: Mapping[str, Array],
) -> Array:
    """Return (N, 2) located minus surveyed, north and east, m; nan if a pixel meets no ground.

    The ground is level at each point's own height. ``corrections`` (7,) are by point id.
    """
    errors = np.full((len(sightings), 2), np.nan)
    for k, seen in enumerate(sightings):
        found = corrected_pose(flight, seen.stamp_ns, corrections[seen.id])
        if found is None:
            continue
        point_n = seen.point_n - [0.0, 0.0, corrections[seen.id][-1]]
        height_m = float(plane.geodetic_from_ned(point_n)[2])
        located_n, _ = locate(flight.camera, found[0], seen.uv[None], plane, height_m)
        errors[k] = located_n[0, :2] - point_n[:2]
    return errors


def rmse_m(errors: Array) -> float:
    """Return the root mean square of the known horizontal errors (N, 2), m; nan without any."""
    squares = (errors**2).sum(1)
    return math.sqrt(float(np.nanmean(squares))) if np.isfinite(squares).any() else math.nan
