# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Read bags as ``ros2 bag record`` leaves them: a file, or a folder of files."""

from __future__ import annotations

import heapq
import re
import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

import yaml

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.bags.bag_file import MCAP_MAGIC, ZSTD_MAGIC, BagFile, BagMessage, TopicForm
from tirgeo_ros.io.bags.bag_writer import BagWriter
from tirgeo_ros.io.bags.mcap_backend import mcap_backend
from tirgeo_ros.io.bags.sqlite_file import MAGIC as SQLITE, SqliteFile
from tirgeo_ros.io.files.whole_files import PathLike, first_bytes, path_of, read_text, reading
from tirgeo_ros.io.messages.cdr import Cdr

__all__ = ["BagMessage", "BagReader", "BagWriter", "Cdr", "TopicForm"]

#: First bytes of the files of a ROS 2 bag.
ROS2_MAGICS = (MCAP_MAGIC, SQLITE, ZSTD_MAGIC)
METADATA = "metadata.yaml"
#: Name of the record that an import writes: names of stills, and their stamps as texts.
STILLS = "tirgeo/stills"
_SUFFIXES, _ZSTD = (".mcap", ".db3"), ".zstd"
_MOST_METADATA_BYTES = 4 << 20  # the recorder writes some hundred bytes a topic and a file
#: Files that SQLite writes beside a database, and merges into it after a power cut.
_BESIDE = ("-wal", "-journal")


class BagReader:
    """Read a bag; read a cut or damaged one as far as possible.

    A bag is a file (MCAP or SQLite, plain or compressed by zstd) or a folder of such files, with
    or without a ``metadata.yaml``. Raises BagError if it is absent, not a ROS 2 bag, or without
    messages. After an iteration ``damage`` describes what was lost. Memory does not grow with the
    bag: of each file, only one chunk and the chunks that overlap it in time are in memory.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = path_of(path, BagError)
        with reading(self.path, BagError):
            paths, self._lost = bag_files(self.path)
            self._several = len(paths) > 1
            #: Files with messages, by the time of the first message, then in the bag's own order.
            self._files = sorted(self._opened(paths), key=lambda file: _span(file)[0])
        if not self._files:
            why = self._losses() or "the bag has none"
            raise BagError(f"{self.path}: no message can be read; {why}")

    def topics(self) -> dict[str, str]:
        """Return every topic that has messages, with the name of its type."""
        return {topic: form.typename for topic, form in sorted(self.forms().items())}

    def forms(self) -> dict[str, TopicForm]:
        """Return the form of each topic as recorded, for a BagWriter that copies the bag."""
        forms: dict[str, TopicForm] = {}
        for file in reversed(self._files):
            forms |= file.forms()
        return forms

    def stills(self) -> dict[str, int]:
        """Return the stamps (ns) of the pictures that were stills, by the names of their files."""
        texts = {k: v for file in self._files for k, v in file.metadata(STILLS).items()}
        return {name: int(text) for name, text in texts.items() if text.isdecimal()}

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
        """Return the messages of topics (None: all) by log time. Raises BagError if not CDR."""
        streams = [
            (_span(file)[0], file.messages(topics, start_ns or 0, any_form=any_form))
            for file in self._files
        ]
        return _merged(streams) if len(streams) > 1 else streams[0][1]

    def cdr(self, message: Any) -> bytes:
        """Return a message as CDR, which it is already; ``Ros1Bag.cdr`` has to convert."""
        return bytes(message.data)

    def _opened(self, paths: Collection[Path]) -> Iterator[BagFile]:
        """Yield the files with messages. An unreadable one of several is noted as a loss."""
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
                self._lost += self._losses_of(file)

    def _losses(self) -> str:
        losses = [*self._lost, *(loss for file in self._files for loss in self._losses_of(file))]
        more = f" and {len(losses) - 3} more places" if len(losses) > 3 else ""
        return f"{'; '.join(losses[:3])}{more}"

    def _losses_of(self, file: BagFile) -> list[str]:
        before = f"{file.name.name}: " if self._several else ""
        return [f"{before}{what}" for _, what in sorted(file.losses.items())]


def _span(file: BagFile) -> tuple[int, int]:
    assert file.span_ns is not None  # files without messages are left out
    return file.span_ns


def _merged(streams: Iterable[tuple[int, Iterator[BagMessage]]]) -> Iterator[BagMessage]:
    """Merge streams of messages, each sorted by time, into one sorted by time.

    Each stream comes with the time of its first message (ns), and is not started before that.
    Messages with equal times come in the order of the streams.
    """

    def placed(
        place: int, start_ns: int, stream: Iterator[BagMessage]
    ) -> Iterator[tuple[int, int, BagMessage | None]]:
        yield start_ns, place, None  # the stream is started only after this marker
        for message in stream:
            yield message.log_time_ns, place, message

    every = [placed(place, *stream) for place, stream in enumerate(streams)]
    for _, _, message in heapq.merge(*every, key=lambda item: item[:2]):
        if message is not None:
            yield message


def opened_file(path: Path) -> BagFile:
    """Return the reader of a file: MCAP or SQLite, plain or compressed by zstd.

    A compressed file is unpacked into a temporary folder. A database that was not closed is copied
    there, and SQLite repairs the copy. The folder is removed with the reader. Raises BagError if
    the file is neither, cannot be read, or is too large when unpacked.
    """
    with reading(path, BagError):
        if path.exists() and not path.is_file():  # opening a pipe would block without end
            raise BagError(f"{path}: not a file: a pipe or a device cannot be read as a bag")
    packed = first_bytes(path, len(ZSTD_MAGIC), BagError) == ZSTD_MAGIC
    beside = [path.with_name(path.name + end) for end in _BESIDE]
    unclosed = [file for file in beside if file.is_file() and file.stat().st_size]
    if not packed and not (unclosed and _kind(path) is SqliteFile):
        return _kind(path)(path, path)
    folder = Path(tempfile.mkdtemp(prefix="tirgeo-bag-"))
    copy = folder / path.name.removesuffix(_ZSTD)
    try:
        if packed:
            needed("zstandard", f"reading {path}", BagError)
            from tirgeo_ros.io.bags.packed import unpack_file  # noqa: PLC0415  few bags need it

            unpack_file(path, copy)
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


def _kind(path: Path) -> type[BagFile]:
    is_sqlite = first_bytes(path, len(SQLITE), BagError) == SQLITE
    return SqliteFile if is_sqlite else mcap_backend(path)[0]


def bag_files(path: Path) -> tuple[list[Path], list[str]]:
    """Return a bag's files in order, and a line for each absent file that its metadata names.

    ``path`` is a file, a folder, or the ``metadata.yaml`` in it. Only the files' names are taken
    from the metadata: its times and counts are not always right. Without metadata (the recorder
    was killed), or if no named file exists, all bag files of the folder are taken. Raises BagError
    for a folder without a bag or with several, and for an unknown storage or compression.
    """
    folder = path.parent if path.name == METADATA else path
    if not folder.is_dir():
        return [path], []
    metadata = folder / METADATA
    if not metadata.is_file():
        return _in_folder(folder), []
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the one in C is ten times as fast
    try:
        text = read_text(metadata, BagError, _MOST_METADATA_BYTES)
        recorded: dict[str, Any] = yaml.load(text, loader)["rosbag2_bagfile_information"]  # noqa: S506  safe
        # Before version 4 the folder's name stands before each file's name.
        names = [Path(name).name for name in recorded["relative_file_paths"]]
    except (BagError, yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError):
        return _in_folder(folder), [f"{METADATA} is damaged"]
    packed = str(recorded.get("compression_mode") or "none").lower() != "none"
    form = recorded.get("compression_format") or "zstd"
    for what, value, supported in (
        ("storage", recorded.get("storage_identifier"), ("mcap", "sqlite3")),
        ("compression", form if packed else "zstd", ("zstd",)),
    ):
        if value not in supported:
            raise BagError(
                f"{metadata}: {what} {value!r} is not supported, only {', '.join(supported)}; "
                "convert the bag with ros2 bag convert"
            )
    by_name = {name: _file_of(folder, name) for name in names}
    files = [file for file in by_name.values() if file]
    lost = [f"{name}, named in {METADATA}, is absent" for name in names if not by_name[name]]
    return files or _in_folder(folder), lost


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: a file by its name, a folder by its files."""
    if path.is_dir():
        inside = list(path.iterdir())
        return path / METADATA in inside or (bool(inside) and all(map(_bag_name, inside)))
    return path.name == METADATA or _bag_name(path)


def by_numbers(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that puts ``bag_2`` before ``bag_10``."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _file_of(folder: Path, name: str) -> Path | None:
    """Return the file of this name; after a killed recorder with ``.zstd`` added or removed."""
    for spelling in (name, name + _ZSTD, name.removesuffix(_ZSTD)):
        if spelling and (folder / spelling).is_file():
            return folder / spelling
    return None


def _in_folder(folder: Path) -> list[Path]:
    """Return the files of the one bag in a folder, in the order of their numbers."""
    names = {file.name for file in folder.iterdir() if _bag_name(file)}
    # If the recorder was killed while it compressed a file, only the plain file is complete.
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
