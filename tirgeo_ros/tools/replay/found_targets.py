"""Where the clicks of a run found the targets of a flight, against where they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.ground.ground_point import ellipse_of
from tirgeo_ros.io.surveys.survey import SurveyPoint
from tirgeo_ros.tools.replay.graph_outputs import Outputs


@dataclass(frozen=True)
class FoundTarget:
    """A located point and the target nearest to it."""

    target: str
    latitude_deg: float
    longitude_deg: float
    off_m: float  # horizontal, from where the target is
    ellipse_95_m: float  # major semi-axis


def found_targets(outputs: Outputs, targets: Sequence[SurveyPoint]) -> list[FoundTarget]:
    """One for each located point, in their order; none without a plane or targets."""
    plane = outputs.plane
    if plane is None or not targets:
        return []
    places_n = np.array(
        [plane.ned_from_geodetic(t.latitude_rad, t.longitude_rad, t.height_m) for t in targets]
    )
    found = []
    for point_n, covariance_n in outputs.located_n:
        off_m = np.hypot(*(places_n - point_n).T[:2])
        nearest = int(np.argmin(off_m))
        latitude, longitude, _ = map(float, plane.geodetic_from_ned(point_n))
        where = math.degrees(latitude), math.degrees(longitude)
        major_m = ellipse_of(covariance_n).major_m
        found.append(FoundTarget(targets[nearest].id, *where, float(off_m[nearest]), major_m))
    return found
