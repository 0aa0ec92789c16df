"""Tell which messages of other systems' bags fit a topic of the contract, and convert them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.core.types.measurements import HeadingSample, Source, VelocitySample
from tirgeo_ros.io.messages import TOPIC_TYPES, SensedSample, stamp_ns
from tirgeo_ros.tools.replay.flight_topics import CAMERA_INFO, PICTURES

#: What is suggested where a topic has a fitting type and one of the words in its name.
_SUGGESTED: Mapping[str, tuple[str, ...]] = {
    "imu/data": ("",),
    "rtk/fix": ("rtk",),
    "rtk/vel": ("rtk",),
    "rtk/heading": ("heading",),
    "gps/fix": ("",),
    "gps/vel": ("gps", "gnss", "fix"),
    "baro/pressure": ("",),
    "gimbal/joint_states": ("gimbal", "mount"),
    "gimbal/attitude": ("gimbal", "mount"),
    **dict.fromkeys((*PICTURES, CAMERA_INFO), ("",)),
}

#: Returns the sample of a message that was recorded at a time (ns).
Converter = Callable[[Any, int], SensedSample]


def _twist(source: Source) -> Converter:
    """Convert ``geometry_msgs/TwistStamped``, ENU; its covariance is unknown."""

    def convert(msg: Any, _: int) -> VelocitySample:
        linear = msg.twist.linear
        velocity_n = np.array([linear.y, linear.x, -linear.z])
        return VelocitySample(stamp_ns(msg), source, velocity_n, np.zeros((3, 3)))

    return convert


def _odometry(source: Source) -> Converter:
    """Convert ``nav_msgs/Odometry``: its twist is in the body's axes, its pose in ENU."""

    def convert(msg: Any, _: int) -> VelocitySample:
        q, linear = msg.pose.pose.orientation, msg.twist.twist.linear
        attitude = np.array([q.w, q.x, q.y, q.z])
        if not usable_attitude(attitude):
            raise MessageError("its orientation is not a unit quaternion")
        turn = _NED_ENU @ matrix_from_quat(attitude)
        velocity_n = turn @ np.array([linear.x, linear.y, linear.z])
        covariance = np.reshape(msg.twist.covariance, (6, 6))[:3, :3]
        return VelocitySample(stamp_ns(msg), source, velocity_n, turn @ covariance @ turn.T)

    return convert


def _compass(msg: Any, log_time_ns: int) -> HeadingSample:
    """Convert ``std_msgs/Float64``: degrees, clockwise from north, without a time of its own."""
    return HeadingSample(log_time_ns, math.radians(float(msg.data) % 360.0), 0.0)


_NED_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_VELOCITIES = (Source.RTK_VELOCITY, Source.GPS_VELOCITY)
#: Topic -> type of other messages than its own -> their converter.
CONVERTERS: Mapping[str, Mapping[str, Converter]] = {
    **{
        source.topic: {
            "geometry_msgs/msg/TwistStamped": _twist(source),
            "nav_msgs/msg/Odometry": _odometry(source),
        }
        for source in _VELOCITIES
    },
    Source.RTK_HEADING.topic: {"std_msgs/msg/Float64": _compass},
}
#: What a person should know of messages that are converted, or taken as they are.
_REMARKS = {
    "geometry_msgs/msg/TwistStamped": "it has no covariance, and is taken as east, north, up",
    "nav_msgs/msg/Odometry": (
        "its velocity is turned by its orientation, whose frame is taken as east, north, up: a "
        "wheel's odometry, which begins with heading 0, is none"
    ),
    "std_msgs/msg/Float64": (
        "degrees, clockwise from north, stamped when recorded; an autopilot's own compass is no "
        "heading of two antennas"
    ),
}


def types_of(topic: str) -> tuple[str, ...]:
    """Return the types that fit a topic of the contract, its own first."""
    return TOPIC_TYPES[topic], *CONVERTERS.get(topic, ())


def remark_on(typename: str) -> str:
    """Return what a person should know of a type's conversion, or an empty string."""
    return _REMARKS.get(typename, "")


def asked_topics(
    given: Iterable[tuple[str, str]], there: Mapping[str, str], where: str
) -> dict[str, list[str]]:
    """Return the bag's topic -> topics of the contract, for pairs (topic, topic of the contract).

    ``there`` are the bag's topics with their types. Raise BagError for a topic that is absent or
    does not fit, or two for one.
    """
    by_name = {name.strip("/"): name for name in there}
    found: dict[str, list[str]] = {}
    for asked, topic in given:
        name = by_name.get(asked.strip("/"))
        if name is None or there[name] not in types_of(topic):
            kind = "not there" if name is None else f"of type {there[name]}"
            fitting = [one for one, typename in there.items() if typename in types_of(topic)]
            raise BagError(
                f"{where}: {asked} is {kind}; {topic} takes {' or '.join(types_of(topic))}: "
                f"{', '.join(fitting) or 'no topic of the bag'}"
            )
        if any(topic in topics for topics in found.values()):
            raise BagError(f"{where}: two topics for {topic}: give one")
        found.setdefault(name, []).append(topic)
    return found


def suggested(there: Mapping[str, str]) -> str:
    """Return options that map a bag's topics, as far as types and names tell; else "".

    Each topic is suggested once: for the one of the contract that is named as it, or the first.
    """
    left, options = dict(there), []
    for topic, words in _SUGGESTED.items():
        named = {name: kind for name, kind in left.items() if any(w in name for w in words)}
        fitting = [name for name, kind in named.items() if kind in types_of(topic)]
        best = min(fitting, key=lambda name: (not name.endswith(topic), name), default=None)
        if best is not None:
            options.append(f"--map-topic {best}={topic}")
            del left[best]
    return " ".join(options)
