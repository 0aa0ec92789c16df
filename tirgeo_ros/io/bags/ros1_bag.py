"""Read ROS 1 bags without ROS, through rosbags, with a bound on what a chunk unpacks to."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import decompressors
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.bags.cdr import UNREADABLE
from tirgeo_ros.io.bags.ros1_unindexed import UnindexedReader
from tirgeo_ros.io.bags.storage import TOO_LATE
from tirgeo_ros.io.files.bounded_unpacking import unpacked
from tirgeo_ros.io.files.memory_bound import bounded_memory
from tirgeo_ros.io.files.whole_files import PathLike

MAGIC = b"#ROSBAG V2.0\n"

#: Raised by the reader for a damaged file.
_DAMAGED = (*UNREADABLE, ReaderError, OSError, KeyError, MemoryError, RuntimeError, EOFError)
#: Raised by the types' generator for an invalid definition.
_UNDEFINED = (TypesysError, SyntaxError, KeyError, ValueError, RecursionError)


class Ros1Message(NamedTuple):
    """Hold a message as it is in a bag."""

    topic: str
    typename: str  # sensor_msgs/msg/Imu
    record_ns: int  # when the recorder received it
    definition: str  # of its type, with all parts
    data: bytes


class Ros1Bag:
    """Read a bag.

    One without an index (it was cut off or never closed) is read up to the cut, and ``damage``
    describes what is lost, else None. Raises BagError if the file is absent, otherwise damaged,
    not a ROS 1 bag of version 2.0, encrypted, or without messages.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        self._losses: dict[str, str] = {}
        self._stores: dict[tuple[str, str], Typestore | None] = {}
        with bounded_memory(), self._opened() as reader:
            self._connections = list(reader.connections)
            if not reader.message_count:
                raise BagError(f"{self.path}: the bag has no message")
            #: Record times of the first and of the last message.
            self.span_ns = reader.start_time, reader.end_time - 1

    @contextmanager
    def _opened(self) -> Iterator[Reader]:
        try:
            with self.path.open("rb") as file:
                if file.read(len(MAGIC)) != MAGIC:
                    raise BagError(f"{self.path}: not a ROS 1 bag of version 2.0")
            with closing(self._reader()) as reader:
                names = {function: name for name, function in decompressors.items()}
                for place, chunk in reader.chunks.items():
                    unpack = partial(_unpacked, names[chunk.decompressor])
                    reader.chunks[place] = chunk._replace(decompressor=unpack)
                yield reader
        except FileNotFoundError as error:
            raise BagError(f"{self.path}: cannot be read: {error.strerror}") from None
        except _DAMAGED as error:
            raise BagError(
                f"{self.path}: cannot be read: {error or type(error).__name__}; rosbag fix or "
                "reindex of ROS 1 may mend it"
            ) from None

    def _reader(self) -> Reader:
        """Return a reader that is open: by the index, or by the chunks where that is absent."""
        reader = Reader(self.path)
        try:
            reader.open()
        except _DAMAGED:
            reader = UnindexedReader(self.path)
            reader.open()
            if not reader.message_count:
                reader.close()
                raise
            self._losses["index"] = (
                f"no usable index: it was not closed, or cut off; {reader.message_count} messages "
                f"were found, {reader.lost_bytes} bytes at the end are not readable"
            )
        return reader

    @property
    def damage(self) -> str | None:
        """Return in one line what could not be read, None if nothing was lost."""
        return "; ".join(self._losses.values()) or None

    def topics(self) -> dict[str, tuple[str, ...]]:
        """Return every topic in the bag with the names of its types (there should be one)."""
        found: dict[str, set[str]] = {}
        for connection in self._connections:
            found.setdefault(connection.topic, set()).add(connection.msgtype)
        return {topic: tuple(sorted(types)) for topic, types in sorted(found.items())}

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Ros1Message]:
        """Return the messages of these topics in order of the times when they were recorded."""

        def wanted(connection: Connection) -> bool:
            return topics is None or connection.topic in topics

        with self._opened() as reader:
            chosen = [one for one in reader.connections if wanted(one)]
            if not chosen:  # which would be all of them to the reader
                return
            late = 0
            for one, record_ns, data in reader.messages(chosen):
                if record_ns >= LAST_NS:
                    late += 1
                    self._losses["late"] = f"{late} {TOO_LATE}"
                    continue
                yield Ros1Message(one.topic, one.msgtype, record_ns, one.msgdef.data, data)

    def decoded(self, message: Ros1Message) -> Any:
        """Decode the message by its definition in the bag; times have sec, nanosec.

        Raises MessageError if its bytes are no such message, or its type is not defined.
        """
        # A store for each type's definition: two wrappers may use one name for different types.
        key = message.typename, message.definition
        if key not in self._stores:
            self._stores[key] = _store_of(*key)
        store = self._stores[key]
        if store is None:
            raise MessageError(f"{message.topic}: the bag does not define {message.typename}")
        try:
            return store.deserialize_ros1(message.data, message.typename)
        except UNREADABLE as error:
            raise MessageError(
                f"{message.topic}: {len(message.data)} bytes are no {message.typename}: {error}"
            ) from None


def _unpacked(compression: str, packed: bytes) -> bytes:
    try:
        return unpacked(packed, compression)
    except ValueError as error:
        raise ReaderError(f"a chunk {error}") from None


def _store_of(typename: str, definition: str) -> Typestore | None:
    """Return the types of a definition; None if it is invalid."""
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition, typename))
        store.get_msgdef(typename)
    except _UNDEFINED:
        return None
    return store
