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

#: Limit for a table or a small document: some hundred thousand lines.
_MOST_BYTES = 16 << 20
UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
#: Error handler of ``open``: each byte that is not UTF-8 is read as Windows-1252, in which Excel
#: writes degrees and squares. So a damaged byte costs no other.
WINDOWS = "tirgeo.windows-1252"


def path_of(path: PathLike, error: type[TirgeoError]) -> Path:
    """Return the path. Raises ``error`` for a value that cannot name a file."""
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        raise error(f"{type(path).__name__} cannot be the name of a file: {path!r}")
    return Path(path)


def check_outputs(
    inputs: Iterable[PathLike | None], outputs: Iterable[PathLike | None], error: type[TirgeoError]
) -> None:
    """Raise ``error`` for an output that would replace an input, another output or a device.

    Files are compared by name, with links resolved, and by inode, for hard links. Each file in an
    input folder counts as an input, and so do the program's standard streams. Paths that are None
    or empty are ignored.
    """
    taken = _streams()
    for path in [path for path in inputs if path]:
        folder = path_of(path, error)
        inside = folder.iterdir() if folder.is_dir() else ()
        for file in (path, *inside):
            taken |= dict.fromkeys(_identities(file), f"the input {os.fspath(file)}")
    for path in [path for path in outputs if path]:
        check_place(path_of(path, error), error)
        identities = _identities(path)
        for identity in identities & taken.keys():
            old = taken[identity]
            raise error(f"{os.fspath(path)}: would overwrite {old}; give the output another name")
        taken |= dict.fromkeys(identities, f"the output {os.fspath(path)}")


def check_place(path: PathLike, error: type[TirgeoError]) -> None:
    """Raise ``error`` for a folder, a device or a pipe: root could replace it by a file."""
    if Path(path).exists() and not Path(path).is_file():
        raise error(f"{os.fspath(path)}: not a file; give the output another name")


def part_of(path: PathLike) -> Path:
    """Return the temporary name beside a file under which it is written."""
    return Path(path).with_name(f".{Path(path).name}.{os.getpid()}.part")


def _identities(path: PathLike) -> set[object]:
    """Return what identifies a file: its name without links, and its inode if it exists."""
    identities: set[object] = {os.path.realpath(path)}
    with suppress(OSError, ValueError):
        status = Path(path).stat()
        identities.add((status.st_dev, status.st_ino))
    return identities


def _streams() -> dict[object, str]:
    """Return the files to which a shell redirects this program's input, output or errors."""
    streams: dict[object, str] = {}
    for number, name in enumerate(("input", "output", "error")):
        with suppress(OSError):  # closed
            status = os.fstat(number)
            if stat.S_ISREG(status.st_mode):
                streams[status.st_dev, status.st_ino] = f"standard {name}"
    return streams


def made_folder(path: PathLike, error: type[TirgeoError]) -> Path:
    """Make a folder, unless it exists, and return it. Raises ``error`` naming it."""
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
    """Write all files (text as UTF-8), or none. Raises ``error`` naming the one that failed."""
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

    A file that may be ``damaged`` is of another program, and may be UTF-16 or Windows-1252 too.
    Raises ``error``, naming the file, if it cannot be read, is larger than ``most_bytes`` or is
    not such a text.
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
    """Raise ``error``, which names the file, for an OSError in this context."""
    try:
        yield
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be read: {fault.strerror or fault}") from None


@contextmanager
def writing(path: PathLike, error: type[TirgeoError]) -> Iterator[None]:
    """Raise ``error``, which names the file, for an OSError in this context."""
    try:
        yield
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be written: {fault.strerror or fault}") from None


def first_bytes(path: PathLike, number: int, error: type[TirgeoError]) -> bytes:
    """Return a file's first bytes. Raises ``error``, naming it, if it cannot be read."""
    with reading(path, error), Path(path).open("rb") as file:
        return file.read(number)


def encoding_of(head: bytes) -> str:
    """Return UTF-16 if a text begins with its mark (as of Excel and PowerShell), else UTF-8."""
    return "utf-16" if head.startswith(UTF16) else "utf-8-sig"


def named_files(text: str) -> list[str]:
    """Return the files of a list with commas; the name of an existing file may have a comma."""
    if Path(text).is_file():
        return [text]
    return [name.strip() for name in text.split(",") if name.strip()]
