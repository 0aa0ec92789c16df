"""Convert answers to clicks, and targets, to messages and back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.frames.axes import ENU_NED
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_matrix
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Located, MarkedPlace, Refusal
from tirgeo_ros.core.streams.sanity_checks import place_fault
from tirgeo_ros.core.types.arrays import Array, Quaternion
from tirgeo_ros.core.types.errors import MessageError, cut
from tirgeo_ros.io.messages.decode import stamp_ns
from tirgeo_ros.io.messages.diagnostics import OK, WARN, DiagnosticItem, diagnostic_level
from tirgeo_ros.io.messages.message_parts import NO_TURN, MessageParts, covariance_turned_world

#: As many as a store of targets has; a longer list is refused, for it would hold up the video.
MOST_TARGETS = 2000
_LONGEST_LABEL = 60
_ADD, _DELETE_ALL = 0, 3  # Marker.action
_SPHERE, _TEXT = 2, 9  # Marker.type
_COLOUR = (1.0, 0.3, 1.0, 0.6)  # red, green, blue, opacity
_TEXT_HEIGHT_M = 1.0
_LEAST_SEMI_AXIS_M = 1e-3  # RViz warns of a scale of zero
_RADIUS = math.sqrt(CHI2_95)


class ClickAnswer(NamedTuple):
    """Hold what ``tirgeo/locate/answer`` says of one click: a place, or why there is none."""

    stamp_ns: int  # of the clicked picture
    u: float  # column, row of the click
    v: float
    refused: str  # why; empty where a place was located
    latitude_deg: float = math.nan
    longitude_deg: float = math.nan
    height_m: float = math.nan  # ellipsoidal
    covariance_enu: tuple[float, ...] = ()  # 9 numbers, m2, row by row


def answer_item(node: str, answer: Located | Refusal) -> DiagnosticItem:
    """Return the one status of ``tirgeo/locate/answer``; ``click_answer`` is the inverse."""
    u, v = answer.uv
    values = {"u": repr(float(u)), "v": repr(float(v))}
    if isinstance(answer, Refusal):
        return DiagnosticItem(f"{node}: click", WARN, answer.reason.value, values)
    covariance = covariance_turned_world(answer.covariance_n, 3).tolist()
    values["latitude_deg"] = repr(math.degrees(answer.latitude_rad))
    values["longitude_deg"] = repr(math.degrees(answer.longitude_rad))
    values["height_m"] = repr(answer.height_m)
    values["covariance_enu"] = " ".join(map(repr, covariance))
    return DiagnosticItem(f"{node}: click", OK, "located", values)


def click_answer(msg: Any) -> ClickAnswer:
    """Decode ``tirgeo/locate/answer``. Raises MessageError if it is no answer, or not finite."""
    try:
        (status,) = msg.status
        values = {item.key: item.value for item in status.values}
        pixel = stamp_ns(msg), float(values["u"]), float(values["v"])
        if diagnostic_level(status) != OK:
            return ClickAnswer(*pixel, cut(status.message) or "no reason is given")
        latitude, longitude = float(values["latitude_deg"]), float(values["longitude_deg"])
        height_m = float(values["height_m"])
        covariance = tuple(map(float, values["covariance_enu"].split()))
    except (KeyError, ValueError) as error:
        raise MessageError(f"tirgeo/locate/answer: no answer to a click: {error}") from None
    fault = place_fault(math.radians(latitude), math.radians(longitude), height_m)
    if fault or len(covariance) != 9 or not math.isfinite(sum(covariance)):
        raise MessageError(f"tirgeo/locate/answer: {fault or 'covariance is not 9 numbers'}")
    return ClickAnswer(*pixel, "", latitude, longitude, height_m, covariance)


class TargetMessages(MessageParts):
    """Build messages of targets."""

    def targets(self, plane: TangentPlane, targets: Sequence[MarkedPlace]) -> Any:
        """Return ``visualization_msgs/MarkerArray`` of all targets, placed in a plane.

        The first marker deletes all others; its text is the plane's origin: latitude, longitude
        (deg) and ellipsoidal height (m). For each target there is an ellipsoid, whose shadow on
        the ground is the ellipse of 95 %, and its label as text.
        """
        origin = math.degrees(plane.latitude_rad), math.degrees(plane.longitude_rad)
        text = " ".join(map(repr, (*origin, float(plane.height_m))))
        markers = [self._marker("targets", 0, text, action=_DELETE_ALL)]
        for number, one in enumerate(targets, 1):
            place = one.latitude_rad, one.longitude_rad, one.height_m
            east, north, up = (ENU_NED @ plane.ned_from_geodetic(*place)).tolist()
            semi_axes_m, turned = _ellipsoid(one.covariance_n)
            size, label = (2 * semi_axes_m).tolist(), cut(one.label, _LONGEST_LABEL)
            point, above = (east, north, up), (east, north, up + _TEXT_HEIGHT_M)
            markers.append(self._marker("targets", number, label, point, size, turned=turned))
            size = [0.0, 0.0, _TEXT_HEIGHT_M]
            markers.append(self._marker("labels", number, label, above, size, kind=_TEXT))
        return self._class("visualization_msgs/msg/MarkerArray")(markers=markers)

    def _marker(
        self,
        group: str,
        number: int,
        text: str,
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


def _ellipsoid(covariance_n: Array) -> tuple[Array, Quaternion]:
    """Return semi-axes (3,), m, and attitude in ENU, of the ellipsoid of a covariance (3, 3)."""
    covariance = covariance_turned_world(covariance_n, 3).reshape(3, 3)
    variances, axes = np.linalg.eigh(covariance)
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # right-handed
    semi_axes_m = _RADIUS * np.sqrt(np.maximum(variances, 0.0))
    w, x, y, z = quat_from_matrix(axes).tolist()
    return np.maximum(semi_axes_m, _LEAST_SEMI_AXIS_M), (w, x, y, z)


def marked_places(msg: Any) -> list[MarkedPlace]:
    """Decode ``tirgeo/targets``.

    Raises MessageError if it does not begin with the origin of its plane, a number is not finite
    or there are more than can be drawn.
    """
    markers = list(msg.markers)
    shapes = [one for one in markers if one.type == _SPHERE and one.action == _ADD]
    if len(shapes) > MOST_TARGETS:
        raise MessageError(f"tirgeo/targets: {len(shapes)} targets; {MOST_TARGETS} can be drawn")
    if not markers or markers[0].action != _DELETE_ALL:
        raise MessageError("tirgeo/targets: its first marker does not name the plane's origin")
    try:
        place = [float(word) for word in markers[0].text.split()]
        plane = TangentPlane(math.radians(place[0]), math.radians(place[1]), place[2])
    except (IndexError, ValueError):
        raise MessageError("tirgeo/targets: its first marker has no origin of the plane") from None
    return [_marked_place(plane, one) for one in shapes]


def _marked_place(plane: TangentPlane, marker: Any) -> MarkedPlace:
    point, q, scale = marker.pose.position, marker.pose.orientation, marker.scale
    axes = matrix_from_quat(np.array([q.w, q.x, q.y, q.z]))
    deviations = np.array([scale.x, scale.y, scale.z]) / (2 * _RADIUS)
    covariance = covariance_turned_world(axes * deviations**2 @ axes.T, 3).reshape(3, 3)
    point_n = np.array([point.y, point.x, -point.z])
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(point_n))
    fault = place_fault(latitude, longitude, height_m)
    if not np.isfinite(covariance).all():
        fault = "scale or turn is not finite"
    if fault:
        raise MessageError(f"tirgeo/targets: target {marker.id}: {fault}")
    label = cut(marker.text, _LONGEST_LABEL)
    return MarkedPlace(label, latitude, longitude, height_m, covariance)
