"""Compare the points that a run's clicks located with the targets of a flight."""

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
    """Hold a located point and its nearest target."""

    target: str
    latitude_deg: float
    longitude_deg: float
    off_m: float  # horizontal distance from the target
    ellipse_95_m: float  # major semi-axis


def found_targets(outputs: Outputs, targets: Sequence[SurveyPoint]) -> list[FoundTarget]:
    """Return one item for each located point, in order; none without a plane or targets."""
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
