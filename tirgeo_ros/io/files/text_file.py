"""Read text files from outside, up to the size that a person's file has."""

from __future__ import annotations

import io
import os
from pathlib import Path

from tirgeo_ros.core.types.errors import TirgeoError

#: Limit for a table or a small document: some hundred thousand lines.
_MOST_BYTES = 16 << 20


def read_text(
    path: str | os.PathLike[str],
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
