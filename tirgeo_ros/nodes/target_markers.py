"""Show targets in RViz as markers. They are for people: no program reads them back."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.frames.rotations import quat_from_matrix
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.arrays import Array

_COLOUR = ColorRGBA(r=1.0, g=0.3, b=1.0, a=0.6)
_TEXT_HEIGHT_M = 1.0
_LEAST_AXIS_M = 2e-3  # RViz warns of a scale of zero
_RADIUS = math.sqrt(CHI2_95)


def target_markers(map_frame: str, plane: TangentPlane, targets: Sequence[Target]) -> MarkerArray:
    """Return the markers of all targets, placed in the map's plane.

    The first one deletes all others. For each target there is an ellipsoid, whose shadow on the
    ground is the ellipse of 95 %, and its label as text. Their stamp is zero: RViz takes the
    newest transform for it.
    """
    header = Header(frame_id=map_frame)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for number, target in enumerate(targets, 1):
        own = {"header": header, "id": number, "text": target.label, "color": _COLOUR}
        place = target.place
        geodetic = place.latitude_rad, place.longitude_rad, place.height_m
        north, east, down = plane.ned_from_geodetic(*geodetic).tolist()
        lengths, turn = _ellipsoid(np.reshape(place.covariance_enu, (3, 3)))
        pose = Pose(position=Point(x=east, y=north, z=-down), orientation=turn)
        markers.append(Marker(ns="targets", type=Marker.SPHERE, pose=pose, scale=lengths, **own))
        above = Pose(position=Point(x=east, y=north, z=_TEXT_HEIGHT_M - down))
        size = Vector3(z=_TEXT_HEIGHT_M)
        kind = Marker.TEXT_VIEW_FACING
        markers.append(Marker(ns="labels", type=kind, pose=above, scale=size, **own))
    return MarkerArray(markers=markers)


def _ellipsoid(covariance: Array) -> tuple[Vector3, Quaternion]:
    """Return the lengths of the axes, m, and the attitude, of a covariance's ellipsoid of 95 %."""
    variances, axes = np.linalg.eigh(covariance)
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # right-handed
    lengths_m = 2 * _RADIUS * np.sqrt(np.maximum(variances, 0.0))
    x, y, z = np.maximum(lengths_m, _LEAST_AXIS_M).tolist()
    turn = dict(zip("wxyz", quat_from_matrix(axes).tolist(), strict=True))
    return Vector3(x=x, y=y, z=z), Quaternion(**turn)
