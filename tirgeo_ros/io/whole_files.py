"""Output files that are whole or not there."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from tirgeo_ros.core.errors import TirgeoError

PathLike = str | os.PathLike[str]


def check_outputs(
    inputs: Iterable[PathLike], outputs: Iterable[PathLike], error: type[TirgeoError]
) -> None:
    """Raise ``error`` for an output that would take the place of an input or another output."""
    taken = {Path(path).resolve() for path in inputs}
    for path in outputs:
        if Path(path).resolve() in taken:
            raise error(f"{os.fspath(path)}: is an input or another output too")
        taken.add(Path(path).resolve())


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
    parts = {
        path: Path(path).with_name(f".{Path(path).name}.{os.getpid()}.part") for path in contents
    }
    path: PathLike = ""
    try:
        for path, content in contents.items():
            parts[path].write_bytes(content.encode() if isinstance(content, str) else content)
        for path, part in parts.items():
            part.replace(path)
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be written: {fault.strerror or fault}") from None
    finally:
        for part in parts.values():
            part.unlink(missing_ok=True)
