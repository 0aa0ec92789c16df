"""Read bags as ``ros2 bag record`` leaves them: a file, or a folder of files."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag_files import bag_files
from tirgeo_ros.io.bags.bag_writer import BagWriter
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.bags.opened_file import Storage, opened_file
from tirgeo_ros.io.bags.storage import BagMessage, TopicForm
from tirgeo_ros.io.files.whole_files import PathLike, path_of

__all__ = ["BagMessage", "BagReader", "BagWriter", "Cdr", "TopicForm"]


class BagReader:
    """Read a bag; a cut or damaged one as far as possible.

    It is a file (MCAP, SQLite, either of them compressed by zstd) or a folder of such files, with
    a ``metadata.yaml`` or without. Raises BagError if it is absent, no ROS 2 bag, or without
    messages. ``damage`` describes after an iteration what was lost. Memory is constant: of each
    file that overlaps others in time, one chunk and those that overlap it are held.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = path_of(path, BagError)
        try:
            files, self._lost = bag_files(self.path)
            self._several = len(files) > 1
            #: Those with messages in the order of their first; at one time in that of the bag.
            self._storages = sorted(self._opened(files), key=lambda found: _span(found)[0])
        except OSError as error:
            raise BagError(f"{self.path}: cannot be read: {error.strerror or error}") from None
        if not self._storages:
            why = self._losses() or "it has none"
            raise BagError(f"{self.path}: no message can be read; {why}")

    def topics(self) -> dict[str, str]:
        """Return every topic of which the bag has messages, with the name of its type."""
        found: dict[str, str] = {}
        for storage in reversed(self._storages):
            found |= storage.topics()
        return dict(sorted(found.items()))

    def forms(self) -> dict[str, TopicForm]:
        """Return how each of these topics was recorded, for a BagWriter that copies it."""
        found: dict[str, TopicForm] = {}
        for storage in reversed(self._storages):
            found |= storage.forms()
        return found

    @property
    def span_ns(self) -> tuple[int, int]:
        """Return the log times of the first and of the last message."""
        spans = [_span(storage) for storage in self._storages]
        return spans[0][0], max(last for _, last in spans)

    @property
    def damage(self) -> str | None:
        """Return in one line what could not be read, None if nothing was lost.

        The line is complete after an iteration over all topics.
        """
        losses = self._losses()
        read = sum(storage.read for storage in self._storages)
        return f"{losses}; {read} messages were read" if losses else None

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        *,
        any_form: bool = False,
    ) -> Iterator[BagMessage]:
        """Return the messages of these topics in order of log time, from a log time on.

        Raises BagError if one of these topics is not in CDR, unless they may have ``any_form``.
        """
        streams = [
            (_span(storage)[0], storage.messages(topics, start_ns or 0, any_form=any_form))
            for storage in self._storages
        ]
        return _merged(streams) if len(streams) > 1 else streams[0][1]

    def _opened(self, files: Collection[Path]) -> Iterator[Storage]:
        """Yield the files that have messages; one that cannot be read is a loss to the others."""
        for path in files:
            try:
                storage = opened_file(path)
            except BagError as error:
                if not self._several:
                    raise
                self._lost.append(str(error).removeprefix(f"{self.path}/"))
                continue
            if storage.span_ns is not None:
                yield storage
            else:
                self._lost += self._named(storage)

    def _losses(self) -> str:
        losses = [*self._lost, *(one for found in self._storages for one in self._named(found))]
        more = f" and {len(losses) - 3} more places" if len(losses) > 3 else ""
        return f"{'; '.join(losses[:3])}{more}"

    def _named(self, storage: Storage) -> list[str]:
        before = f"{storage.name.name}: " if self._several else ""
        return [f"{before}{what}" for _, what in sorted(storage.losses.items())]


def _span(storage: Storage) -> tuple[int, int]:
    assert storage.span_ns is not None  # those without messages are left out
    return storage.span_ns


def _merged(streams: Iterable[tuple[int, Iterator[BagMessage]]]) -> Iterator[BagMessage]:
    """Yield the messages of streams, each in order of time, in order of time.

    Streams come with their first times (ns) and in the order of these; none is begun before its
    time. Messages of one time come in the order of the streams.
    """
    begun: list[tuple[int, int, BagMessage, Iterator[BagMessage]]] = []

    def advance(place: int, stream: Iterator[BagMessage]) -> None:
        message = next(stream, None)
        if message is not None:
            heapq.heappush(begun, (message.log_time_ns, place, message, stream))

    def until(end_ns: int | None) -> Iterator[BagMessage]:
        while begun and (end_ns is None or begun[0][0] < end_ns):
            _, place, message, stream = heapq.heappop(begun)
            yield message
            advance(place, stream)

    for place, (start_ns, stream) in enumerate(streams):
        yield from until(start_ns)
        advance(place, stream)
    yield from until(None)
