"""Open one file of a bag by what it begins with; unpack a compressed one to a temporary file."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, TypeAlias

import zstandard

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.mcap_file import McapFile
from tirgeo_ros.io.bags.sqlite_file import MAGIC as SQLITE
from tirgeo_ros.io.bags.sqlite_file import SqliteFile
from tirgeo_ros.io.bags.storage import ZSTD_MAGIC

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
