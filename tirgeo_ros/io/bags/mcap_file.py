"""Read the messages of one MCAP file in order of time."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator
from mmap import mmap
from pathlib import Path

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.mcap_contents import (
    MAGIC,
    Segment,
    contents_of,
    header_of,
    mapped,
    read_segment,
)
from tirgeo_ros.io.bags.storage import BagMessage, TopicForm, plain

_PROFILES = ("ros2", "")  # "" where a tool that copied a bag left it out
#: The last two where a recorder did not find a definition: the contract's types are known here.
_SCHEMAS = ("ros2msg", "unknown", "")
#: The most bytes of messages that may wait. Parts of a recording overlap by a second or so.
_MOST_WAITING = 384 << 20
_BESIDE_BYTES = 600  # memory of a message in addition to its data

#: A message preceded by its sort keys: time, then its place in the file.
_Placed = tuple[int, int, int, BagMessage]


class McapFile:
    """Read a file; a cut or damaged one as far as possible.

    Raises BagError if it is absent, not MCAP or of another profile. Memory is constant in whole
    files: one chunk and those that overlap it in time are held.
    """

    def __init__(self, path: Path, name: Path) -> None:
        self.name, self.read = name, 0
        self._path = path
        with mapped(path, name) as data:
            self._check_header(data)
            self._contents = contents_of(data)
        self.losses = self._contents.losses
        spans = [(one.start_ns, one.end_ns) for one in self._contents.segments]
        self.span_ns = (min(a for a, _ in spans), max(b for _, b in spans)) if spans else None

    def topics(self) -> dict[str, str]:
        """Return every topic of which the file has messages, with the name of its type.

        A topic that was advertised to a recorder and had no message is left out.
        """
        found: dict[str, str] = {}
        for key, channel in self._contents.channels.items():
            if key in self._contents.empty:
                continue
            schema = self._contents.schemas.get(channel.schema_id)
            found.setdefault(channel.topic, schema.name if schema else "")
        return found

    def forms(self) -> dict[str, TopicForm]:
        """Return how each of these topics was recorded: its first channel."""
        found: dict[str, TopicForm] = {}
        for key, channel in self._contents.channels.items():
            schema = self._contents.schemas.get(channel.schema_id)
            of_type = (schema.name, schema.data, schema.encoding) if schema else ("", b"", "")
            if key not in self._contents.empty:
                form = TopicForm(*of_type, channel.message_encoding, channel.metadata)
                found.setdefault(channel.topic, form)
        return found

    def messages(
        self, topics: Collection[str] | None, start_ns: int, *, any_form: bool = False
    ) -> Iterator[BagMessage]:
        """Return the messages of these topics (None: all) in order of log time, from one on.

        Raises BagError if one of these topics is not CDR with a ``ros2msg`` schema, unless they
        may have ``any_form``.
        """
        return self._ordered(self._types(topics, any_form=any_form), start_ns)

    def _ordered(self, types: dict[int, tuple[str, str]], start_ns: int) -> Iterator[BagMessage]:
        self.read = 0
        with mapped(self._path, self.name) as data:
            parts = (
                (segment.start_ns, self._loaded(data, segment, types, start_ns))
                for segment in self._chosen(types, start_ns)
            )
            yield from _in_time_order(parts, self.name)

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
                try:
                    message = BagMessage(*types[channel], log, plain(body))
                except ValueError as error:
                    at = segment.offset
                    self.losses[at] = f"a message in the chunk at byte {at} {error}"
                    continue
                self.read += 1
                yield log, segment.offset, number, message

    def _types(
        self, topics: Collection[str] | None, *, any_form: bool
    ) -> dict[int, tuple[str, str]]:
        """Return channel to topic and type, for the wanted topics."""
        found = {}
        for number, channel in self._contents.channels.items():
            if topics is not None and channel.topic not in topics:
                continue
            schema = self._contents.schemas.get(channel.schema_id)
            if any_form:
                found[number] = (channel.topic, schema.name if schema else "")
                continue
            if (
                schema is None
                or channel.message_encoding != "cdr"
                or (schema.encoding not in _SCHEMAS)
            ):
                encoding = schema.encoding if schema else "nothing"
                raise BagError(
                    f"{self.name}: topic {channel.topic} is encoded as "
                    f"{channel.message_encoding or 'nothing'} with a schema in {encoding}; record "
                    "it with ROS 2 (cdr, ros2msg)"
                )
            found[number] = (channel.topic, schema.name)
        return found

    def _check_header(self, data: mmap) -> None:
        if data[: len(MAGIC)] != MAGIC:
            raise BagError(
                f"{self.name}: not a ROS 2 bag; give an MCAP file, a .db3 file or a bag's folder"
            )
        header = header_of(data)
        if header is not None and header.profile not in _PROFILES:
            raise BagError(
                f"{self.name}: profile {header.profile!r} is not 'ros2'; convert it to a ROS 2 bag"
            )


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
