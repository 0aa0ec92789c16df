"""Read the topics of a bag of either ROS in one way."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TypeAlias

from tirgeo_ros.io.bags.bag import BagMessage, BagReader, Cdr
from tirgeo_ros.io.bags.ros1_bag import MAGIC, Ros1Bag


class _Ros2(BagReader):
    """Read a bag of ROS 2."""

    def cdr(self, message: BagMessage) -> bytes:
        """Return a message's CDR, which it is."""
        return message.data


class _Ros1:
    """Read a bag of ROS 1."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._bag = Ros1Bag(path)
        self._cdr = Cdr()
        self.span_ns = self._bag.span_ns

    @property
    def damage(self) -> str | None:
        """Return what could not be read, complete after an iteration over all topics."""
        return self._bag.damage

    def topics(self) -> dict[str, str]:
        """Return every topic with the name of its type, or of all its types."""
        return {topic: ", ".join(types) for topic, types in self._bag.topics().items()}

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Return messages in the order of their record; the data are of ROS 1."""
        for one in self._bag.messages(topics):
            yield BagMessage(one.topic, one.typename, one.record_ns, one.data)

    def cdr(self, message: BagMessage) -> bytes:
        """Return a message's CDR. Raise MessageError if it is no such message."""
        return self._cdr.from_ros1(message.data, message.typename, message.topic)


#: The bag of either ROS; messages are of ROS 2 in whatever ROS they were recorded.
AnyBag: TypeAlias = _Ros1 | _Ros2


def any_bag(path: Path) -> AnyBag:
    """Open a bag, of ROS 1 if the file begins so. Raise BagError if it cannot be read."""
    if path.is_file():
        with path.open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                return _Ros1(path)
    return _Ros2(path)
