"""Output files that are whole or not there."""

from __future__ import annotations

import csv
import io
import os
import stat
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from tirgeo_ros.core.types.errors import TirgeoError

PathLike = str | os.PathLike[str]


def check_outputs(
    inputs: Iterable[PathLike | None], outputs: Iterable[PathLike | None], error: type[TirgeoError]
) -> None:
    """Raise ``error`` for an output in the place of an input, of another output or of no file.

    A place is a name with its links followed, or a file: other names of one (hard links) count.
    The program's own streams count too. What is None or empty is not asked for.
    """
    taken = _streams()
    for path in inputs:
        if path:
            taken |= dict.fromkeys(_places(path), f"the input {os.fspath(path)}")
    for path in outputs:
        if not path:
            continue
        check_place(path, error)
        places = _places(path)
        for place in places & taken.keys():
            raise error(
                f"{os.fspath(path)}: would take the place of {taken[place]}; "
                "give the output another name"
            )
        taken |= dict.fromkeys(places, f"the output {os.fspath(path)}")


def check_place(path: PathLike, error: type[TirgeoError]) -> None:
    """Raise ``error`` for a folder, a device or a pipe: root would replace it by a file."""
    if Path(path).exists() and not Path(path).is_file():
        raise error(f"{os.fspath(path)}: not a file; give the output another name")


def part_of(path: PathLike) -> Path:
    """Return the temporary name beside a file under which it is written."""
    return Path(path).with_name(f".{Path(path).name}.{os.getpid()}.part")


def _places(path: PathLike) -> set[object]:
    """What tells a file: its name without links, and its number where it is there."""
    found: set[object] = {os.path.realpath(path)}
    with suppress(OSError, ValueError):
        status = Path(path).stat()
        found.add((status.st_dev, status.st_ino))
    return found


def _streams() -> dict[object, str]:
    """Files that a shell has made this program's input, output or errors of."""
    found: dict[object, str] = {}
    for number, name in enumerate(("input", "output", "error")):
        with suppress(OSError):  # closed
            status = os.fstat(number)
            if stat.S_ISREG(status.st_mode):
                found[status.st_dev, status.st_ino] = f"standard {name}"
    return found


def made_folder(path: PathLike, error: type[TirgeoError]) -> Path:
    """The folder, made where it is not there. Raises ``error`` naming it."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise error(f"{folder}: cannot be made: {fault.strerror or fault}") from None
    return folder


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Rows as CSV, the first of them the header."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def write_files(contents: Mapping[PathLike, str | bytes], error: type[TirgeoError]) -> None:
    """Write files (text as UTF-8); where one of them cannot be written, none is there.

    Raises ``error`` naming the file.
    """
    parts = {path: part_of(path) for path in contents}
    path: PathLike = ""
    try:
        for path, content in contents.items():
            check_place(path, error)
            parts[path].write_bytes(_bytes(content))
        for path, part in parts.items():
            part.replace(path)
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be written: {fault.strerror or fault}") from None
    finally:
        for part in parts.values():
            part.unlink(missing_ok=True)


def _bytes(content: str | bytes) -> bytes:
    """As UTF-8; what of a name is no UTF-8 stands escaped."""
    return content.encode(errors="backslashreplace") if isinstance(content, str) else content
