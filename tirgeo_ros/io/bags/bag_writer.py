"""Write bags: one MCAP file of profile ``ros2``, ``ros2msg`` schemas, CDR messages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import IO, Any, final

import yaml
from mcap.writer import CompressionType, Writer

from tirgeo_ros import __version__
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag_file import TopicForm
from tirgeo_ros.io.files.whole_files import PathLike, check_place, part_of, path_of, writing
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.io.messages.topics import offered_qos

#: What rosbag2 writes when it opens a file. From the version its reader knows that the topics' QoS
#: has words, not numbers; it takes counts and times from the summary at the end of the file.
_METADATA = """\
version: 9
storage_identifier: mcap
duration:
  nanoseconds: 0
starting_time:
  nanoseconds_since_epoch: 0
message_count: 0
topics_with_message_count:
  []
compression_format: ""
compression_mode: ""
relative_file_paths:
  []
files:
  []
ros_distro: ""
custom_data: ~"""

#: Bytes of messages that are lost if the process is killed: one second without pictures.
_GROWING_CHUNK = 1 << 17
_CHUNK = 1 << 20


@final
class BagWriter:
    """Write a bag; a context manager.

    The file gets its name when the context ends without an error; after an error nothing is left
    behind. A ``growing`` file has its name from the start, and can be read up to about the last
    ``flush`` even if the process is killed. The same calls give the same bytes. Each topic is
    written with the QoS of its publisher, so that ``ros2 bag play`` offers the same. Topics in
    ``forms`` keep their recorded QoS and the definition of their type, which may be unknown here.
    Raises BagError if the file cannot be written.
    """

    def __init__(
        self,
        path: PathLike,
        *,
        growing: bool = False,
        forms: Mapping[str, TopicForm] | None = None,
    ) -> None:
        self.path = path_of(path, BagError)
        self._growing = growing
        self._cdr = Cdr()
        self._channels: dict[str, tuple[int, str]] = {}
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._forms = forms or {}
        self._part = self.path if growing else part_of(self.path)
        self._file: IO[bytes]
        self._writer: Writer

    def __enter__(self) -> BagWriter:
        """Open a temporary file beside the future bag."""
        check_place(self.path, BagError)
        with writing(self.path, BagError):
            self._file = self._part.open("wb")
            chunk = _GROWING_CHUNK if self._growing else _CHUNK
            self._writer = Writer(self._file, chunk, CompressionType.ZSTD)
            self._writer.start("ros2", f"tirgeo {__version__}")
            self._writer.add_metadata("rosbag2", {"serialized_metadata": _METADATA})
        return self

    def write(self, topic: str, typename: str, message: Any, log_time_ns: int) -> None:
        """Append a message, an object or its CDR bytes, to a topic (``/imu/data``)."""
        number, first = self._channels.get(topic) or self._channel(topic, typename)
        if first != typename:
            raise BagError(
                f"{self.path}: topic {topic} has type {first}: no {typename} can be written to it"
            )
        data = message if isinstance(message, bytes) else self._cdr.serialize(message, typename)
        with writing(self.path, BagError):
            self._writer.add_message(number, log_time_ns, data, log_time_ns)

    def flush(self) -> None:
        """Pass all messages to the operating system, except those of the newest chunk."""
        with writing(self.path, BagError):
            self._file.flush()

    def _channel(self, topic: str, typename: str) -> tuple[int, str]:
        form = self._forms.get(topic) or TopicForm(typename, b"", "", "cdr", {})
        metadata = {**form.metadata, "offered_qos_profiles": qos_in_words(topic, form.metadata)}
        schema = self._schema(typename, form, copied=topic in self._forms)
        encoding = form.message_encoding
        number = self._writer.register_channel(topic, encoding, schema, metadata)
        self._channels[topic] = (number, typename)
        return number, typename

    def _schema(self, typename: str, form: TopicForm, *, copied: bool) -> int:
        """Return the number of a type's definition, recorded or known here; 0 without a type."""
        if copied and not typename:
            return 0
        key = typename, form.definition
        if key not in self._schemas:
            encoding, text = form.encoding, form.definition
            if not text and (typename in self._cdr or not copied):
                encoding, text = "ros2msg", self._cdr.definition(typename).encode()
            self._schemas[key] = self._writer.register_schema(typename, encoding, text)
        return self._schemas[key]

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the file and rename it, or remove it after an error."""
        try:
            with writing(self.path, BagError), self._file:
                if kind is None or self._growing:
                    self._writer.finish()  # type: ignore[no-untyped-call]
            if kind is None:
                with writing(self.path, BagError):
                    self._part.replace(self.path)
        finally:
            if not self._growing:
                self._part.unlink(missing_ok=True)


def qos_in_words(topic: str, metadata: Mapping[str, str]) -> str:
    """Return the QoS of a recorded topic as Jazzy writes it: ``offered_qos_profiles``.

    It is a YAML list with one entry for each publisher. In bags of Humble and before, its policies
    are numbers: then, and if it cannot be read, the QoS that tirgeo offers is returned, with the
    recorded durability.
    """
    text = metadata.get("offered_qos_profiles", "")
    durabilities = _durabilities(text)
    if durabilities and not any(isinstance(each, int) for each in durabilities):
        return text
    offered = offered_qos(topic)
    return offered._replace(latched=offered.latched or 1 in durabilities).text


def is_latched(topic: str, metadata: Mapping[str, str]) -> bool:
    """Return whether late subscribers of a recorded topic get its last message."""
    return "transient_local" in _durabilities(qos_in_words(topic, metadata))


def _durabilities(text: str) -> list[object]:
    """Return each publisher's durability, a word or a number: 1 is transient local (rmw)."""
    try:
        document = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError):
        return []
    entries = document if isinstance(document, list) else []
    return [entry.get("durability") for entry in entries if isinstance(entry, dict)]
