"""Read ROS 1 bags without ROS; the messages are decoded through rosbags.

The reader of rosbags accepts only complete bags. A flight that ended in a crash or with an empty
battery leaves a bag without an index, so the file is walked here (``ros1_contents``).
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Collection, Iterator
from mmap import mmap
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.io.bags.ros1_contents import Chunk, Connection, contents_of
from tirgeo_ros.io.bags.ros1_records import MAGIC
from tirgeo_ros.io.bags.time_order import Placed, damage_line, in_time_order
from tirgeo_ros.io.files.mapped_file import mapped
from tirgeo_ros.io.files.whole_files import PathLike

# Raised by the decoders for bytes that are no such message.
_UNREADABLE = (SerdeError, AssertionError, IndexError, OverflowError, struct.error, ValueError)
#: Raised by the types' generator for an invalid definition.
_UNDEFINED = (TypesysError, SyntaxError, KeyError, ValueError, RecursionError)


class Ros1Message(NamedTuple):
    """Hold a message as it is in a bag."""

    topic: str
    typename: str  # sensor_msgs/msg/Imu
    record_ns: int  # when the recorder received it
    connection: int
    data: bytes


class Ros1Bag:
    """Read a bag; a cut, damaged or unfinished one as far as possible.

    Raises BagError if the file is absent, not a ROS 1 bag of version 2.0, encrypted, or without
    messages. ``damage`` describes after an iteration what was lost. Memory: one chunk and those
    that overlap it in time.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        self._read = 0
        self._unknown: Counter[int] = Counter()
        self._stores: dict[tuple[str, str], Typestore | str] = {}
        with mapped(self.path) as data:
            if data[: len(MAGIC)] != MAGIC:
                raise BagError(f"{self.path}: not a ROS 1 bag of version 2.0")
            self._contents = contents_of(data, str(self.path))
        if not self._contents.chunks:
            raise BagError(f"{self.path}: no message can be read; {self.damage or 'it has none'}")

    def topics(self) -> dict[str, tuple[str, ...]]:
        """Return every topic in the bag with the names of its types (there should be one)."""
        found: dict[str, set[str]] = {}
        for connection in self._contents.connections.values():
            found.setdefault(connection.topic, set()).add(connection.typename)
        return {topic: tuple(sorted(types)) for topic, types in sorted(found.items())}

    @property
    def span_ns(self) -> tuple[int, int]:
        """Return the record times of the first and of the last message."""
        chunks = self._contents.chunks
        return min(c.start_ns or 0 for c in chunks), max(c.end_ns or 0 for c in chunks)

    @property
    def damage(self) -> str | None:
        """Return in one line what could not be read, None if nothing was lost.

        The line is complete after an iteration over all topics.
        """
        losses = [what for _, what in sorted(self._contents.losses.items())]
        if self._unknown:
            losses.append(f"{self._unknown.total()} messages are of topics that nothing names")
        return damage_line(losses, self._read)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Ros1Message]:
        """Return the messages of these topics in order of the times when they were recorded."""
        self._read = 0
        self._unknown.clear()
        with mapped(self.path) as data:
            chunks = self._contents.chunks
            parts = ((chunk.start_ns or 0, self._loaded(data, chunk, topics)) for chunk in chunks)
            yield from in_time_order(parts, self.path)

    def _loaded(
        self, data: mmap, chunk: Chunk, topics: Collection[str] | None
    ) -> Iterator[Placed[Ros1Message]]:
        """Yield the messages of a chunk."""
        for number, raw in enumerate(self._contents.messages(data, chunk)):
            connection = self._contents.connections.get(raw.connection)
            if connection is None:
                self._unknown[raw.connection] += 1
            elif topics is None or connection.topic in topics:
                name, typename, _ = connection
                message = Ros1Message(name, typename, raw.record_ns, raw.connection, raw.data)
                self._read += 1
                yield raw.record_ns, chunk.offset, number, message

    def decoded(self, message: Ros1Message) -> Any:
        """Decode the message by its definition in the bag; times have sec, nanosec.

        Raises MessageError if its bytes are no such message, or its type is not defined.
        """
        store = self._store(self._contents.connections[message.connection])
        try:
            return store.deserialize_ros1(message.data, message.typename)
        except _UNREADABLE as error:
            raise MessageError(
                f"{message.topic}: {len(message.data)} bytes are no {message.typename}: {error}"
            ) from None

    def _store(self, connection: Connection) -> Typestore:
        key = connection.typename, connection.definition
        if key not in self._stores:
            self._stores[key] = _store_of(connection)
        store = self._stores[key]
        if isinstance(store, str):
            raise MessageError(f"{connection.topic}: {store}")
        return store


def _store_of(connection: Connection) -> Typestore | str:
    """Return the types of a connection's definition; a text if it is invalid.

    Each connection has its own store: two wrappers in one bag may use one name for different
    types.
    """
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(connection.definition, connection.typename))
        store.get_msgdef(connection.typename)
    except _UNDEFINED:
        return f"the bag does not define {connection.typename}"
    return store
