"""Read bags as ``ros2 bag record`` leaves them: a file, or a folder of files."""

from __future__ import annotations

import heapq
import re
import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml
import zstandard

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag_file import ZSTD_MAGIC, BagFile, BagMessage, TopicForm
from tirgeo_ros.io.bags.bag_writer import BagWriter
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.bags.mcap_file import MAGIC as MCAP
from tirgeo_ros.io.bags.mcap_file import McapFile
from tirgeo_ros.io.bags.sqlite_file import MAGIC as SQLITE
from tirgeo_ros.io.bags.sqlite_file import SqliteFile
from tirgeo_ros.io.files.whole_files import PathLike, first_bytes, path_of, read_text, reading

#: What the files of a bag of ROS 2 begin with.
ROS2_MAGICS = (MCAP, SQLITE, ZSTD_MAGIC)
#: What is left free on the disk, and what a file may unpack to: recordings shrink to a third,
#: pictures without noise to a hundredth.
_RESERVE, _MOST_TIMES, _ANYWAY = 256 << 20, 1000, 64 << 20
_PIECE, _ZSTD = 1 << 20, ".zstd"
#: What SQLite writes beside a database, and takes back into it after a power cut.
_BESIDE = ("-wal", "-journal")


def opened_file(path: Path) -> BagFile:
    """Return the reader of a file: MCAP or SQLite, plain or compressed by zstd.

    A compressed file is unpacked to the folder for temporary files, and so is a copy made of a
    database that was not closed, for SQLite to mend; both are removed with the reader. Raises
    BagError if it is neither, cannot be read, or is larger unpacked than the disk or a bound.
    """
    with reading(path, BagError):
        if path.exists() and not path.is_file():  # a pipe would be waited for without end
            raise BagError(f"{path}: is no file: a pipe or a device cannot be read as a bag")
    packed = first_bytes(path, len(ZSTD_MAGIC), BagError) == ZSTD_MAGIC
    beside = [path.with_name(path.name + end) for end in _BESIDE]
    unclosed = [file for file in beside if file.is_file() and file.stat().st_size]
    if not packed and not (unclosed and _kind(path) is SqliteFile):
        return _kind(path)(path, path)
    folder = Path(tempfile.mkdtemp(prefix="tirgeo-bag-"))
    copy = folder / path.name.removesuffix(_ZSTD)
    try:
        if packed:
            _unpack(path, copy)
        else:
            for source in (path, *unclosed):
                shutil.copyfile(source, folder / source.name)
        file = _kind(copy)(copy, path)
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise BagError(
            f"{path}: cannot be unpacked to {folder.parent}: {error.strerror or error}; set "
            "TMPDIR to a folder with more room"
        ) from None
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(file, shutil.rmtree, folder, ignore_errors=True)
    return file


def _kind(path: Path) -> type[SqliteFile | McapFile]:
    return SqliteFile if first_bytes(path, len(SQLITE), BagError) == SQLITE else McapFile


def _unpack(path: Path, copy: Path) -> None:
    """Write what a file holds. Of a cut or damaged one, the part before: its reader finds that."""
    free = shutil.disk_usage(copy.parent).free - _RESERVE
    most = path.stat().st_size * _MOST_TIMES + _ANYWAY
    with path.open("rb") as file, copy.open("wb") as out, suppress(zstandard.ZstdError):
        stream = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
        while piece := stream.read(_PIECE):
            written = out.tell() + len(piece)
            if written > most:
                times = f"{_MOST_TIMES} times its size"
                raise BagError(f"{path}: unpacks to more than {times}: not read")
            if written > free:
                raise OSError(f"only {max(free, 0) >> 20} MiB are free there")
            out.write(piece)
    if not copy.stat().st_size:
        raise BagError(f"{path}: the compressed file is cut off or damaged: nothing can be read")


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
        with reading(self.path, BagError):
            paths, self._lost = bag_files(self.path)
            self._several = len(paths) > 1
            #: Those with messages in the order of their first; at one time in that of the bag.
            self._files = sorted(self._opened(paths), key=lambda file: _span(file)[0])
        if not self._files:
            why = self._losses() or "it has none"
            raise BagError(f"{self.path}: no message can be read; {why}")

    def topics(self) -> dict[str, str]:
        """Return every topic of which the bag has messages, with the name of its type."""
        return {topic: form.typename for topic, form in sorted(self.forms().items())}

    def forms(self) -> dict[str, TopicForm]:
        """Return how each of these topics was recorded, for a BagWriter that copies it."""
        forms: dict[str, TopicForm] = {}
        for file in reversed(self._files):
            forms |= file.forms()
        return forms

    @property
    def span_ns(self) -> tuple[int, int]:
        """Return the log times of the first and of the last message."""
        spans = [_span(file) for file in self._files]
        return spans[0][0], max(last for _, last in spans)

    @property
    def damage(self) -> str | None:
        """Return in one line what was lost, else None; it is complete after an iteration."""
        losses = self._losses()
        read = sum(file.read for file in self._files)
        return f"{losses}; {read} messages were read" if losses else None

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        *,
        any_form: bool = False,
    ) -> Iterator[BagMessage]:
        """Return the messages of topics (None: all) by log time; BagError for one not in CDR."""
        streams = [
            (_span(file)[0], file.messages(topics, start_ns or 0, any_form=any_form))
            for file in self._files
        ]
        return _merged(streams) if len(streams) > 1 else streams[0][1]

    def cdr(self, message: Any) -> bytes:
        """Return a message's CDR, which it is: bags of ROS 1 have another form."""
        return bytes(message.data)

    def _opened(self, paths: Collection[Path]) -> Iterator[BagFile]:
        """Yield the files that have messages; one that cannot be read is a loss to the others."""
        for path in paths:
            try:
                file = opened_file(path)
            except BagError as error:
                if not self._several:
                    raise
                self._lost.append(str(error).removeprefix(f"{self.path}/"))
                continue
            if file.span_ns is not None:
                yield file
            else:
                self._lost += self._named(file)

    def _losses(self) -> str:
        losses = [*self._lost, *(one for file in self._files for one in self._named(file))]
        more = f" and {len(losses) - 3} more places" if len(losses) > 3 else ""
        return f"{'; '.join(losses[:3])}{more}"

    def _named(self, file: BagFile) -> list[str]:
        before = f"{file.name.name}: " if self._several else ""
        return [f"{before}{what}" for _, what in sorted(file.losses.items())]


def _span(file: BagFile) -> tuple[int, int]:
    assert file.span_ns is not None  # those without messages are left out
    return file.span_ns


def _merged(streams: Iterable[tuple[int, Iterator[BagMessage]]]) -> Iterator[BagMessage]:
    """Yield the messages of streams, each in order of time, in order of time.

    Streams come with their first times (ns); none is begun before its time. Messages of one time
    come in the order of the streams.
    """

    def placed(
        place: int, start_ns: int, stream: Iterator[BagMessage]
    ) -> Iterator[tuple[int, int, BagMessage | None]]:
        yield start_ns, place, None  # when this is passed, the stream is begun
        for message in stream:
            yield message.log_time_ns, place, message

    every = [placed(place, *stream) for place, stream in enumerate(streams)]
    for _, _, message in heapq.merge(*every, key=lambda item: item[:2]):
        if message is not None:
            yield message


METADATA = "metadata.yaml"
_SUFFIXES = (".mcap", ".db3")
_MOST_BYTES = 4 << 20  # of metadata: some hundred bytes a topic and a file


def bag_files(path: Path) -> tuple[list[Path], list[str]]:
    """Return a bag's files in order, and a line for each file that only its metadata has.

    ``path`` is a file, a folder, or the ``metadata.yaml`` in it. The metadata only names the
    files: what it says of times and counts is not always right. Without metadata (the recorder
    was killed), or where all its names are wrong, the files of the folder are taken. Raises
    BagError for a folder without a bag or with several, and for a storage or a compression that is
    not known.
    """
    folder = path.parent if path.name == METADATA else path
    if not folder.is_dir():
        return [path], []
    metadata = folder / METADATA
    if not metadata.is_file():
        return _in_folder(folder), []
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast where there is C
    try:
        tree = yaml.load(read_text(metadata, BagError, _MOST_BYTES), loader)  # noqa: S506  safe
        recorded: dict[str, Any] = tree["rosbag2_bagfile_information"]
        # Before version 4 the files' names have the folder's in front.
        names = [Path(name).name for name in recorded["relative_file_paths"]]
    except (BagError, yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError):
        return _in_folder(folder), [f"{METADATA} is damaged"]
    packed = str(recorded.get("compression_mode") or "none").lower() != "none"
    form = recorded.get("compression_format") or "zstd"
    for what, value, known in (
        ("storage", recorded.get("storage_identifier"), ("mcap", "sqlite3")),
        ("compression", form if packed else "zstd", ("zstd",)),
    ):
        if value not in known:
            raise BagError(
                f"{metadata}: {what} {value!r} is not known ({', '.join(known)}); convert the "
                "bag with ros2 bag convert"
            )
    by_name = {name: _file_of(folder, name) for name in names}
    files = [file for file in by_name.values() if file]
    lost = [f"{name}, named in {METADATA}, is absent" for name in names if not by_name[name]]
    return files or _in_folder(folder), lost


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: a file by its name, a folder by what is in it."""
    if path.is_dir():
        inside = list(path.iterdir())
        return path / METADATA in inside or (bool(inside) and all(map(_bag_name, inside)))
    return path.name == METADATA or _bag_name(path)


def by_numbers(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that puts ``bag_2`` before ``bag_10``."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _file_of(folder: Path, name: str) -> Path | None:
    """Return the file of this name; of a recorder that was killed, before or after compression."""
    for spelling in (name, name + _ZSTD, name.removesuffix(_ZSTD)):
        if spelling and (folder / spelling).is_file():
            return folder / spelling
    return None


def _in_folder(folder: Path) -> list[Path]:
    """Return the files of the one bag in a folder, in the order of their numbers."""
    names = {file.name for file in folder.iterdir() if _bag_name(file)}
    # Where a recorder was killed while it compressed a file, the plain one is the whole one.
    names -= {name + _ZSTD for name in names}
    files = sorted((folder / name for name in names), key=by_numbers)
    bags = sorted({re.sub(r"_\d+$", "", file.name.split(".")[0]) for file in files})
    if not bags:
        raise BagError(f"{folder}: no bag in this folder: no .mcap and no .db3 file")
    if len(bags) > 1:
        more = ", ..." if len(bags) > 3 else ""
        raise BagError(
            f"{folder}: {len(bags)} recordings without a {METADATA} ({', '.join(bags[:3])}{more}):"
            " give one of them"
        )
    return files


def _bag_name(path: Path) -> bool:
    name = path.name.lower().removesuffix(_ZSTD)
    return name.endswith(_SUFFIXES) and not name.startswith(".")
