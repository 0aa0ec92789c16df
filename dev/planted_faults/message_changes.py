"""What planted faults make of messages."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from dev.planted_faults.planting import Item, restamped
from tirgeo_ros.io.bags.bag import Cdr

#: Changes a message in place.
MessageChange = Callable[[Any], None]


def scaled(field: str, factor: float) -> MessageChange:
    """Return a change of a vector of a message by a factor."""

    def change(message: Any) -> None:
        vector = getattr(message, field)
        vector.x, vector.y, vector.z = (factor * v for v in (vector.x, vector.y, vector.z))

    return change


def joints(change: Callable[[dict[str, float]], dict[str, float]]) -> MessageChange:
    """Return a change of joint angles (rad) by the axis that they turn."""

    def changed(message: Any) -> None:
        angles = dict(zip(message.name, map(float, message.position), strict=True))
        new = change({name.split("_")[1]: angle for name, angle in angles.items()})
        message.position = np.array([new[name.split("_")[1]] for name in message.name])

    return changed


def swapped_tilt(angles: dict[str, float]) -> dict[str, float]:
    """Return angles with roll and pitch swapped."""
    return angles | {"roll": angles["pitch"], "pitch": angles["roll"]}


def lowered(by_m: float) -> MessageChange:
    """Return a change of the height of fixes."""

    def change(message: Any) -> None:
        message.altitude -= by_m

    return change


def longer_lens(message: Any) -> None:
    """Make the focal lengths half as long again."""
    message.k = message.k * np.array([1.5, 1, 1, 1, 1.5, 1, 1, 1, 1])


def half_size(message: Any) -> None:
    """Make a calibration that of pictures of half the size."""
    message.width, message.height = message.width // 2, message.height // 2
    message.k = message.k * np.array([0.5, 1, 0.5, 1, 0.5, 0.5, 1, 1, 1])


def ned_velocity(message: Any) -> None:
    """Put an ENU velocity into NED."""
    linear = message.twist.twist.linear
    linear.x, linear.y, linear.z = linear.y, linear.x, -linear.z


def no_covariance(message: Any) -> None:
    """Take the sigmas of a fix away."""
    message.position_covariance = np.zeros(9)


def late(item: Item) -> Iterator[Item]:
    """Let it arrive 0.6 s later, and stamp it so."""
    restamped(item.message.header, 600_000_000)
    yield dataclasses.replace(item, log_time_ns=item.log_time_ns + 600_000_000)


def points(item: Item) -> Iterator[Item]:
    """Send joints as a point, as some gimbal drivers do."""
    typename = "geometry_msgs/msg/Vector3Stamped"
    kind = Cdr().types(typename)
    vector = Cdr().types("geometry_msgs/msg/Vector3")(*map(float, item.message.position[:3]))
    yield dataclasses.replace(
        item, typename=typename, message=kind(header=item.message.header, vector=vector)
    )
