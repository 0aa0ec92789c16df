"""Write output files that are either complete or absent; read texts up to a bounded size."""

from __future__ import annotations

import codecs
import csv
import io
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from tirgeo_ros.core.types.errors import TirgeoError

PathLike = str | os.PathLike[str]


def path_of(path: PathLike, error: type[TirgeoError]) -> Path:
    """Return the path. Raises ``error`` for what names no file."""
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        raise error(f"{type(path).__name__} is no name of a file: {path!r}")
    return Path(path)


def check_outputs(
    inputs: Iterable[PathLike | None], outputs: Iterable[PathLike | None], error: type[TirgeoError]
) -> None:
    """Raise ``error`` for an output in the place of an input, of another output or of no file.

    Places are compared by name with links resolved, and by file: other names of one file (hard
    links) count. So do the files in a folder that is an input, and the program's own streams.
    Paths that are None or empty are ignored.
    """
    taken = _streams()
    for path in [path for path in inputs if path]:
        folder = path_of(path, error)
        inside = folder.iterdir() if folder.is_dir() else ()
        for file in (path, *inside):
            taken |= dict.fromkeys(_places(file), f"the input {os.fspath(file)}")
    for path in [path for path in outputs if path]:
        check_place(path_of(path, error), error)
        places = _places(path)
        for place in places & taken.keys():
            raise error(
                f"{os.fspath(path)}: would overwrite {taken[place]}; give the output another name"
            )
        taken |= dict.fromkeys(places, f"the output {os.fspath(path)}")


def check_place(path: PathLike, error: type[TirgeoError]) -> None:
    """Raise ``error`` for a folder, a device or a pipe, which root would replace by a file."""
    if Path(path).exists() and not Path(path).is_file():
        raise error(f"{os.fspath(path)}: not a file; give the output another name")


def part_of(path: PathLike) -> Path:
    """Return the temporary name beside a file under which it is written."""
    return Path(path).with_name(f".{Path(path).name}.{os.getpid()}.part")


def _places(path: PathLike) -> set[object]:
    """Return what identifies a file: its name without links, and its inode if it exists."""
    places: set[object] = {os.path.realpath(path)}
    with suppress(OSError, ValueError):
        status = Path(path).stat()
        places.add((status.st_dev, status.st_ino))
    return places


def _streams() -> dict[object, str]:
    """Return the files that a shell has made this program's input, output or errors."""
    streams: dict[object, str] = {}
    for number, name in enumerate(("input", "output", "error")):
        with suppress(OSError):  # closed
            status = os.fstat(number)
            if stat.S_ISREG(status.st_mode):
                streams[status.st_dev, status.st_ino] = f"standard {name}"
    return streams


def made_folder(path: PathLike, error: type[TirgeoError]) -> Path:
    """Return the folder; make it if it is absent. Raises ``error`` naming it."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise error(f"{folder}: cannot be made: {fault.strerror or fault}") from None
    return folder


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Return rows as CSV, the first of them the header."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def write_files(contents: Mapping[PathLike, str | bytes], error: type[TirgeoError]) -> None:
    """Write files (text as UTF-8), or none if one cannot be: raises ``error`` naming it."""
    parts = {path: part_of(path_of(path, error)) for path in contents}
    path: PathLike = ""
    try:
        for path, content in contents.items():
            check_place(path, error)
            if isinstance(content, str):  # what cannot be encoded (in a name) is escaped
                content = content.encode(errors="backslashreplace")  # noqa: PLW2901  the same text
            parts[path].write_bytes(content)
        for path, part in parts.items():
            part.replace(path)
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be written: {fault.strerror or fault}") from None
    finally:
        for part in parts.values():
            with suppress(OSError):  # absent, or with a name that is too long
                part.unlink()


#: Limit for a table or a small document: some hundred thousand lines.
_MOST_BYTES = 16 << 20
UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
#: How ``open`` decodes bytes that are not UTF-8: each as Windows-1252, in which Excel writes
#: degrees and squares. A damaged byte costs no other.
WINDOWS = "tirgeo.windows-1252"


def _windows(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeDecodeError)
    return error.object[error.start : error.end].decode("cp1252", "replace"), error.end


codecs.register_error(WINDOWS, _windows)


def read_text(
    path: PathLike,
    error: type[TirgeoError],
    most_bytes: int = _MOST_BYTES,
    *,
    damaged: bool = False,
) -> str:
    """Return the text of a file in UTF-8.

    What may be ``damaged`` comes of other programs, and may be UTF-16 or Windows-1252 too.
    Raises ``error``, naming the file, if it cannot be read, is larger than ``most_bytes`` or is no
    such text.
    """
    source, content = path_of(path, error), io.BytesIO()
    with reading(path, error), source.open("rb") as file:
        while content.tell() <= most_bytes and (piece := file.read(1 << 20)):
            content.write(piece)
    if content.tell() > most_bytes:
        most_mb = most_bytes / 2**20
        raise error(f"{os.fspath(path)}: larger than {most_mb:g} MB; is it the right file?")
    encoding = encoding_of(content.getvalue()) if damaged else "utf-8-sig"
    content.seek(0)
    try:
        return io.TextIOWrapper(content, encoding, WINDOWS if damaged else "strict").read()
    except UnicodeDecodeError:
        raise error(f"{os.fspath(path)}: not a text file in UTF-8") from None


@contextmanager
def reading(path: PathLike, error: type[TirgeoError]) -> Iterator[None]:
    """Raise ``error``, which names the file, for an OSError meanwhile."""
    try:
        yield
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be read: {fault.strerror or fault}") from None


@contextmanager
def writing(path: PathLike, error: type[TirgeoError]) -> Iterator[None]:
    """Raise ``error``, which names the file, for an OSError meanwhile."""
    try:
        yield
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be written: {fault.strerror or fault}") from None


def first_bytes(path: PathLike, number: int, error: type[TirgeoError]) -> bytes:
    """Return a file's first bytes. Raises ``error``, naming it, if it cannot be read."""
    with reading(path, error), Path(path).open("rb") as file:
        return file.read(number)


def encoding_of(head: bytes) -> str:
    """Return UTF-16, which has a mark as Excel and PowerShell write it, or UTF-8."""
    return "utf-16" if head.startswith(UTF16) else "utf-8-sig"


def named_files(text: str) -> list[str]:
    """Return the files of a list with commas; an existing file's name may have one."""
    if Path(text).is_file():
        return [text]
    return [name.strip() for name in text.split(",") if name.strip()]
