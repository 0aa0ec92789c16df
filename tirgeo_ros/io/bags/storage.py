"""Define what a bag's files have in common: messages, and how topics were recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import zstandard

from tirgeo_ros.io.files.bounded_unpacking import unpacked

#: What becomes of messages whose log time no stamp can hold; their number is put before it.
TOO_LATE = "messages with a log time after 2038 left out"
#: Begins a message that rosbag2 compressed by itself, and a compressed file. No CDR begins so.
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


class BagMessage(NamedTuple):
    """Hold a message as it is in a bag."""

    topic: str
    typename: str
    log_time_ns: int
    data: bytes  # CDR


class TopicForm(NamedTuple):
    """Hold how a topic was recorded, beside its messages."""

    typename: str
    definition: bytes  # of the type; empty where the recorder found none
    encoding: str  # of the definition: ros2msg or ros2idl, else empty or "unknown"
    message_encoding: str  # cdr
    metadata: Mapping[str, str]  # as MCAP holds it: QoS as offered_qos_profiles, the type's hash


def plain(data: bytes) -> bytes:
    """Return a message's CDR, unpacked if it was compressed by itself.

    Raises ValueError: ``is cut off or damaged``.
    """
    if data[:4] != ZSTD_MAGIC:
        return data
    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError:
        raise ValueError("is cut off or damaged") from None
    return unpacked(data, "zstd", size if size >= 0 else None)
