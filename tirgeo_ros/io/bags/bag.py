"""Read and write bags: MCAP files of profile ``ros2``, ``ros2msg`` schemas, CDR messages."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from mmap import mmap
from pathlib import Path
from typing import IO, Any, NamedTuple, final

from mcap.writer import CompressionType, Writer

from tirgeo_ros import __version__
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.bags.mcap_contents import (
    MAGIC,
    Segment,
    contents_of,
    header_of,
    mapped,
    read_segment,
)
from tirgeo_ros.io.files.whole_files import PathLike, check_place, part_of

__all__ = ["BagMessage", "BagReader", "BagWriter", "Cdr"]

_PROFILES = ("ros2", "")  # "" where a tool that copied a bag left it out
_ENCODING = ("cdr", "ros2msg")
#: The most bytes of messages that may wait. Parts of a recording overlap by a second or so.
_MOST_WAITING = 384 << 20
_BESIDE_BYTES = 600  # memory of a message in addition to its data


class BagMessage(NamedTuple):
    """Hold a message as it is in a bag."""

    topic: str
    typename: str
    log_time_ns: int
    data: bytes  # CDR


#: A message preceded by its sort keys: time, then its place in the file.
_Placed = tuple[int, int, int, BagMessage]


class BagReader:
    """Read a bag; a cut or damaged one as far as possible.

    Raises BagError if the file is absent, not MCAP, of another profile, or without messages.
    ``damage`` describes after an iteration what was lost. Memory is constant in whole files: one
    chunk and those that overlap it in time are held.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        self._read = 0
        with mapped(self.path) as data:
            self._check_header(data)
            self._contents = contents_of(data)
        if not self._contents.segments:
            raise BagError(f"{self.path}: no message can be read; {self.damage or 'it has none'}")

    def topics(self) -> dict[str, str]:
        """Return every topic of which the bag has messages, with the name of its type.

        A topic that was advertised to a recorder and had no message is left out.
        """
        found: dict[str, str] = {}
        for key, channel in self._contents.channels.items():
            if key in self._contents.empty:
                continue
            schema = self._contents.schemas.get(channel.schema_id)
            found.setdefault(channel.topic, schema.name if schema else "")
        return dict(sorted(found.items()))

    @property
    def span_ns(self) -> tuple[int, int]:
        """Return the log times of the first and of the last message."""
        segments = self._contents.segments
        return min(s.start_ns for s in segments), max(s.end_ns for s in segments)

    @property
    def damage(self) -> str | None:
        """Return in one line what could not be read, None if nothing was lost.

        The line is complete after an iteration over all topics.
        """
        losses = [what for _, what in sorted(self._contents.losses.items())]
        if not losses:
            return None
        more = f" and {len(losses) - 3} more places" if len(losses) > 3 else ""
        return f"{'; '.join(losses[:3])}{more}; {self._read} messages were read"

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None
    ) -> Iterator[BagMessage]:
        """Return the messages of these topics in order of log time, from a log time on.

        Raises BagError if one of these topics is not CDR with a ``ros2msg`` schema.
        """
        types = self._checked_types(topics)
        return self._ordered(types, start_ns or 0)

    def _ordered(self, types: dict[int, tuple[str, str]], start_ns: int) -> Iterator[BagMessage]:
        self._read = 0
        with mapped(self.path) as data:
            parts = (
                (segment.start_ns, self._loaded(data, segment, types, start_ns))
                for segment in self._chosen(types, start_ns)
            )
            yield from _in_time_order(parts, self.path)

    def _chosen(self, types: dict[int, tuple[str, str]], start_ns: int) -> list[Segment]:
        wanted = types.keys()
        return sorted(
            (
                segment
                for segment in self._contents.segments
                if segment.end_ns >= start_ns
                and (segment.channels is None or not segment.channels.isdisjoint(wanted))
            ),
            key=lambda segment: (segment.start_ns, segment.offset),
        )

    def _loaded(
        self, data: mmap, segment: Segment, types: dict[int, tuple[str, str]], start_ns: int
    ) -> Iterator[_Placed]:
        raw = read_segment(data, segment.offset, segment.length, self._contents)
        for number, (channel, log, body) in enumerate(raw):
            if channel in types and log >= start_ns:
                self._read += 1
                message = BagMessage(*types[channel], log, body)
                yield log, segment.offset, number, message

    def _checked_types(self, topics: Collection[str] | None) -> dict[int, tuple[str, str]]:
        """Return channel to topic and type, for the wanted topics."""
        found = {}
        for number, channel in self._contents.channels.items():
            if topics is not None and channel.topic not in topics:
                continue
            schema = self._contents.schemas.get(channel.schema_id)
            encoding = (channel.message_encoding, schema.encoding if schema else "")
            if schema is None or encoding != _ENCODING:
                raise BagError(
                    f"{self.path}: topic {channel.topic} is encoded as {encoding[0] or 'nothing'} "
                    f"with a schema in {encoding[1] or 'nothing'}; record it with ROS 2 "
                    "(cdr, ros2msg)"
                )
            found[number] = (channel.topic, schema.name)
        return found

    def _check_header(self, data: mmap) -> None:
        if data[: len(MAGIC)] != MAGIC:
            raise BagError(f"{self.path}: not an MCAP file; give a bag in MCAP format")
        header = header_of(data)
        if header is not None and header.profile not in _PROFILES:
            raise BagError(
                f"{self.path}: profile {header.profile!r} is not 'ros2'; convert it to a ROS 2 bag"
            )


@final
class BagWriter:
    """Write a bag; a context manager.

    The file appears under its name when the context ends without an error; on an error nothing is
    left behind. The same calls give the same bytes. Raises BagError if it cannot be written.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        self._cdr = Cdr()
        self._channels: dict[str, tuple[int, str]] = {}
        self._schemas: dict[str, int] = {}
        self._part = part_of(self.path)
        self._file: IO[bytes]
        self._writer: Writer

    def __enter__(self) -> BagWriter:
        """Open a temporary file beside the future bag."""
        check_place(self.path, BagError)
        with self._errors():
            self._file = self._part.open("wb")
            self._writer = Writer(self._file, compression=CompressionType.ZSTD)
            self._writer.start("ros2", f"tirgeo {__version__}")
        return self

    def write(self, topic: str, typename: str, message: Any, log_time_ns: int) -> None:
        """Append a message, an object or its CDR bytes, to a topic (``/imu/data``)."""
        number, first = self._channels.get(topic) or self._channel(topic, typename)
        if first != typename:
            raise BagError(f"{self.path}: topic {topic} is {first} and cannot be {typename} too")
        ready = isinstance(message, bytes)
        data = message if ready else self._cdr.serialize(message, typename)
        try:
            self._writer.add_message(number, log_time_ns, data, log_time_ns)
        except OSError as error:
            raise self._error(error) from None

    def _channel(self, topic: str, typename: str) -> tuple[int, str]:
        schema = self._schema(typename)
        number = self._writer.register_channel(topic, _ENCODING[0], schema)
        self._channels[topic] = (number, typename)
        return number, typename

    def _schema(self, typename: str) -> int:
        if typename not in self._schemas:
            text = self._cdr.definition(typename).encode()
            self._schemas[typename] = self._writer.register_schema(typename, _ENCODING[1], text)
        return self._schemas[typename]

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the file and rename it, or remove it after an error."""
        try:
            with self._errors(), self._file:
                if kind is None:
                    self._writer.finish()  # type: ignore[no-untyped-call]
            if kind is None:
                with self._errors():
                    self._part.replace(self.path)
        finally:
            self._part.unlink(missing_ok=True)

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._error(error) from None

    def _error(self, error: OSError) -> BagError:
        return BagError(f"{self.path}: cannot be written: {error.strerror or error}")


def _in_time_order(
    parts: Iterable[tuple[int, Iterable[_Placed]]], name: object
) -> Iterator[BagMessage]:
    """Yield the messages of parts, which come in the order of their first times (ns).

    Raises BagError, naming ``name``, if too many overlap.
    """
    waiting: list[_Placed] = []
    for start_ns, loaded in parts:
        ready = bisect_left(waiting, (start_ns,))
        yield from (message for *_, message in waiting[:ready])
        del waiting[:ready]
        room = _MOST_WAITING - sum(_size(message) for *_, message in waiting)
        for placed in loaded:
            room -= _size(placed[3])
            if room < 0:
                raise BagError(
                    f"{name}: more than {_MOST_WAITING >> 20} MiB of messages overlap in time; "
                    "rewrite it in order of time, in chunks of a megabyte (mcap sort)"
                )
            waiting.append(placed)
        waiting.sort()
    yield from (message for *_, message in waiting)


def _size(message: BagMessage) -> int:
    return len(message.data) + _BESIDE_BYTES
