"""Convert messages to the core's samples.

Only axes, units and marks of absence are converted. Samples are not judged here: a NaN, a zero
quaternion or an impossible covariance is passed on, and the core gives a verdict on it.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import numpy as np

from tirgeo_ros.core.frames.rotations import quat_turned_both
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.streams.sanity_checks import place_fault
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    PressureSample,
    SetHeading,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io.messages.message_parts import (
    COMPUTED_FROM,
    JOINT_SIGNS,
    covariance_turned_world,
    quat_turned_world,
)

_ABSENT = -1.0  # first entry of a covariance whose value is absent (sensor_msgs/Imu)
_COVARIANCE_TYPE_UNKNOWN = 0


def stamp_ns(msg: Any) -> int:
    """Return the header's stamp in nanoseconds."""
    stamp = msg.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def imu_sample(msg: Any) -> ImuSample:
    """Convert ``sensor_msgs/Imu``; no attitude if its covariance marks it as absent."""
    force, rate = msg.linear_acceleration, msg.angular_velocity
    attitude = None if msg.orientation_covariance[0] == _ABSENT else _both(msg.orientation)
    return ImuSample(
        stamp_ns(msg),
        np.array([force.x, -force.y, -force.z]),
        np.array([rate.x, -rate.y, -rate.z]),
        attitude,
    )


def position_sample(msg: Any, source: Source) -> PositionSample:
    """Convert ``sensor_msgs/NavSatFix``; a covariance of unknown type becomes zero.

    A status number that the contract does not define counts as no fix.
    """
    has_covariance = msg.position_covariance_type != _COVARIANCE_TYPE_UNKNOWN
    status = FixStatus.NONE
    with suppress(ValueError):
        status = FixStatus(int(msg.status.status))
    return PositionSample(
        stamp_ns(msg),
        source,
        status,
        math.radians(msg.latitude),
        math.radians(msg.longitude),
        float(msg.altitude),
        _covariance(msg.position_covariance) if has_covariance else np.zeros((3, 3)),
    )


def velocity_sample(msg: Any, source: Source) -> VelocitySample:
    """Convert ``geometry_msgs/TwistWithCovarianceStamped``, ENU in ``linear``."""
    linear = msg.twist.twist.linear
    covariance = np.asarray(msg.twist.covariance).reshape(6, 6)[:3, :3]
    velocity_n = np.array([linear.y, linear.x, -linear.z])
    return VelocitySample(stamp_ns(msg), source, velocity_n, _covariance(covariance))


def heading_sample(msg: Any) -> HeadingSample:
    """Convert ``sensor_msgs/Imu`` of a dual-antenna receiver: heading in [0, 2 pi), or NaN."""
    present = msg.orientation_covariance[0] != _ABSENT
    yaw = _enu_yaw(msg.orientation) if present else math.nan
    heading = (0.5 * math.pi - yaw) % math.tau
    return HeadingSample(stamp_ns(msg), heading, float(msg.orientation_covariance[8]))


def set_heading(msg: Any) -> SetHeading:
    """Convert ``geometry_msgs/PoseWithCovarianceStamped``: the yaw alone, and its variance."""
    heading = (0.5 * math.pi - _enu_yaw(msg.pose.pose.orientation)) % math.tau
    return SetHeading(stamp_ns(msg), heading, float(msg.pose.covariance[35]))


def pressure_sample(msg: Any) -> PressureSample:
    """Convert ``sensor_msgs/FluidPressure``, Pa and Pa2."""
    return PressureSample(stamp_ns(msg), float(msg.fluid_pressure), float(msg.variance))


def joint_sample(msg: Any) -> JointSample:
    """Convert ``sensor_msgs/JointState`` of the gimbal, FLU joints to FRD.

    Joints whose frame is the topic ``gimbal/attitude`` are computed. Raises MessageError if one of
    the three joints is missing.
    """
    positions = dict(zip(msg.name, msg.position, strict=False))
    for joint in JOINT_SIGNS:
        if joint not in positions:
            raise MessageError(f"gimbal/joint_states: no position of {joint} in the message")
    yaw, roll, pitch = (sign * float(positions[joint]) for joint, sign in JOINT_SIGNS.items())
    computed = msg.header.frame_id == COMPUTED_FROM
    return JointSample(stamp_ns(msg), yaw, roll, pitch, computed=computed)


def camera_attitude(msg: Any) -> CameraAttitudeSample:
    """Convert ``geometry_msgs/QuaternionStamped``: camera body FLU in ENU."""
    return CameraAttitudeSample(stamp_ns(msg), _both(msg.quaternion))


def body_pose(msg: Any) -> BodyPose:
    """Convert ``nav_msgs/Odometry`` of ``tirgeo/odometry``."""
    pose = msg.pose.pose
    covariance = covariance_turned_world(msg.pose.covariance, 6).reshape(6, 6)
    return BodyPose(stamp_ns(msg), _ned(pose.position), _both(pose.orientation), covariance)


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


def ground_point(msg: Any) -> tuple[int, Array, Array]:
    """Decode ``tirgeo/locate/point``: stamp (ns), point (3,) and covariance (3, 3), local NED."""
    covariance = covariance_turned_world(msg.pose.covariance, 6).reshape(6, 6)[:3, :3]
    return stamp_ns(msg), _ned(msg.pose.pose.position), covariance


def pixel(msg: Any) -> tuple[int, float, float]:
    """Convert ``PointStamped`` of ``tirgeo/locate/pixel``: stamp (ns), column, row."""
    return stamp_ns(msg), float(msg.point.x), float(msg.point.y)


def _covariance(enu: Any) -> Array:
    """Return the covariance (3, 3) in NED; zero if the first entry marks it as absent."""
    flat = np.asarray(enu).ravel()
    if flat[0] == _ABSENT:
        return np.zeros((3, 3))
    return covariance_turned_world(flat, 3).reshape(3, 3)


def _both(q: Any) -> Array:
    return np.array(quat_turned_both(q.w, q.x, q.y, q.z))


def _ned(point: Any) -> Array:
    return np.array([point.y, point.x, -point.z])


def _enu_yaw(q: Any) -> float:
    """Return the ENU yaw (rad) of a quaternion of any length; NaN for length zero."""
    if not q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z > 0:
        return math.nan
    sine = 2 * (q.w * q.z + q.x * q.y)
    return math.atan2(sine, q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)
