"""Message classes, definitions and CDR of ROS 2 Jazzy without ROS, through rosbags."""

from __future__ import annotations

from functools import cache
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tirgeo_ros.core.errors import BagError, MessageError

# What a store raises for bytes that are no such message: its own, and what it lets through.
_UNREADABLE = (SerdeError, AssertionError, IndexError, OverflowError, TypeError, ValueError)


@cache
def _store() -> Typestore:
    """One store for the process: it takes a quarter of a second to make and is only read."""
    return get_typestore(Stores.ROS2_JAZZY)


class Cdr:
    """Serialises and deserialises messages by type name (``sensor_msgs/msg/Imu``)."""

    def types(self, typename: str) -> type:
        """The message class. Raises BagError for a type that is not in common_interfaces."""
        try:
            return _store().types[typename]
        except KeyError:
            raise BagError(f"message type {typename} is not known") from None

    def serialize(self, message: Any, typename: str) -> bytes:
        """A message as CDR, little endian, with its encapsulation header."""
        return bytes(_store().serialize_cdr(message, typename, little_endian=True))

    def deserialize(self, data: bytes, typename: str, topic: str = "") -> Any:
        """The message in CDR bytes. Raises MessageError naming ``topic`` where there is none."""
        self.types(typename)
        try:
            return _store().deserialize_cdr(data, typename)
        except _UNREADABLE as error:
            raise MessageError(
                f"{topic or typename}: {len(data)} bytes are no {typename}: {error}"
            ) from None

    def definition(self, typename: str) -> str:
        """The text of the definition with all that it is made of, as an MCAP schema holds it."""
        self.types(typename)
        return _store().generate_msgdef(typename, ros_version=2)[0]
