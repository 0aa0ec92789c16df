# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Convert the core's results to messages, and convert back the messages that our nodes read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.rotations import (
    flu_from_frd,
    matrix_from_quat,
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
    quat_turned_both,
    rotation_of,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.navigation.ins.strapdown import cross
from tirgeo_ros.core.streams.sanity_checks import place_fault
from tirgeo_ros.core.types.arrays import Array, Quaternion
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.poses import BodyPose, CameraPose, NavSolution
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.io.messages.message_parts import (
    COVARIANCE_KNOWN,
    NO_ROTATION,
    UNKNOWN_VARIANCE,
    covariance_turned_world,
    frd_ned,
    positive,
    quat_turned_world,
    stamp_ns,
)
from tirgeo_ros.io.messages.sensor_messages import SensorMessages

if TYPE_CHECKING:
    from tirgeo_ros.io.messages.shapes_codec import WrittenShapes

_ENCODINGS = {("|u1", 2): "mono8", ("|u1", 3): "bgr8", ("<u2", 2): "mono16"}
#: First bytes of picture files -> their format in messages.
_MARKS = {b"\xff\xd8": "jpeg", b"\x89PNG": "png", b"II*\0": "tiff", b"MM\0*": "tiff"}
OK, WARN, ERROR = 0, 1, 2
_LINE_LIST = 2  # ImageMarker's
_LEVELS = {FilterState.RUNNING: OK, FilterState.LOST: ERROR}  # all others are warnings


@dataclass(frozen=True, slots=True)
class DiagnosticItem:
    """Hold one status of a ``diagnostic_msgs/DiagnosticArray``."""

    name: str
    level: int  # 0 OK, 1 WARN, 2 ERROR, 3 STALE
    message: str
    values: dict[str, str] = field(default_factory=dict)

    @property
    def aircraft(self) -> str:
        """Return the namespace of ``/uav1/node: subject``; ``aircraft`` if it has none."""
        return self.name.partition(":")[0].rpartition("/")[0].strip("/") or "aircraft"


def navigation_item(name: str, status: NavigationStatus) -> DiagnosticItem:
    """Convert the estimator's status: OK if it runs without warnings, ERROR if it is lost."""
    values = {
        "method": status.method,
        "state": status.state.value,
        "state_time_s": repr(float(status.state_s)),
        "reason": status.reason,
        "began_again": status.began_again.value if status.began_again else "",
        "rtk_status": status.rtk_status.name.lower(),
        "heading_sigma_deg": repr(math.degrees(status.heading_sigma_rad)),
        "last_reset": status.last_reset,
    }
    values |= {f"count.{a}.{b}": str(n) for (a, b), n in sorted(status.counts.items())}
    values |= {f"test_ratio.{a}": repr(float(r)) for a, r in sorted(status.test_ratios.items())}
    values |= {f"reset.{a}": str(n) for a, n in sorted(status.resets.items())}
    values |= {f"nis.{a}": repr(float(n)) for a, n in sorted(status.nis.items())}
    values["imu_delay_ms"] = repr(1e3 * status.imu_delay_s)
    values["imu_delay_sigma_ms"] = repr(1e3 * status.imu_delay_sigma_s)
    values["process_noise"] = status.process_noise
    values["vibration"] = " ".join(f"{density:.3g}" for density in status.vibration)
    values |= {f"clipped.{name}": str(n) for name, n in sorted(status.clipped.items())}
    warnings = values["warnings"] = "; ".join(status.warnings)
    warned = warnings if status.state is FilterState.RUNNING else ""
    level = WARN if warned else _LEVELS.get(status.state, WARN)
    text = f"{status.state.value}: {warned or status.reason}".removesuffix(": ")
    return DiagnosticItem(name, level, text, values)


def _rgba(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue


class Messages(SensorMessages):
    """Build messages of the classes of ``Cdr.types``, for nodes and bags alike."""

    def odometry(self, solution: NavSolution, pose: BodyPose) -> Any:
        """Return ``nav_msgs/Odometry``, map -> base_link; twist in base_link.

        Pose covariance: x, y, z, then rotations about the map's axes.
        """
        q_enu = positive(quat_turned_both(*pose.q_nb.tolist()))
        return self.stamped(
            "nav_msgs/msg/Odometry",
            solution.stamp_ns,
            self.frames.map,
            child_frame_id=self.frames.base_link,
            pose=self._pose(pose.position_n, q_enu, pose.covariance),
            twist=self._body_twist(solution),
        )

    def fix(self, solution: NavSolution) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of base_link."""
        frame, covariance = self.frames.base_link, solution.covariance[:3, :3]
        return self._fix(solution.stamp_ns, frame, solution, covariance)

    def origin(self, plane: TangentPlane, stamp_ns: int) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of the map's origin. It is exact by definition."""
        message = self._fix(stamp_ns, self.frames.map, plane, np.zeros((3, 3)))
        message.position_covariance = np.zeros(9)  # the conversion to ENU makes some of them -0
        message.position_covariance_type = COVARIANCE_KNOWN
        return message

    def camera_pose(self, pose: CameraPose) -> Any:
        """Return ``geometry_msgs/PoseWithCovarianceStamped``, map -> tir_optical_frame."""
        q_enu = positive(quat_turned_world(*pose.q_nc.tolist()))
        return self._map_pose(pose.stamp_ns, pose.position_n, q_enu, pose.covariance)

    def pixel(self, stamp_ns: int, u: float, v: float) -> Any:
        """Return ``geometry_msgs/PointStamped`` of a click at a column and row of a picture."""
        point = Cdr.types("geometry_msgs/msg/Point")(x=u, y=v, z=0.0)
        typename = "geometry_msgs/msg/PointStamped"
        return self.stamped(typename, stamp_ns, self.frames.camera, point=point)

    def located_fix(self, located: Located) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of a ground point, with the picture's stamp."""
        fix = self._fix(located.stamp_ns, self.frames.map, located, located.covariance_n)
        # Not converted to radians and back, which would change the last digit.
        fix.latitude, fix.longitude = located.latitude_deg, located.longitude_deg
        return fix

    def located_point(self, located: Located) -> Any:
        """Return ``geometry_msgs/PoseWithCovarianceStamped`` of a ground point in ``map``.

        Its rotation is unknown, and has UNKNOWN_VARIANCE.
        """
        covariance = np.diag([0.0] * 3 + [UNKNOWN_VARIANCE] * 3)
        covariance[:3, :3] = located.covariance_n
        return self._map_pose(located.stamp_ns, located.point_n, NO_ROTATION, covariance)

    def image(self, stamp_ns: int, pixels: npt.NDArray[Any]) -> Any:
        """Return ``sensor_msgs/Image``: mono8, bgr8 or mono16. ValueError for any other array."""
        encoding = _ENCODINGS.get((pixels.dtype.str, pixels.ndim))
        if encoding is None or pixels.shape[2:] not in {(), (3,)}:
            raise ValueError(f"no image encoding for {pixels.dtype} {pixels.shape}")
        height, width = pixels.shape[:2]
        return self.stamped(
            "sensor_msgs/msg/Image",
            stamp_ns,
            self.frames.camera,
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=pixels.nbytes // height,
            data=np.ascontiguousarray(pixels).reshape(-1).view(np.uint8),
        )

    def compressed(self, stamp_ns: int, file: bytes, form: str = "") -> Any:
        """Return ``sensor_msgs/CompressedImage`` of the bytes of a JPEG, PNG or TIFF file.

        ``form`` is the format to write, if it is another.
        """
        known = (name for mark, name in _MARKS.items() if file.startswith(mark))
        form = form or next(known, "jpeg")
        data = np.frombuffer(file, np.uint8)
        typename = "sensor_msgs/msg/CompressedImage"
        return self.stamped(typename, stamp_ns, self.frames.camera, format=form, data=data)

    def line_marker(self, stamp_ns: int, shapes: WrittenShapes) -> Any:
        """Return ``visualization_msgs/ImageMarker``: all lines, in the colours of their layers.

        Foxglove counts pixels from the corner of the first one, and wants a colour a segment.
        """
        point, colour = Cdr.types("geometry_msgs/msg/Point"), Cdr.types("std_msgs/msg/ColorRGBA")
        uv, layer = shapes.segments()
        pens = [_rgba(layer["line"]) for layer in shapes.words["layers"]]
        colours = [colour(r=r, g=g, b=b, a=1.0) for r, g, b in pens]
        white = colour(r=1.0, g=1.0, b=1.0, a=1.0)
        typename = "visualization_msgs/msg/ImageMarker"
        return self.stamped(
            typename,
            stamp_ns,
            self.frames.camera,
            ns="map",
            id=0,
            type=_LINE_LIST,
            action=0,
            filled=0,
            scale=1.0,
            position=point(x=0.0, y=0.0, z=0.0),
            outline_color=white,
            fill_color=white,
            lifetime=Cdr.types("builtin_interfaces/msg/Duration")(sec=0, nanosec=0),
            points=[point(x=u, y=v, z=0.0) for u, v in (uv + 0.5).tolist()],
            outline_colors=[colours[number] for number in layer.tolist()],
        )

    def camera_info(self, camera: Camera, stamp_ns: int) -> Any:
        """Return ``sensor_msgs/CameraInfo``: R identity, P from K; plumb_bob with five numbers."""
        k, distortion, model = calibration_of(camera)
        zero = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        return self.stamped(
            "sensor_msgs/msg/CameraInfo",
            stamp_ns,
            self.frames.camera,
            height=camera.height,
            width=camera.width,
            distortion_model=model,
            d=np.array(distortion, float),
            k=k.ravel(),
            r=np.eye(3).ravel(),
            p=np.pad(k, ((0, 0), (0, 1))).ravel(),
            binning_x=0,
            binning_y=0,
            roi=Cdr.types("sensor_msgs/msg/RegionOfInterest")(**zero),
        )

    def clock(self, stamp_ns: int) -> Any:
        """Return ``rosgraph_msgs/Clock``."""
        return Cdr.types("rosgraph_msgs/msg/Clock")(clock=self._time(stamp_ns))

    def diagnostics(self, stamp_ns: int, items: Sequence[DiagnosticItem]) -> Any:
        """Return ``diagnostic_msgs/DiagnosticArray``."""
        status = [
            Cdr.types("diagnostic_msgs/msg/DiagnosticStatus")(
                level=item.level,
                name=item.name,
                message=item.message,
                hardware_id=item.aircraft,
                values=[
                    Cdr.types("diagnostic_msgs/msg/KeyValue")(key=key, value=value)
                    for key, value in item.values.items()
                ],
            )
            for item in items
        ]
        return self.stamped("diagnostic_msgs/msg/DiagnosticArray", stamp_ns, "", status=status)

    def body_transform(self, body: BodyPose) -> Any:
        """Return ``geometry_msgs/TransformStamped``, map -> base_link: the odometry's pose."""
        north, east, down = body.position_n.tolist()
        q_enu = positive(quat_turned_both(*body.q_nb.tolist()))
        link = (self.frames.map, self.frames.base_link)
        return self._transform(body.stamp_ns, link, (east, north, -down), q_enu)

    def camera_transform(self, body: BodyPose, camera: CameraPose) -> Any:
        """Return ``TransformStamped``, base_link -> camera, of a camera composed with ``body``."""
        offset_b = (camera.position_n - body.position_n) @ matrix_from_quat(body.q_nb)
        w, x, y, z = quat_multiply(quat_conjugate(body.q_nb), camera.q_nc).tolist()
        q_flu = positive((-x, w, -z, y))  # half a turn about the forward axis: FRD to FLU
        link = (self.frames.base_link, self.frames.camera)
        return self._transform(camera.stamp_ns, link, flu_from_frd(offset_b).tolist(), q_flu)

    def fixed_transforms(self, aircraft: AircraftConfig, stamp_ns: int) -> list[Any]:
        """Return ``geometry_msgs/TransformStamped``: base_link -> antennas, gimbal pivot, IMU."""
        ids, imu_rotation = self.frames, NO_ROTATION
        places_b = {
            ids.rtk_antenna: aircraft.rtk_lever_b,
            ids.gps_antenna: aircraft.gps_lever_b,
            ids.gimbal_pivot: aircraft.pivot_lever_b,
        }
        if aircraft.baseline_b is not None:
            places_b[ids.second_antenna] = aircraft.rtk_lever_b + aircraft.baseline_b
        places_b[ids.imu_link] = np.zeros(3)
        if aircraft.rotation_bi is not None:  # from the IMU's axes to base_link's, both FLU
            w, x, y, z = quat_from_matrix(aircraft.rotation_bi).tolist()
            imu_rotation = w, x, -y, -z
        transforms = []
        for child, place_b in places_b.items():
            xyz = (flu_from_frd(place_b) + 0.0).tolist()  # no minus zero
            rotation = imu_rotation if child == ids.imu_link else NO_ROTATION
            transforms.append(self._transform(stamp_ns, (ids.base_link, child), xyz, rotation))
        return transforms

    def tf(self, transforms: Sequence[Any]) -> Any:
        """Return ``tf2_msgs/TFMessage``."""
        return Cdr.types("tf2_msgs/msg/TFMessage")(transforms=list(transforms))

    def footprint(self, stamp_ns: int, outline_n: Array) -> Any:
        """Return ``geometry_msgs/PolygonStamped`` of an outline (N, 3) in the map, NED, m."""
        point = Cdr.types("geometry_msgs/msg/Point32")
        points = [point(x=east, y=north, z=-down) for north, east, down in outline_n.tolist()]
        polygon = Cdr.types("geometry_msgs/msg/Polygon")(points=points)
        typename = "geometry_msgs/msg/PolygonStamped"
        return self.stamped(typename, stamp_ns, self.frames.map, polygon=polygon)

    def track_point(self, body: BodyPose) -> Any:
        """Return ``geometry_msgs/PoseStamped`` of base_link in the map."""
        pose = self._bare_pose(body.position_n, positive(quat_turned_both(*body.q_nb.tolist())))
        typename = "geometry_msgs/msg/PoseStamped"
        return self.stamped(typename, body.stamp_ns, self.frames.map, pose=pose)

    def path(self, stamp_ns: int, track_points: Sequence[Any]) -> Any:
        """Return ``nav_msgs/Path`` of track points."""
        poses = list(track_points)
        return self.stamped("nav_msgs/msg/Path", stamp_ns, self.frames.map, poses=poses)

    def _transform(
        self, stamp_ns: int, link: tuple[str, str], xyz: Sequence[float], rotation: Quaternion
    ) -> Any:
        """Return a transform from a parent frame to its child: the child's pose in the parent."""
        parent, child = link
        transform = Cdr.types("geometry_msgs/msg/Transform")(
            translation=self._vector(xyz), rotation=self._quaternion(rotation)
        )
        typename = "geometry_msgs/msg/TransformStamped"
        return self.stamped(typename, stamp_ns, parent, child_frame_id=child, transform=transform)

    def _body_twist(self, solution: NavSolution) -> Any:
        """Return the twist in body axes, FLU.

        Along the axis ``a`` the velocity's error is ``a . (dv + [v x] phi)``.
        """
        m = rotation_of(tuple(solution.q_nb.tolist()))
        axes_n = (m[0], m[3], m[6]), (-m[1], -m[4], -m[7]), (-m[2], -m[5], -m[8])
        north, east, down = velocity_n = tuple(solution.velocity_n.tolist())
        linear = [a * north + b * east + c * down for a, b, c in axes_n]
        x, y, z = solution.angular_rate_b.tolist()
        flat = np.zeros(36)
        partials = np.array([cross(axis, velocity_n) + axis for axis in axes_n])
        # np.dot rather than @: the same product in half the time for matrices this small.
        linear_covariance = np.dot(np.dot(partials, solution.covariance[3:9, 3:9]), partials.T)
        flat.reshape(6, 6)[:3, :3] = linear_covariance
        flat[21], flat[28], flat[35] = solution.rate_variance_b
        return self._twist(linear, (x, -y, -z), flat)


def body_pose(msg: Any) -> BodyPose:
    """Convert ``nav_msgs/Odometry`` of ``tirgeo/odometry``."""
    pose = msg.pose.pose
    covariance = covariance_turned_world(msg.pose.covariance, 6).reshape(6, 6)
    return BodyPose(stamp_ns(msg), _ned(pose.position), frd_ned(pose.orientation), covariance)


def camera_pose(msg: Any) -> CameraPose:
    """Convert ``geometry_msgs/PoseWithCovarianceStamped`` of ``tirgeo/camera_pose``."""
    pose = msg.pose.pose
    q = pose.orientation
    covariance = covariance_turned_world(msg.pose.covariance, 6).reshape(6, 6)
    q_nc = np.array(quat_turned_world(q.w, q.x, q.y, q.z))
    return CameraPose(stamp_ns(msg), _ned(pose.position), q_nc, covariance)


def tangent_plane(msg: Any) -> TangentPlane:
    """Convert ``sensor_msgs/NavSatFix`` of ``tirgeo/origin``. Raises MessageError if invalid."""
    place = math.radians(msg.latitude), math.radians(msg.longitude), float(msg.altitude)
    fault = place_fault(*place)
    if fault:
        raise MessageError(
            f"tirgeo/origin: {fault}: {msg.latitude:g}, {msg.longitude:g} deg, {msg.altitude:g} m"
        )
    return TangentPlane(*place)


def pixel(msg: Any) -> tuple[int, float, float]:
    """Convert ``PointStamped`` of ``tirgeo/locate/pixel``: stamp (ns), column, row."""
    return stamp_ns(msg), float(msg.point.x), float(msg.point.y)


def _ned(point: Any) -> Array:
    return np.array([point.y, point.x, -point.z])


def calibration_of(camera: Camera) -> tuple[Array, list[float], str]:
    """Return K (3, 3), D and the name of its model: plumb_bob has five numbers, rational eight."""
    k = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], float)
    size = 5 if len(camera.distortion) <= 5 else 8
    padding = [0.0] * (size - len(camera.distortion))
    model = "plumb_bob" if size == 5 else "rational_polynomial"
    return k, [*map(float, camera.distortion), *padding], model
