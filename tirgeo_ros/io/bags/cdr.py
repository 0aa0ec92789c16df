"""Encode and decode CDR of ROS 2 Jazzy without ROS, through rosbags; give type definitions."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from rosbags.interfaces import Msgdef
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tirgeo_ros.core.types.errors import BagError, MessageError

#: Raised by the decoders for bytes that are not a message of the type.
UNREADABLE = (SerdeError, AssertionError, IndexError, OverflowError, struct.error, ValueError)
#: Fast CDR sends up to 7 surplus bytes, with arbitrary content, for each empty list.
_MOST_SURPLUS = 64


@cache
def _store() -> Typestore:
    """Return the process's only store of types: it takes 0.25 s to build and never changes."""
    return get_typestore(Stores.ROS2_JAZZY)


def header_stamp_ns(data: bytes) -> int:
    """Return the stamp (ns) of a message that begins with a header. Raises MessageError."""
    try:
        seconds, nanoseconds = struct.unpack_from("<iI" if data[1] else ">iI", data, 4)
    except (IndexError, struct.error):
        raise MessageError(f"{len(data)} bytes are too few for a header") from None
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


class Cdr:
    """Serialise and deserialise messages by type name (``sensor_msgs/msg/Imu``).

    The store's own methods refuse surplus bytes after a message, and are slower.
    """

    def __init__(self) -> None:
        self._store = _store()

    def types(self, typename: str) -> type:
        """Return the message class. Raises BagError for a type outside common_interfaces."""
        return self._definition(typename).cls

    def __contains__(self, typename: str) -> bool:
        """Return whether a type is known."""
        return typename in self._store.fielddefs

    def serialize(self, message: Any, typename: str) -> bytes:
        """Return a message as CDR, little endian, with its encapsulation header."""
        definition = self._definition(typename)
        size = definition.getsize_cdr(0, message, self._store)
        data = bytearray(4 + size)
        data[1] = 1  # little endian
        definition.serialize_cdr_le(memoryview(data)[4:], 0, message, self._store)
        return bytes(data)

    def deserialize(self, data: bytes, typename: str, topic: str = "") -> Any:
        """Decode CDR bytes. Raises MessageError naming ``topic`` if they are no such message."""
        definition = self._definition(typename)
        orders = {b"\0\1": definition.deserialize_cdr_le, b"\0\0": definition.deserialize_cdr_be}
        try:
            if data[:2] not in orders:
                raise ValueError("no plain CDR")
            message, end = orders[data[:2]](data[4:], 0, definition.cls, self._store)
        except UNREADABLE as error:
            raise MessageError(
                f"{topic or typename}: {len(data)} bytes are no {typename}: {error}"
            ) from None
        surplus = len(data) - 4 - end
        if surplus > _MOST_SURPLUS:
            raise MessageError(
                f"{topic or typename}: {surplus} bytes are left over after a {typename}"
            )
        return message

    def from_ros1(self, data: bytes, typename: str, topic: str = "") -> bytes:
        """Convert a message of ROS 1 to CDR. Raises MessageError if it is no such message."""
        self.types(typename)
        try:
            return bytes(self._store.ros1_to_cdr(data, typename))
        except UNREADABLE as error:
            raise MessageError(
                f"{topic or typename}: {len(data)} bytes are no {typename} of ROS 1: {error}"
            ) from None

    def definition(self, typename: str) -> str:
        """Return the text of the definition with all parts, as an MCAP schema holds it."""
        self.types(typename)
        return self._store.generate_msgdef(typename, ros_version=2)[0]

    def _definition(self, typename: str) -> Msgdef[Any]:
        try:
            return self._store.get_msgdef(typename)
        except KeyError:
            raise BagError(f"message type {typename} is not known") from None
