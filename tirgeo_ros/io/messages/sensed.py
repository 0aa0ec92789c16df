"""Which topic each of the aircraft's samples goes to, and as what message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tirgeo_ros.core.samples import (
    CameraAttitudeSample,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    Source,
    VelocitySample,
)
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

#: The topics that the aircraft's samples go to.
SENSED_TOPICS = tuple(topic for topic, _ in _SENSED.values())


def sensed(messages: Messages, sample: SensedSample) -> tuple[str, Any]:
    """The topic of the contract and the message of a sample of the aircraft."""
    topic, encode = _SENSED[_kind(sample)]
    return topic, encode(messages, sample)


def _kind(sample: SensedSample) -> Source | type:
    if isinstance(sample, PositionSample | VelocitySample):
        return sample.source
    return type(sample)
