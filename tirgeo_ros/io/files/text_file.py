"""Read text files up to the size that a person's file has; split lists of files."""

from __future__ import annotations

import codecs
import io
import os
from pathlib import Path

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.files.whole_files import PathLike, path_of

#: Limit for a table or a small document: some hundred thousand lines.
_MOST_BYTES = 16 << 20
#: The first bytes tell the encoding: titles and units stand there.
_HEAD_BYTES = 4096
UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read_text(
    path: PathLike,
    error: type[TirgeoError],
    most_bytes: int = _MOST_BYTES,
    *,
    damaged: str = "strict",
) -> str:
    """Return the text of a file in UTF-8; ``damaged`` as ``errors`` of ``open``.

    What may be damaged comes of other programs, and may be in ``encoding_of`` too.
    Raises ``error``, naming the file, if it cannot be read, is larger than ``most_bytes`` or is no
    such text.
    """
    source = path_of(path, error)
    try:
        with source.open("rb") as file:
            content = file.read(most_bytes + 1)
        if len(content) <= most_bytes:
            encoding = "utf-8-sig" if damaged == "strict" else encoding_of(content)
            return io.TextIOWrapper(io.BytesIO(content), encoding, damaged).read()
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be read: {fault.strerror or fault}") from None
    except UnicodeDecodeError:
        raise error(f"{os.fspath(path)}: not a text file in UTF-8") from None
    raise error(f"{os.fspath(path)}: larger than {most_bytes / 2**20:g} MB; is it the right file?")


def encoding_of(head: bytes) -> str:
    """Return the encoding of a text by its first bytes.

    UTF-16 has a mark, as Excel and PowerShell write it. What is no UTF-8 is taken as Windows-1252,
    in which Excel writes degrees and squares.
    """
    if head.startswith(UTF16):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head[:_HEAD_BYTES])
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def named_files(text: str) -> list[str]:
    """Return the files of a comma-separated list.

    A text with a comma that is an existing file's name is one file.
    """
    if Path(text).is_file():
        return [text]
    return [name.strip() for name in text.split(",") if name.strip()]
