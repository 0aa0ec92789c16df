"""Read bags as ``ros2 bag record`` leaves them: a file, or a folder of files."""

from __future__ import annotations

import heapq
import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, TypeAlias

import zstandard

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag_files import bag_files
from tirgeo_ros.io.bags.bag_writer import BagWriter
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.bags.mcap_file import McapFile
from tirgeo_ros.io.bags.sqlite_file import MAGIC as SQLITE
from tirgeo_ros.io.bags.sqlite_file import SqliteFile
from tirgeo_ros.io.bags.storage import ZSTD_MAGIC, BagMessage, TopicForm
from tirgeo_ros.io.files.whole_files import PathLike, path_of

#: The reader of one file of a bag.
Storage: TypeAlias = McapFile | SqliteFile

#: What is left free on the disk, and what a file may unpack to: recordings shrink to a third,
#: pictures without noise to a hundredth.
_RESERVE, _MOST_TIMES, _ANYWAY = 256 << 20, 1000, 64 << 20
_PIECE = 1 << 20
#: What SQLite writes beside a database, and takes back into it after a power cut.
_BESIDE = ("-wal", "-journal")


def opened_file(path: Path) -> Storage:
    """Return the reader of a file: MCAP or SQLite, plain or compressed by zstd.

    A compressed file is unpacked to the folder for temporary files, and so is a copy made of a
    database that was not closed, for SQLite to mend; both are removed with the reader. Raises
    BagError if it is neither, cannot be read, or is larger unpacked than the disk or a bound.
    """
    packed = _begins(path, ZSTD_MAGIC)
    beside = [path.with_name(path.name + end) for end in _BESIDE]
    unclosed = [one for one in beside if one.is_file() and one.stat().st_size]
    if not packed and not (unclosed and _begins(path, SQLITE)):
        return _reader(path, path)
    folder = Path(tempfile.mkdtemp(prefix="tirgeo-bag-"))
    try:
        storage = _reader(_copied(path, unclosed, folder, packed=packed), path)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(storage, shutil.rmtree, folder, ignore_errors=True)
    return storage


def _reader(path: Path, name: Path) -> Storage:
    return SqliteFile(path, name) if _begins(path, SQLITE) else McapFile(path, name)


def _begins(path: Path, magic: bytes) -> bool:
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for without end
            raise BagError(f"{path}: is no file: a pipe or a device cannot be read as a bag")
        with path.open("rb") as file:
            return file.read(len(magic)) == magic
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {error.strerror or error}") from None


def _copied(path: Path, beside: list[Path], folder: Path, *, packed: bool) -> Path:
    """Return the copy of a file in a folder: unpacked, or as it is with what is beside it."""
    copy = folder / path.name.removesuffix(".zstd")
    try:
        if packed:
            with path.open("rb") as file, copy.open("wb") as out:
                _unpack(path, file, out)
        else:
            for one in (path, *beside):
                shutil.copyfile(one, folder / one.name)
    except OSError as error:
        raise BagError(
            f"{path}: cannot be unpacked to {folder.parent}: {error.strerror or error}; set "
            "TMPDIR to a folder with more room"
        ) from None
    return copy


def _unpack(path: Path, file: IO[bytes], out: IO[bytes]) -> None:
    """Write what a file holds. Of a cut or damaged one, the part before: its reader finds that."""
    free = shutil.disk_usage(Path(out.name).parent).free - _RESERVE
    most = path.stat().st_size * _MOST_TIMES + _ANYWAY
    for piece in _pieces(file):
        written = out.tell() + len(piece)
        if written > most:
            raise BagError(f"{path}: unpacks to more than {_MOST_TIMES} times its size: not read")
        if written > free:
            raise OSError(f"only {max(free, 0) >> 20} MiB are free there")
        out.write(piece)
    if not out.tell():
        raise BagError(f"{path}: the compressed file is cut off or damaged: nothing can be read")


def _pieces(file: IO[bytes]) -> Iterator[bytes]:
    stream = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
    with suppress(zstandard.ZstdError):
        while piece := stream.read(_PIECE):
            yield piece


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
