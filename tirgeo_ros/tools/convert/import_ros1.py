"""Convert a ROS 1 bag of DJI's wrapper to the topics of the contract."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.dji.sources.ros1 import (
    FEEDS,
    NEEDED,
    WRAPPERS,
    Ros1Decoder,
    Ros1Setup,
    Ros1Survey,
    notes_of,
    types_of,
    used,
)
from tirgeo_ros.io.bags.bag import Cdr
from tirgeo_ros.io.bags.ros1_bag import Ros1Bag, Ros1Message
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.tools.convert.import_sink import ImportSink
from tirgeo_ros.tools.presentation.progress import Report

#: Number of messages that are inspected before the import begins.
_SURVEYED = 4000
_PICTURES = ("thermal/image_raw", "thermal/image_raw/compressed")
_PICTURE_TYPES = {TOPIC_TYPES[topic]: topic for topic in _PICTURES}
_CAMERA_INFO = "thermal/camera_info"


class Pictures(NamedTuple):
    """Hold the bag's topics (full names) that are copied unchanged; empty = none."""

    image: str = ""
    camera_info: str = ""


@dataclass
class TopicIn:
    """Count a topic's messages of one type."""

    topic: str
    typename: str
    expected: tuple[str, ...]
    feeds: tuple[str, ...]
    messages: int = 0
    refused: int = 0
    reason: str = ""  # of the first refused message

    def refuse(self, reason: str) -> None:
        """Count a message that cannot be used."""
        self.refused += 1
        self.reason = self.reason or reason

    @property
    def has_wrong_type(self) -> bool:
        """Return whether the wrapper never publishes this topic with this type."""
        return self.typename not in self.expected

    @property
    def complaint(self) -> str | None:
        """Return what is wrong with the topic, in words, or None."""
        if not self.refused:
            return None
        if self.has_wrong_type:
            wanted = " or ".join(self.expected)
            return f"{self.topic}: {self.refused} of type {self.typename}, not {wanted}"
        return f"{self.topic}: {self.refused} of {self.messages} refused ({self.reason})"


@dataclass
class Ros1Import:
    """Convert a bag's messages to readings and pass them to a sink.

    Raise BagError if the bag has no topic of the wrapper (in this namespace), several aircraft, or
    not the pictures that are asked for.
    """

    bag: Ros1Bag
    namespace: str
    pictures: Pictures
    names: dict[str, str] = field(init=False)  # topic -> its name in the wrapper
    rows: dict[tuple[str, str], TopicIn] = field(init=False, default_factory=dict)
    road: Ros1Decoder = field(init=False)

    def __post_init__(self) -> None:
        """Find the topics, and inspect the first messages."""
        self._cdr = Cdr()
        self._passed = _passed(self.bag, self.pictures)
        self.names = _wrapper_topics(self.bag, self.namespace)
        read = used(self.names.values())
        self.names = {topic: name for topic, name in self.names.items() if name in read}
        self.road = Ros1Decoder(self._surveyed())

    def run(self, sink: ImportSink, progress: Report) -> None:
        """Read the whole bag."""
        begun_ns, ended_ns = self.bag.span_ns
        total_s = (ended_ns - begun_ns) * 1e-9
        for message in self.bag.messages({*self.names, *self._passed}):
            progress((message.record_ns - begun_ns) * 1e-9, total_s)
            row = self._row(message)
            row.messages += 1
            try:
                self._take(message, sink)
            except MessageError as error:
                row.refuse(str(error).removeprefix(f"{message.topic}: "))
        for arrived in self.road.flush():
            sink.take(*arrived)

    def _take(self, message: Ros1Message, sink: ImportSink) -> None:
        """Convert a message. Raise MessageError if it cannot be used."""
        contract = self._passed.get(message.topic)
        if contract is not None:
            data = self._cdr.from_ros1(message.data, TOPIC_TYPES[contract], message.topic)
            sink.pass_on(self.road.arrival_ns(message.record_ns), contract, data)
            return
        name = self.names[message.topic]
        if message.typename not in types_of(name):
            raise MessageError("of another type")
        decoded = self.bag.decoded(message)
        for arrived in self.road.take(name, message.typename, decoded, message.record_ns):
            sink.take(*arrived)

    def _row(self, message: Ros1Message) -> TopicIn:
        key = message.topic, message.typename
        if key not in self.rows:
            name = self.names.get(message.topic, "")
            contract = self._passed.get(message.topic)
            expected = types_of(name) if contract is None else (TOPIC_TYPES[contract],)
            feeds = FEEDS[name] if contract is None else (contract,)
            self.rows[key] = TopicIn(*key, expected, feeds)
        return self.rows[key]

    def _surveyed(self) -> Ros1Setup:
        survey = Ros1Survey()
        for message in islice(self.bag.messages(set(self.names)), _SURVEYED):
            name = self.names[message.topic]
            if message.typename in types_of(name) and not survey.is_full:
                try:
                    survey.add(name, self.bag.decoded(message), message.record_ns)
                except (MessageError, AttributeError):
                    continue  # counted when it is read again
        return survey.setup

    @property
    def warnings(self) -> list[str]:
        """Return what is missing, refused or doubtful."""
        good = {self.names.get(r.topic) for r in self.rows.values() if r.messages > r.refused}
        absent = [" or ".join(names) for names in NEEDED if not good.intersection(names)]
        missing = [f"no usable messages of {', of '.join(absent)}"] if absent else []
        complaints = [row.complaint for row in self.rows.values() if row.complaint]
        return missing + complaints + self.road.warnings

    @property
    def not_read(self) -> dict[str, str]:
        """Return the bag's other topics with their types."""
        taken = {*self.names, *self._passed}
        return {
            topic: ", ".join(types)
            for topic, types in self.bag.topics().items()
            if topic not in taken
        }


def _wrapper_topics(bag: Ros1Bag, namespace: str) -> dict[str, str]:
    """Return topic -> name in the wrapper, for the one aircraft that is asked for."""
    aircraft: dict[str, dict[str, str]] = {}
    for topic, place, name in _candidates(bag):
        if not namespace or place.rpartition("/")[0] == namespace.strip("/"):
            aircraft.setdefault(place, {})[topic] = name
    if not aircraft:
        where = f" in namespace {namespace}" if namespace else ""
        raise BagError(
            f"{bag.path}: no topic of DJI's wrapper ({'/imu, '.join(WRAPPERS)}/imu ...){where}; "
            f"it has {', '.join(list(bag.topics())[:5]) or 'none'}"
        )
    if len(aircraft) > 1:
        raise BagError(
            f"{bag.path}: topics of more than one wrapper: /{', /'.join(sorted(aircraft))}; "
            "choose with --namespace"
        )
    return next(iter(aircraft.values()))


def _candidates(bag: Ros1Bag) -> Iterator[tuple[str, str, str]]:
    """Yield topic, the node's full name without its first slash, the topic's name in the node."""
    for topic in bag.topics():
        place, _, name = topic.strip("/").rpartition("/")
        if place.rpartition("/")[2] in WRAPPERS and types_of(name):
            yield topic, place, name


def _passed(bag: Ros1Bag, pictures: Pictures) -> dict[str, str]:
    """Return the bag's topic -> topic of the contract. Raise BagError if not as asked for."""
    found = {}
    if pictures.image:
        topic, typename = _checked(bag, pictures.image, tuple(_PICTURE_TYPES))
        found[topic] = _PICTURE_TYPES[typename]
    if pictures.camera_info:
        topic, _ = _checked(bag, pictures.camera_info, (TOPIC_TYPES[_CAMERA_INFO],))
        found[topic] = _CAMERA_INFO
    return found


def _checked(bag: Ros1Bag, asked: str, wanted: tuple[str, ...]) -> tuple[str, str]:
    """Return the topic that is asked for, with or without its first slash, and its type."""
    topics = bag.topics()
    topic = next((name for name in topics if name.strip("/") == asked.strip("/")), asked)
    types = topics.get(topic, ())
    if len(types) == 1 and types[0] in wanted:
        return topic, types[0]
    there = [name for name, found in topics.items() if set(found) & set(wanted)]
    raise BagError(
        f"{bag.path}: {asked} is {', '.join(types) or 'not there'}; of type "
        f"{' or '.join(wanted)} are: {', '.join(there) or 'none'}"
    )


def import_ros1(
    path: Path, sink: ImportSink, namespace: str, pictures: Pictures, progress: Report
) -> dict[str, object]:
    """Import a bag; return what to report of it."""
    bag = Ros1Bag(path)
    run = Ros1Import(bag, namespace, pictures)
    run.run(sink, progress)
    return {
        "kind": "ros1",
        "topics": [
            {
                "topic": row.topic,
                "type": row.typename,
                "expected": " or ".join(row.expected),
                "messages": row.messages,
                "refused": row.refused,
                "because": row.complaint,
                "to": list(row.feeds),
            }
            for row in sorted(run.rows.values(), key=lambda row: (row.topic, row.typename))
        ],
        "not_read": run.not_read,
        "notes": [note for name in sorted(set(run.names.values())) for note in notes_of(name)],
        "warnings": run.warnings,
        "damage": bag.damage,
    }
