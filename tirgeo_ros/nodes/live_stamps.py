"""Shift the stamps of recorded messages in time, wherever they are in a message."""

from __future__ import annotations

from typing import Any

from std_msgs.msg import Header

from tirgeo_ros.io.messages import stamp_ns


def moved(message: Any, shift_ns: int) -> Any:
    """Add ``shift_ns`` to the stamps of all headers, in place; return the message. 0 stays 0."""
    if shift_ns:
        _move(message, shift_ns)
    return message


def _move(part: Any, shift_ns: int) -> None:
    for name in part.get_fields_and_field_types():
        value = getattr(part, name)
        if isinstance(value, Header):
            _move_header(part, shift_ns)
        elif hasattr(value, "get_fields_and_field_types"):
            _move(value, shift_ns)
        elif isinstance(value, list) and value and hasattr(value[0], "get_fields_and_field_types"):
            for item in value:
                _move(item, shift_ns)


def _move_header(part: Any, shift_ns: int) -> None:
    stamp = stamp_ns(part)
    if stamp:
        sec, nanosec = divmod(stamp + shift_ns, 1_000_000_000)
        part.header.stamp.sec, part.header.stamp.nanosec = sec, nanosec
