"""Show targets in RViz as markers. They are for people: no program reads them back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.frames.axes import ENU_NED
from tirgeo_ros.core.frames.rotations import quat_from_matrix
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.arrays import Array, Quaternion
from tirgeo_ros.io.messages.message_parts import NO_TURN, MessageParts

_ADD, _DELETE_ALL = 0, 3  # Marker.action
_SPHERE, _TEXT = 2, 9  # Marker.type
_COLOUR = (1.0, 0.3, 1.0, 0.6)  # red, green, blue, opacity
_TEXT_HEIGHT_M = 1.0
_LEAST_SEMI_AXIS_M = 1e-3  # RViz warns of a scale of zero
_RADIUS = math.sqrt(CHI2_95)


class TargetMarkers(MessageParts):
    """Build the markers of targets."""

    def target_markers(self, plane: TangentPlane, targets: Sequence[Target]) -> Any:
        """Return ``visualization_msgs/MarkerArray`` of all targets, placed in a plane.

        The first marker deletes all others. For each target there is an ellipsoid, whose shadow on
        the ground is the ellipse of 95 %, and its label as text.
        """
        markers = [self._marker("targets", 0, action=_DELETE_ALL)]
        for number, target in enumerate(targets, 1):
            place, label = target.place, target.label
            where = place.latitude_rad, place.longitude_rad, place.height_m
            east, north, up = (ENU_NED @ plane.ned_from_geodetic(*where)).tolist()
            size, turned = _ellipsoid(place)
            point, above = (east, north, up), (east, north, up + _TEXT_HEIGHT_M)
            markers.append(self._marker("targets", number, label, point, size, turned=turned))
            size = [0.0, 0.0, _TEXT_HEIGHT_M]
            markers.append(self._marker("labels", number, label, above, size, kind=_TEXT))
        return self._class("visualization_msgs/msg/MarkerArray")(markers=markers)

    def _marker(
        self,
        group: str,
        number: int,
        text: str = "",
        xyz: Sequence[float] = (0.0, 0.0, 0.0),
        scale: Sequence[float] = (1.0, 1.0, 1.0),
        *,
        turned: Quaternion = NO_TURN,
        kind: int = _SPHERE,
        action: int = _ADD,
    ) -> Any:
        """Return ``visualization_msgs/Marker`` in ``map``, shown until it is deleted.

        Its stamp is zero: a reader of TF takes the newest transform for it.
        """
        nothing = np.empty(0, np.uint8)
        point = self._class("geometry_msgs/msg/Point")(**dict(zip("xyz", xyz, strict=True)))
        pose = self._class("geometry_msgs/msg/Pose")
        mesh = self._class("visualization_msgs/msg/MeshFile")
        return self.stamped(
            "visualization_msgs/msg/Marker",
            0,
            self.frames.map,
            ns=group,
            id=number,
            type=kind,
            action=action,
            pose=pose(position=point, orientation=self._quaternion(turned)),
            scale=self._vector(scale),
            color=self._class("std_msgs/msg/ColorRGBA")(**dict(zip("rgba", _COLOUR, strict=True))),
            lifetime=self._class("builtin_interfaces/msg/Duration")(sec=0, nanosec=0),
            frame_locked=False,
            points=[],
            colors=[],
            texture_resource="",
            texture=self.stamped(
                "sensor_msgs/msg/CompressedImage", 0, "", format="", data=self._octets(nothing)
            ),
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=mesh(filename="", data=self._octets(nothing)),
            mesh_use_embedded_materials=False,
        )


def _ellipsoid(place: Located) -> tuple[list[float], Quaternion]:
    """Return the lengths of the axes, m, and the attitude in ENU, of a place's ellipsoid."""
    covariance: Array = np.reshape(place.covariance_enu, (3, 3))
    variances, axes = np.linalg.eigh(covariance)
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # right-handed
    semi_axes_m = _RADIUS * np.sqrt(np.maximum(variances, 0.0))
    w, x, y, z = quat_from_matrix(axes).tolist()
    return (2 * np.maximum(semi_axes_m, _LEAST_SEMI_AXIS_M)).tolist(), (w, x, y, z)
