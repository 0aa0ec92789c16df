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
"""Convert the sensors' samples to messages and back, each with its topic.

Only axes, units and marks of absence are converted. Samples are not judged here: a NaN, a zero
quaternion or an impossible covariance is passed on, and the core gives a verdict on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.frames.rotations import quat_turned_both
from tirgeo_ros.core.types.arrays import Array, Quaternion
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    NavigationInput,
    PositionSample,
    PressureSample,
    SetHeading,
    Source,
    VelocitySample,
)
from tirgeo_ros.io.messages.message_parts import (
    NO_ROTATION,
    UNKNOWN_VARIANCE,
    MessageParts,
    covariance_turned_world,
    frd_ned,
    positive,
    stamp_ns,
)

#: The gimbal's joints in the order of its chain, and the sign of each from FLU to FRD: the axes y
#: and z point the other way, x does not.
JOINT_SIGNS = {"gimbal_yaw_joint": -1.0, "gimbal_roll_joint": 1.0, "gimbal_pitch_joint": -1.0}
_JOINT_STATES = "gimbal/joint_states"
#: Frame id of joint angles that were computed without encoders: the topic that they come from.
COMPUTED_FROM = "gimbal/attitude"
_ABSENT = -1.0  # first entry of a covariance whose value is absent (sensor_msgs/Imu)
_COVARIANCE_TYPE_UNKNOWN = 0

_FIX, _TWIST = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/TwistWithCovarianceStamped"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_IMU, _PRESSURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/FluidPressure"
_JOINTS, _ATTITUDE = "sensor_msgs/msg/JointState", "geometry_msgs/msg/QuaternionStamped"

SensedSample = NavigationInput | JointSample | CameraAttitudeSample


class SensorMessages(MessageParts):
    """Build the messages of samples."""

    def imu(self, sample: ImuSample) -> Any:
        """Return ``sensor_msgs/Imu``: FRD to FLU; covariances zero, which means unknown.

        The rate and the force of a sample that has only an attitude are marked as absent.
        """
        attitude = sample.autopilot_q_nb
        q_enu = NO_ROTATION if attitude is None else quat_turned_both(*attitude.tolist())
        rate, force = (sample.angular_rate_b, np.zeros(9)), (sample.specific_force_b, np.zeros(9))
        if sample.is_attitude_alone:
            rate, force = ((np.zeros(3), _absent()) for _ in range(2))
        of_attitude = q_enu, _absent() if attitude is None else np.zeros(9)
        return self._imu(sample.stamp_ns, of_attitude, rate, force)

    def heading(self, sample: HeadingSample) -> Any:
        """Return ``sensor_msgs/Imu`` with the heading as ENU yaw; all else is marked as absent."""
        covariance = np.zeros(9)
        covariance[[0, 4, 8]] = UNKNOWN_VARIANCE, UNKNOWN_VARIANCE, sample.variance_rad2
        nothing = (np.zeros(3), _absent())
        q_enu = _level_attitude(sample.heading_rad)
        return self._imu(sample.stamp_ns, (q_enu, covariance), nothing, nothing)

    def nav_sat_fix(self, sample: PositionSample, frame_id: str) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of an antenna."""
        return self._fix(sample.stamp_ns, frame_id, sample, sample.covariance_n, sample.status)

    def velocity(self, sample: VelocitySample, frame_id: str) -> Any:
        """Return ``geometry_msgs/TwistWithCovarianceStamped``, ENU; the rate is unknown."""
        covariance = np.diag([0.0] * 3 + [UNKNOWN_VARIANCE] * 3)
        covariance[:3, :3] = covariance_turned_world(sample.covariance_n, 3).reshape(3, 3)
        north, east, down = sample.velocity_n.tolist()
        twist = self._twist((east, north, -down), (0.0, 0.0, 0.0), covariance.ravel())
        return self.stamped(_TWIST, sample.stamp_ns, frame_id, twist=twist)

    def pressure(self, sample: PressureSample) -> Any:
        """Return ``sensor_msgs/FluidPressure``."""
        values = {"fluid_pressure": sample.pressure_pa, "variance": sample.variance_pa2}
        return self.stamped(_PRESSURE, sample.stamp_ns, self.frames.base_link, **values)

    def set_heading(self, sample: SetHeading) -> Any:
        """Return ``geometry_msgs/PoseWithCovarianceStamped``: the yaw and its variance alone."""
        covariance = np.zeros((6, 6))
        covariance[5, 5] = sample.variance_rad2
        q_enu = _level_attitude(sample.heading_rad)
        return self._map_pose(sample.stamp_ns, np.zeros(3), q_enu, covariance)

    def joints(self, sample: JointSample) -> Any:
        """Return ``sensor_msgs/JointState`` of the gimbal, FLU.

        Its frame is base_link, or COMPUTED_FROM for computed joints.
        """
        frd = (sample.yaw_rad, sample.roll_rad, sample.pitch_rad)
        angles = [sign * angle for sign, angle in zip(JOINT_SIGNS.values(), frd, strict=True)]
        return self.stamped(
            _JOINTS,
            sample.stamp_ns,
            COMPUTED_FROM if sample.computed else self.frames.base_link,
            name=list(JOINT_SIGNS),
            position=np.array(angles, float),
            velocity=np.array([], float),
            effort=np.array([], float),
        )

    def camera_attitude(self, sample: CameraAttitudeSample) -> Any:
        """Return ``geometry_msgs/QuaternionStamped``: camera body FLU in ENU."""
        q_enu = self._quaternion(positive(quat_turned_both(*sample.q_ng.tolist())))
        return self.stamped(_ATTITUDE, sample.stamp_ns, self.frames.map, quaternion=q_enu)

    def _imu(
        self,
        stamp_ns: int,
        attitude: tuple[Quaternion, Array],
        rate: tuple[Array, Array],
        force: tuple[Array, Array],
    ) -> Any:
        """Return ``sensor_msgs/Imu`` of an attitude (wxyz, FLU to ENU), a rate and a force.

        Rate and force are (3,), FRD. Each value comes with its covariance (9,).
        """
        (rate_x, rate_y, rate_z), (x, y, z) = rate[0].tolist(), force[0].tolist()
        return self.stamped(
            _IMU,
            stamp_ns,
            self.frames.base_link,
            orientation=self._quaternion(positive(attitude[0])),
            orientation_covariance=attitude[1],
            angular_velocity=self._vector((rate_x, -rate_y, -rate_z)),
            angular_velocity_covariance=rate[1],
            linear_acceleration=self._vector((x, -y, -z)),
            linear_acceleration_covariance=force[1],
        )


def _level_attitude(heading_rad: float) -> Quaternion:
    """Return the quaternion, FLU to ENU, of a level body with this heading."""
    half = 0.5 * (0.5 * math.pi - heading_rad)
    return math.cos(half), 0.0, 0.0, math.sin(half)


def _absent() -> Array:
    """Return the (9,) covariance that marks a value as absent (sensor_msgs/Imu)."""
    return np.array([_ABSENT, *[0.0] * 8])


def imu_sample(msg: Any) -> ImuSample:
    """Convert ``sensor_msgs/Imu``; no attitude if its covariance marks it as absent.

    Rates that are marked as absent are nan, and so is the force that is then marked too.
    """
    force, rate = msg.linear_acceleration, msg.angular_velocity
    force_b = np.array([force.x, -force.y, -force.z])
    rate_b = np.array([rate.x, -rate.y, -rate.z])
    attitude = None if msg.orientation_covariance[0] == _ABSENT else frd_ned(msg.orientation)
    if msg.angular_velocity_covariance[0] == _ABSENT:
        rate_b = np.full(3, math.nan)
        if msg.linear_acceleration_covariance[0] == _ABSENT:
            force_b = np.full(3, math.nan)
    return ImuSample(stamp_ns(msg), force_b, rate_b, attitude)


def heading_sample(msg: Any) -> HeadingSample:
    """Convert ``sensor_msgs/Imu`` of a dual-antenna receiver: heading in [0, 2 pi), or NaN."""
    present = msg.orientation_covariance[0] != _ABSENT
    yaw = _enu_yaw(msg.orientation) if present else math.nan
    heading = (0.5 * math.pi - yaw) % math.tau
    return HeadingSample(stamp_ns(msg), heading, float(msg.orientation_covariance[8]))


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


def pressure_sample(msg: Any) -> PressureSample:
    """Convert ``sensor_msgs/FluidPressure``, Pa and Pa2."""
    return PressureSample(stamp_ns(msg), float(msg.fluid_pressure), float(msg.variance))


def set_heading(msg: Any) -> SetHeading:
    """Convert ``geometry_msgs/PoseWithCovarianceStamped``: the yaw alone, and its variance."""
    heading = (0.5 * math.pi - _enu_yaw(msg.pose.pose.orientation)) % math.tau
    return SetHeading(stamp_ns(msg), heading, float(msg.pose.covariance[35]))


def joint_sample(msg: Any) -> JointSample:
    """Convert ``sensor_msgs/JointState`` of the gimbal, FLU joints to FRD.

    Joints whose frame is the topic ``gimbal/attitude`` are computed. Raises MessageError if one of
    the three joints is missing.
    """
    positions = dict(zip(msg.name, msg.position, strict=False))
    for joint in JOINT_SIGNS:
        if joint not in positions:
            raise MessageError(f"{_JOINT_STATES}: no position of {joint} in the message")
    yaw, roll, pitch = (sign * float(positions[joint]) for joint, sign in JOINT_SIGNS.items())
    computed = msg.header.frame_id == COMPUTED_FROM
    return JointSample(stamp_ns(msg), yaw, roll, pitch, computed=computed)


def camera_attitude(msg: Any) -> CameraAttitudeSample:
    """Convert ``geometry_msgs/QuaternionStamped``: camera body FLU in ENU."""
    return CameraAttitudeSample(stamp_ns(msg), frd_ned(msg.quaternion))


def _covariance(enu: Any) -> Array:
    """Return the covariance (3, 3) in NED; zero if the first entry marks it as absent."""
    flat = np.asarray(enu).ravel()
    if flat[0] == _ABSENT:
        return np.zeros((3, 3))
    return covariance_turned_world(flat, 3).reshape(3, 3)


def _enu_yaw(q: Any) -> float:
    """Return the ENU yaw (rad) of a quaternion of any length; NaN for length zero."""
    if not q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z > 0:
        return math.nan
    sine = 2 * (q.w * q.z + q.x * q.y)
    return math.atan2(sine, q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)


class _Row(NamedTuple):
    """Hold a topic's message type, and the functions that convert its messages."""

    typename: str
    decode: Callable[[Any], Any]
    encode: Callable[[SensorMessages, Any], Any]
    by_dji: bool = True  # whether dji_node publishes it


def _fix(source: Source, frame: str) -> _Row:
    decode = partial(position_sample, source=source)
    return _Row(_FIX, decode, lambda m, s: m.nav_sat_fix(s, getattr(m.frames, frame)))


def _velocity(source: Source, frame: str) -> _Row:
    decode = partial(velocity_sample, source=source)
    return _Row(_TWIST, decode, lambda m, s: m.velocity(s, getattr(m.frames, frame)))


#: Topic of a sensor -> its row.
BY_TOPIC: dict[str, _Row] = {
    "imu/data": _Row(_IMU, imu_sample, SensorMessages.imu),
    "rtk/fix": _fix(Source.RTK_POSITION, "rtk_antenna"),
    "rtk/vel": _velocity(Source.RTK_VELOCITY, "rtk_antenna"),
    "rtk/heading": _Row(_IMU, heading_sample, SensorMessages.heading),
    "gps/fix": _fix(Source.GPS_POSITION, "gps_antenna"),
    "gps/vel": _velocity(Source.GPS_VELOCITY, "gps_antenna"),
    "baro/pressure": _Row(_PRESSURE, pressure_sample, SensorMessages.pressure, by_dji=False),
    "ekf_node/set_heading": _Row(_POSE, set_heading, SensorMessages.set_heading, by_dji=False),
    _JOINT_STATES: _Row(_JOINTS, joint_sample, SensorMessages.joints),
    COMPUTED_FROM: _Row(_ATTITUDE, camera_attitude, SensorMessages.camera_attitude),
}

#: Source of the filter's inputs -> its topic, and the decoder of its messages.
NAVIGATION_INPUTS: Mapping[Source, tuple[str, Callable[[Any], NavigationInput]]] = {
    source: (source.topic, BY_TOPIC[source.topic].decode)
    for source in Source
    if source not in {Source.AUTOPILOT_HEADING, Source.REST}  # parts of the IMU's messages
}

#: The topics of all sensors, and of those that dji_node publishes.
SENSED_TOPICS = tuple(BY_TOPIC)
DJI_TOPICS = tuple(topic for topic, row in BY_TOPIC.items() if row.by_dji)

#: Topic of a sensor -> the decoder of its messages.
SENSED_SAMPLES: Mapping[str, Callable[[Any], SensedSample]] = {
    topic: row.decode for topic, row in BY_TOPIC.items()
}


def topic_of(sample: SensedSample) -> str:
    """Return the contract's topic of a sensor's sample."""
    if isinstance(sample, JointSample):
        return _JOINT_STATES
    return COMPUTED_FROM if isinstance(sample, CameraAttitudeSample) else sample.source.topic


def sensed(messages: SensorMessages, sample: SensedSample) -> tuple[str, Any]:
    """Return the contract's topic and the message of a sensor's sample."""
    topic = topic_of(sample)
    return topic, BY_TOPIC[topic].encode(messages, sample)
