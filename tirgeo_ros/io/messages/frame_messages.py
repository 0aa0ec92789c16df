"""Convert poses and places to messages that relate frames: transforms, outlines, the track."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.axes import flu_from_frd, quat_turned_both
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
)
from tirgeo_ros.core.types.arrays import Array, Quaternion
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io.messages.message_axes import NO_TURN, positive
from tirgeo_ros.io.messages.message_parts import MessageParts


class FrameMessages(MessageParts):
    """Build messages of transforms between frames, and of places in ``map``."""

    def body_transform(self, body: BodyPose) -> Any:
        """Return ``geometry_msgs/TransformStamped``, map -> base_link: the odometry's pose."""
        north, east, down = body.position_n.tolist()
        turned = positive(quat_turned_both(*body.q_nb.tolist()))
        link = (self.frames.map, self.frames.base_link)
        return self._transform(body.stamp_ns, link, (east, north, -down), turned)

    def camera_transform(self, body: BodyPose, camera: CameraPose) -> Any:
        """Return ``geometry_msgs/TransformStamped``, base_link -> camera, at the camera's stamp.

        ``body`` is the pose that the camera's was composed with, so that the chain of both
        transforms gives the camera's pose.
        """
        offset_b = (camera.position_n - body.position_n) @ matrix_from_quat(body.q_nb)
        w, x, y, z = quat_multiply(quat_conjugate(body.q_nb), camera.q_nc).tolist()
        turned = positive((-x, w, -z, y))  # half a turn about forward: FRD to FLU
        link = (self.frames.base_link, self.frames.camera)
        return self._transform(camera.stamp_ns, link, flu_from_frd(offset_b).tolist(), turned)

    def fixed_transforms(self, aircraft: AircraftConfig, stamp_ns: int) -> list[Any]:
        """Return ``geometry_msgs/TransformStamped`` from base_link to what is fixed to it.

        The second antenna is left out if there is none.
        """
        ids = self.frames
        places_b = {
            ids.rtk_antenna: aircraft.rtk_lever_b,
            ids.gps_antenna: aircraft.gps_lever_b,
            ids.gimbal_pivot: aircraft.pivot_lever_b,
        }
        if aircraft.baseline_b is not None:
            places_b[ids.second_antenna] = aircraft.rtk_lever_b + aircraft.baseline_b
        turns = {ids.imu_link: _imu_turn(aircraft)}
        places_b[ids.imu_link] = np.zeros(3)
        return [
            self._transform(
                stamp_ns,
                (ids.base_link, child),
                (flu_from_frd(place_b) + 0.0).tolist(),  # no minus zero
                turns.get(child, NO_TURN),
            )
            for child, place_b in places_b.items()
        ]

    def tf(self, transforms: Sequence[Any]) -> Any:
        """Return ``tf2_msgs/TFMessage``."""
        return self._class("tf2_msgs/msg/TFMessage")(transforms=list(transforms))

    def footprint(self, stamp_ns: int, outline_n: Array) -> Any:
        """Return ``geometry_msgs/PolygonStamped`` of an outline (N, 3) in the map, NED, m."""
        point = self._class("geometry_msgs/msg/Point32")
        points = [point(x=east, y=north, z=-down) for north, east, down in outline_n.tolist()]
        polygon = self._class("geometry_msgs/msg/Polygon")(points=points)
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
        self, stamp_ns: int, link: tuple[str, str], xyz: Sequence[float], turned: Quaternion
    ) -> Any:
        """Return a transform from a parent frame to its child: the child's pose in the parent."""
        parent, child = link
        transform = self._class("geometry_msgs/msg/Transform")(
            translation=self._vector(xyz), rotation=self._quaternion(turned)
        )
        typename = "geometry_msgs/msg/TransformStamped"
        return self.stamped(typename, stamp_ns, parent, child_frame_id=child, transform=transform)


def _imu_turn(aircraft: AircraftConfig) -> Quaternion:
    """Return the rotation of the IMU's axes to base_link's, FLU both."""
    rotation_bi = aircraft.rotation_bi
    if rotation_bi is None:
        return NO_TURN
    w, x, y, z = quat_from_matrix(rotation_bi).tolist()
    return w, x, -y, -z
