"""Write output files that are either complete or absent."""

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
    for path in inputs:
        for one in (path, *_inside(path_of(path, error))) if path else ():
            taken |= dict.fromkeys(_places(one), f"the input {os.fspath(one)}")
    for path in outputs:
        if not path:
            continue
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


def _inside(folder: PathLike) -> list[Path]:
    """Return what is in a folder; nothing if it is none."""
    return list(Path(folder).iterdir()) if Path(folder).is_dir() else []


def _places(path: PathLike) -> set[object]:
    """Return what identifies a file: its name without links, and its inode if it exists."""
    found: set[object] = {os.path.realpath(path)}
    with suppress(OSError, ValueError):
        status = Path(path).stat()
        found.add((status.st_dev, status.st_ino))
    return found


def _streams() -> dict[object, str]:
    """Return the files that a shell has made this program's input, output or errors."""
    found: dict[object, str] = {}
    for number, name in enumerate(("input", "output", "error")):
        with suppress(OSError):  # closed
            status = os.fstat(number)
            if stat.S_ISREG(status.st_mode):
                found[status.st_dev, status.st_ino] = f"standard {name}"
    return found


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
    """Write files (text as UTF-8); if one of them cannot be written, none is.

    Raises ``error`` naming the file.
    """
    parts = {path: part_of(path_of(path, error)) for path in contents}
    path: PathLike = ""
    try:
        for path, content in contents.items():
            check_place(path, error)
            if isinstance(content, str):  # what cannot be encoded (in a name) is escaped
                content = content.encode(errors="backslashreplace")  # noqa: PLW2901
            parts[path].write_bytes(content)
        for path, part in parts.items():
            part.replace(path)
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be written: {fault.strerror or fault}") from None
    finally:
        for part in parts.values():
            with suppress(OSError):  # absent, or with a name that is too long
                part.unlink()
