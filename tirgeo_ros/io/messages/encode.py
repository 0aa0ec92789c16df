"""Convert the core's samples and results to messages."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.strapdown import cross
from tirgeo_ros.core.types.arrays import Array, Quaternion, Vector
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    VelocitySample,
)
from tirgeo_ros.core.types.poses import BodyPose, CameraPose, NavSolution
from tirgeo_ros.core.types.verdicts import NavigationStatus
from tirgeo_ros.io.messages.diagnostics import DiagnosticItem, navigation_item
from tirgeo_ros.io.messages.message_axes import (
    covariance_turned_world,
    positive,
    quat_turned_both,
    quat_turned_world,
)
from tirgeo_ros.io.messages.parts import COVARIANCE_KNOWN, Parts
from tirgeo_ros.io.messages.topics import (
    BODY_FRAME,
    COMPUTED_FROM,
    JOINT_SIGNS,
    MAP_FRAME,
    OPTICAL_FRAME,
)

#: Variance of an unknown value, where a reader takes any number for a variance: so large that it
#: has no weight. (rad/s)^2 in a twist, rad^2 in a heading message's roll and pitch.
UNKNOWN_VARIANCE = 1e6

_ENCODINGS = {("|u1", 2): "mono8", ("|u1", 3): "bgr8", ("<u2", 2): "mono16"}
_NO_TURN: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Messages:
    """Build messages of the classes that ``types`` gives for names like ``nav_msgs/msg/Odometry``.

    Nodes pass rclpy's classes, bags those they are written with (``io.bags.cdr.Cdr.types``).
    """

    def __init__(self, types: Callable[[str], type]) -> None:
        self.types = types
        self._parts = Parts(types)

    def imu(self, sample: ImuSample, frame_id: str = BODY_FRAME) -> Any:
        """Return ``sensor_msgs/Imu``: FRD to FLU; covariances zero, which means unknown."""
        attitude = sample.autopilot_q_nb
        covariance = np.zeros(9)
        covariance[0] = -1.0 if attitude is None else 0.0
        turned = _NO_TURN if attitude is None else quat_turned_both(*attitude.tolist())
        return self._parts.imu(
            sample.stamp_ns,
            frame_id,
            (turned, covariance),
            (sample.angular_rate_b, np.zeros(9)),
            (sample.specific_force_b, np.zeros(9)),
        )

    def heading(self, sample: HeadingSample, frame_id: str = BODY_FRAME) -> Any:
        """Return ``sensor_msgs/Imu`` with the heading as ENU yaw; all else is marked as absent."""
        half = 0.5 * (0.5 * math.pi - sample.heading_rad)
        covariance = np.zeros(9)
        covariance[[0, 4, 8]] = UNKNOWN_VARIANCE, UNKNOWN_VARIANCE, sample.variance_rad2
        absent = np.zeros(9)
        absent[0] = -1.0
        turned = (math.cos(half), 0.0, 0.0, math.sin(half))
        nothing = (np.zeros(3), absent)
        return self._parts.imu(sample.stamp_ns, frame_id, (turned, covariance), nothing, nothing)

    def nav_sat_fix(self, sample: PositionSample, frame_id: str) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of an antenna."""
        place = (sample.latitude_rad, sample.longitude_rad, sample.height_m)
        covariance = covariance_turned_world(sample.covariance_n, 3)
        return self._parts.fix(sample.stamp_ns, frame_id, sample.status, place, covariance)

    def velocity(self, sample: VelocitySample, frame_id: str) -> Any:
        """Return ``geometry_msgs/TwistWithCovarianceStamped``, ENU.

        The rate has unknown variance.
        """
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = covariance_turned_world(sample.covariance_n, 3).reshape(3, 3)
        covariance[[3, 4, 5], [3, 4, 5]] = UNKNOWN_VARIANCE
        north, east, down = sample.velocity_n.tolist()
        twist = self._parts.twist((east, north, -down), (0.0, 0.0, 0.0), covariance.ravel())
        return self._parts.new(
            "geometry_msgs/msg/TwistWithCovarianceStamped",
            header=self._parts.header(sample.stamp_ns, frame_id),
            twist=twist,
        )

    def joints(self, sample: JointSample) -> Any:
        """Return ``sensor_msgs/JointState`` of the gimbal, FLU.

        Its frame is base_link; for computed joints it is the topic that they are computed from.
        The message has no other field for that, and no reader needs the frame of angles.
        """
        frd = (sample.yaw_rad, sample.roll_rad, sample.pitch_rad)
        frame_id = COMPUTED_FROM if sample.computed else BODY_FRAME
        angles = [sign * angle for sign, angle in zip(JOINT_SIGNS.values(), frd, strict=True)]
        return self._parts.new(
            "sensor_msgs/msg/JointState",
            header=self._parts.header(sample.stamp_ns, frame_id),
            name=list(JOINT_SIGNS),
            position=self._parts.doubles(angles),
            velocity=self._parts.doubles([]),
            effort=self._parts.doubles([]),
        )

    def camera_attitude(self, sample: CameraAttitudeSample) -> Any:
        """Return ``geometry_msgs/QuaternionStamped``: camera body FLU in ENU."""
        return self._parts.new(
            "geometry_msgs/msg/QuaternionStamped",
            header=self._parts.header(sample.stamp_ns, MAP_FRAME),
            quaternion=self._parts.quaternion(positive(quat_turned_both(*sample.q_ng.tolist()))),
        )

    def odometry(self, solution: NavSolution, pose: BodyPose) -> Any:
        """Return ``nav_msgs/Odometry``, map -> base_link.

        Pose covariance: x, y, z, then rotations about the map's axes. Twist in base_link; the
        velocity's covariance is the solution's, turned to the body, with the contribution of the
        attitude.
        """
        turned = positive(quat_turned_both(*pose.q_nb.tolist()))
        return self._parts.new(
            "nav_msgs/msg/Odometry",
            header=self._parts.header(solution.stamp_ns, MAP_FRAME),
            child_frame_id=BODY_FRAME,
            pose=self._parts.pose(pose.position_n, turned, pose.covariance),
            twist=self._body_twist(solution),
        )

    def fix(self, solution: NavSolution) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of base_link."""
        place = (solution.latitude_rad, solution.longitude_rad, solution.height_m)
        covariance = covariance_turned_world(solution.covariance[:3, :3], 3)
        return self._parts.fix(solution.stamp_ns, BODY_FRAME, FixStatus.SINGLE, place, covariance)

    def origin(self, plane: TangentPlane, stamp_ns: int) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of the map's origin. It is exact by definition."""
        place = (plane.latitude_rad, plane.longitude_rad, plane.height_m)
        message = self._parts.fix(stamp_ns, MAP_FRAME, FixStatus.SINGLE, place, np.zeros(9))
        message.position_covariance_type = COVARIANCE_KNOWN
        return message

    def camera_pose(self, pose: CameraPose) -> Any:
        """Return ``geometry_msgs/PoseWithCovarianceStamped``, map -> tir_optical_frame."""
        turned = positive(quat_turned_world(*pose.q_nc.tolist()))
        return self._parts.new(
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            header=self._parts.header(pose.stamp_ns, MAP_FRAME),
            pose=self._parts.pose(pose.position_n, turned, pose.covariance),
        )

    def image(self, stamp_ns: int, pixels: npt.NDArray[Any], frame_id: str = OPTICAL_FRAME) -> Any:
        """Return ``sensor_msgs/Image``: mono8 (h, w), bgr8 (h, w, 3) or mono16 (h, w).

        mono8 and bgr8 are of uint8, mono16 of uint16. Raises ValueError for any other array.
        """
        encoding = _ENCODINGS.get((pixels.dtype.str, pixels.ndim))
        if encoding is None or pixels.shape[2:] not in {(), (3,)}:
            raise ValueError(f"no image encoding for {pixels.dtype} {pixels.shape}")
        height, width = pixels.shape[:2]
        return self._parts.new(
            "sensor_msgs/msg/Image",
            header=self._parts.header(stamp_ns, frame_id),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=pixels.nbytes // height,
            data=self._parts.octets(np.ascontiguousarray(pixels)),
        )

    def compressed(self, stamp_ns: int, jpeg: bytes, frame_id: str = OPTICAL_FRAME) -> Any:
        """Return ``sensor_msgs/CompressedImage`` of a JPEG file's bytes."""
        return self._parts.new(
            "sensor_msgs/msg/CompressedImage",
            header=self._parts.header(stamp_ns, frame_id),
            format="jpeg",
            data=self._parts.octets(np.frombuffer(jpeg, np.uint8)),
        )

    def camera_info(self, camera: Camera, stamp_ns: int, frame_id: str = OPTICAL_FRAME) -> Any:
        """Return ``sensor_msgs/CameraInfo``: R identity, P from K; plumb_bob with five numbers."""
        k = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1], float)
        size = 5 if len(camera.distortion) <= 5 else 8
        padded = [*map(float, camera.distortion), *[0.0] * (size - len(camera.distortion))]
        return self._parts.new(
            "sensor_msgs/msg/CameraInfo",
            header=self._parts.header(stamp_ns, frame_id),
            height=camera.height,
            width=camera.width,
            distortion_model="plumb_bob" if size == 5 else "rational_polynomial",
            d=self._parts.doubles(padded),
            k=k,
            r=np.eye(3).ravel(),
            p=np.hstack([k.reshape(3, 3), np.zeros((3, 1))]).ravel(),
            binning_x=0,
            binning_y=0,
            roi=self._parts.new(
                "sensor_msgs/msg/RegionOfInterest",
                x_offset=0,
                y_offset=0,
                height=0,
                width=0,
                do_rectify=False,
            ),
        )

    def clock(self, stamp_ns: int) -> Any:
        """Return ``rosgraph_msgs/Clock``."""
        return self._parts.new("rosgraph_msgs/msg/Clock", clock=self._parts.time(stamp_ns))

    def diagnostics(self, stamp_ns: int, items: Sequence[DiagnosticItem]) -> Any:
        """Return ``diagnostic_msgs/DiagnosticArray``."""
        return self._parts.new(
            "diagnostic_msgs/msg/DiagnosticArray",
            header=self._parts.header(stamp_ns, ""),
            status=[self._status(item) for item in items],
        )

    @staticmethod
    def navigation_diagnostic(name: str, status: NavigationStatus) -> DiagnosticItem:
        """Return the estimator's status; ``navigation_status`` is the inverse."""
        return navigation_item(name, status)

    def _body_twist(self, solution: NavSolution) -> Any:
        axes_n = _body_axes_n(solution)
        north, east, down = solution.velocity_n.tolist()
        forward, left, up = [a * north + b * east + c * down for a, b, c in axes_n]
        x, y, z = solution.angular_rate_b.tolist()
        flat = np.zeros(36)
        flat.reshape(6, 6)[:3, :3] = _velocity_covariance(solution, axes_n)
        flat[21], flat[28], flat[35] = solution.rate_variance_b
        return self._parts.twist((forward, left, up), (x, -y, -z), flat)

    def _status(self, item: DiagnosticItem) -> Any:
        level = item.level if self._parts.takes_ndarray else bytes([item.level])
        return self._parts.new(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=level,
            name=item.name,
            message=item.message,
            hardware_id="",
            values=[
                self._parts.new("diagnostic_msgs/msg/KeyValue", key=key, value=value)
                for key, value in item.values.items()
            ],
        )


def _body_axes_n(solution: NavSolution) -> tuple[Vector, Vector, Vector]:
    """Return forward, left and up of the body in NED."""
    m = rotation_of(tuple(solution.q_nb.tolist()))
    return (m[0], m[3], m[6]), (-m[1], -m[4], -m[7]), (-m[2], -m[5], -m[8])


def _velocity_covariance(solution: NavSolution, axes_n: tuple[Vector, Vector, Vector]) -> Array:
    """Return the velocity's covariance (3, 3) in body FLU axes.

    Along the axis ``a`` its error is ``a . (dv + [v x] phi)``.
    """
    velocity_n = tuple(solution.velocity_n.tolist())
    forward, left, up = axes_n
    rows = (
        *(cross(forward, velocity_n) + forward),
        *(cross(left, velocity_n) + left),
        *(cross(up, velocity_n) + up),
    )
    partials = np.array(rows).reshape(3, 6)
    # np.dot rather than @: the same product in half the time for matrices this small.
    turned: Array = np.dot(np.dot(partials, solution.covariance[3:9, 3:9]), partials.T)
    return turned
