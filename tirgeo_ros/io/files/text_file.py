"""Read text files up to the size that a person's file has; split lists of files."""

from __future__ import annotations

import io
import os
from pathlib import Path

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.files.whole_files import PathLike

#: Limit for a table or a small document: some hundred thousand lines.
_MOST_BYTES = 16 << 20


def read_text(
    path: PathLike,
    error: type[TirgeoError],
    most_bytes: int = _MOST_BYTES,
    *,
    damaged: str = "strict",
) -> str:
    """Return the text of a file in UTF-8; ``damaged`` as ``errors`` of ``open``.

    Raises ``error``, naming the file, if it cannot be read, is larger than ``most_bytes`` or is no
    such text.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(most_bytes + 1)
        if len(content) <= most_bytes:
            return io.TextIOWrapper(io.BytesIO(content), "utf-8-sig", damaged).read()
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be read: {fault.strerror or fault}") from None
    except UnicodeDecodeError:
        raise error(f"{os.fspath(path)}: not a text file in UTF-8") from None
    raise error(f"{os.fspath(path)}: larger than {most_bytes / 2**20:g} MB; is it the right file?")


def named_files(text: str) -> list[str]:
    """Return the files of a comma-separated list.

    A text with a comma that is an existing file's name is one file.
    """
    if Path(text).is_file():
        return [text]
    return [name.strip() for name in text.split(",") if name.strip()]
