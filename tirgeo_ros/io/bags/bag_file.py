"""Define what all files of bags share: messages, connections, and the unpacking of chunks.

A packed kilobyte can hold gigabytes, hence MOST_BYTES. Recorders close a chunk at about a
megabyte, but one message may be larger: a 4K picture of 16 bits and three colours has 50 MB.
"""

from __future__ import annotations

import bz2
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import zstandard
from lz4.frame import LZ4FrameDecompressor

from tirgeo_ros.core.types.errors import BagError

#: A message in a file: log time (ns), place (chunk, number in the chunk), connection, data.
Row = tuple[int, int, int, int, bytes]
#: The loss of messages whose log time does not fit a stamp; their number stands before it.
TOO_LATE = "messages with a log time after 2038 left out"
#: First bytes of a compressed file, and of a message that rosbag2 compressed; never of CDR.
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
#: The largest unpacked size of a packed chunk.
MOST_BYTES = 64 << 20
_BROKEN = (zstandard.ZstdError, RuntimeError, OSError, EOFError, ValueError, MemoryError)


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


class Connection(NamedTuple):
    """Hold a topic of a file and its form; a topic may have several connections."""

    topic: str
    form: TopicForm


class BagFile(ABC):
    """Read one file of a bag; read a cut or damaged one as far as possible.

    ``connections`` are those with messages, by their numbers; ``span_ns`` is the first and the
    last log time, None without messages. ``read`` counts the messages of the last iteration;
    ``losses`` says what could not be read, by its place in the file.
    """

    connections: Mapping[int, Connection]
    span_ns: tuple[int, int] | None
    #: The place of a row in the words of a message to people; ``{}`` is its number.
    where = ""

    def __init__(self, path: Path, name: Path) -> None:
        """Take the file to read (an unpacked copy, perhaps), and the name to show to people."""
        self.name, self.path, self.read = name, path, 0
        self.losses: dict[int, str] = {}

    @abstractmethod
    def fault(self, form: TopicForm) -> str:
        """Return how a topic is encoded and what to do, if it cannot be decoded; else ""."""

    @abstractmethod
    def rows(self, keys: Collection[int], start_ns: int) -> Iterator[Row]:
        """Yield the messages of these connections from ``start_ns`` on, in order of log time."""

    def forms(self) -> dict[str, TopicForm]:
        """Return every topic that has messages, with the form of its first connection."""
        forms: dict[str, TopicForm] = {}
        for topic, form in self.connections.values():
            forms.setdefault(topic, form)
        return forms

    def messages(
        self, topics: Collection[str] | None, start_ns: int, *, any_form: bool = False
    ) -> Iterator[BagMessage]:
        """Return the messages of topics (None: all) by log time. Raises BagError for a fault."""
        chosen: dict[int, tuple[str, str]] = {}
        for key, (topic, form) in self.connections.items():
            if topics is None or topic in topics:
                fault = "" if any_form else self.fault(form)
                if fault:
                    raise BagError(f"{self.name}: topic {topic} is encoded as {fault}")
                chosen[key] = topic, form.typename
        return self._messages(chosen, start_ns)

    def _messages(
        self, chosen: Mapping[int, tuple[str, str]], start_ns: int
    ) -> Iterator[BagMessage]:
        self.read = 0
        for log_ns, place, _, key, data in self.rows(chosen.keys(), start_ns):
            try:
                message = BagMessage(*chosen[key], log_ns, plain(data))
            except ValueError as error:
                self.losses[place] = f"a message{self.where.format(place)} {error}"
                continue
            self.read += 1
            yield message


def plain(data: bytes) -> bytes:
    """Return a message's CDR, unpacked if compressed. Raises ValueError as ``unpacked`` does."""
    if data[:4] != ZSTD_MAGIC:
        return data
    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError:
        raise ValueError("is cut off or damaged") from None
    return unpacked(data, "zstd", size if size >= 0 else None)


def unpacked(
    packed: bytes, compression: str, size: int | None = None, *, cut: bool = False
) -> bytes:
    """Return the unpacked data of a chunk; of one that is ``cut``, its beginning.

    ``compression`` is ``zstd``, ``lz4``, ``bz2``, ``none`` or empty; ``size`` is the unpacked size
    that the chunk declares, or None. Raises ValueError with words that continue a sentence about
    the chunk: ``is cut off or damaged``.
    """
    if compression in {"", "none"}:
        return packed
    if compression not in _UNPACK:
        raise ValueError(f"is compressed as {compression!r}, which is not supported")
    most = min(MOST_BYTES, MOST_BYTES if size is None else size)
    try:
        data = _UNPACK[compression](packed, most + 1)
    except _BROKEN:
        raise ValueError("is cut off or damaged") from None
    if len(data) > MOST_BYTES:
        raise ValueError(f"holds more than {MOST_BYTES >> 20} MiB: not read")
    if size is not None and len(data) != size and not cut:
        raise ValueError("is cut off or damaged")
    return data


def _by_zstd(packed: bytes, most: int) -> bytes:
    """Return at most ``most`` bytes; at once, in a third of the time, if the frame fits."""
    unpacker = zstandard.ZstdDecompressor()
    if zstandard.frame_content_size(packed) in range(most):
        with suppress(zstandard.ZstdError):  # a cut frame: the stream reads its beginning
            return unpacker.decompress(packed)
    return unpacker.stream_reader(packed).read(most)


_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {
    "zstd": _by_zstd,
    "lz4": lambda packed, most: bytes(LZ4FrameDecompressor().decompress(packed, most)),
    "bz2": lambda packed, most: bz2.BZ2Decompressor().decompress(packed, most),
}
