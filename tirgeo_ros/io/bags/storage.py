"""Define what a bag's files have in common: messages, and what to ask a file for."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, Protocol

import zstandard

from tirgeo_ros.io.files.bounded_unpacking import unpacked

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


class Storage(Protocol):
    """Read one file of a bag."""

    name: Path  # for messages to people: the file itself may be an unpacked copy
    span_ns: tuple[int, int] | None  # log times of the first and the last message
    losses: dict[int, str]  # what could not be read, by place
    read: int  # messages that the last iteration gave

    def topics(self) -> dict[str, str]:
        """Return every topic of which the file has messages, with the name of its type."""
        ...

    def forms(self) -> dict[str, TopicForm]:
        """Return how each of these topics was recorded."""
        ...

    def messages(
        self, topics: Collection[str] | None, start_ns: int, *, any_form: bool = False
    ) -> Iterator[BagMessage]:
        """Return the messages of these topics (None: all) in order of log time, from one on.

        Raises BagError if one of these topics is not in CDR, unless they may have ``any_form``.
        """
        ...


def too_late(number: int) -> str:
    """Return in words that messages are left out for their log times."""
    return f"{number} message{'s' * (number > 1)} with a log time after 2038 left out"


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
