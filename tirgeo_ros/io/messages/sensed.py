"""Map each of the aircraft's samples to its topic and message, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.io.messages.decode import NAVIGATION_INPUTS, camera_attitude, joint_sample
from tirgeo_ros.io.messages.encode import Messages

SensedSample = (
    ImuSample
    | PositionSample
    | VelocitySample
    | HeadingSample
    | JointSample
    | CameraAttitudeSample
)

_SENSED: dict[Source | type, tuple[str, Callable[[Messages, Any], Any]]] = {
    ImuSample: ("imu/data", Messages.imu),
    HeadingSample: ("rtk/heading", Messages.heading),
    JointSample: ("gimbal/joint_states", Messages.joints),
    CameraAttitudeSample: ("gimbal/attitude", Messages.camera_attitude),
    Source.RTK_POSITION: ("rtk/fix", lambda m, s: m.nav_sat_fix(s, "rtk_antenna")),
    Source.RTK_VELOCITY: ("rtk/vel", lambda m, s: m.velocity(s, "rtk_antenna")),
    Source.GPS_POSITION: ("gps/fix", lambda m, s: m.nav_sat_fix(s, "gps_antenna")),
    Source.GPS_VELOCITY: ("gps/vel", lambda m, s: m.velocity(s, "gps_antenna")),
}

#: The topics that the aircraft's samples are published on.
SENSED_TOPICS = tuple(topic for topic, _ in _SENSED.values())

#: The decoder of each of these topics' messages.
SENSED_SAMPLES: Mapping[str, Callable[[Any], SensedSample]] = {
    **dict(NAVIGATION_INPUTS.values()),
    "gimbal/joint_states": joint_sample,
    "gimbal/attitude": camera_attitude,
}


def sensed(messages: Messages, sample: SensedSample) -> tuple[str, Any]:
    """Return the topic of the contract and the message of a sample of the aircraft."""
    topic, encode = _SENSED[_kind(sample)]
    return topic, encode(messages, sample)


def _kind(sample: SensedSample) -> Source | type:
    if isinstance(sample, PositionSample | VelocitySample):
        return sample.source
    return type(sample)
