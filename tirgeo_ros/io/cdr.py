"""Message classes, definitions and CDR of ROS 2 Jazzy without ROS, through rosbags."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tirgeo_ros.core.errors import BagError, MessageError

# What the decoders raise for bytes that are no such message.
_UNREADABLE = (SerdeError, AssertionError, IndexError, OverflowError, struct.error, ValueError)
_DECODERS = {b"\0\0": "deserialize_cdr_be", b"\0\1": "deserialize_cdr_le"}
# Fast CDR reckons up to 7 bytes too many for each empty list and sends them, whatever is in them.
_MOST_SURPLUS = 64


@cache
def _store() -> Typestore:
    """One store for the process: it takes a quarter of a second to make and is only read."""
    return get_typestore(Stores.ROS2_JAZZY)


def _decoded(data: bytes, typename: str) -> tuple[Any, int]:
    """The message and the number of bytes behind it, which the store's own way does not allow."""
    if data[:2] not in _DECODERS:
        raise ValueError("no plain CDR")
    definition = _store().get_msgdef(typename)
    decode = getattr(definition, _DECODERS[data[:2]])
    message, end = decode(data[4:], 0, definition.cls, _store())
    return message, len(data) - 4 - end


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
            message, surplus = _decoded(data, typename)
        except _UNREADABLE as error:
            raise MessageError(
                f"{topic or typename}: {len(data)} bytes are no {typename}: {error}"
            ) from None
        if surplus > _MOST_SURPLUS:
            raise MessageError(
                f"{topic or typename}: {surplus} bytes are left over behind a {typename}"
            )
        return message

    def definition(self, typename: str) -> str:
        """The text of the definition with all that it is made of, as an MCAP schema holds it."""
        self.types(typename)
        return _store().generate_msgdef(typename, ros_version=2)[0]
