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
_PIECE_BYTES = 1 << 20
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
    source = path_of(path, error)
    try:
        with source.open("rb") as file:
            content = io.BytesIO()
            while content.tell() <= most_bytes and (piece := file.read(_PIECE_BYTES)):
                content.write(piece)
        if content.tell() <= most_bytes:
            encoding = encoding_of(content.getvalue()) if damaged else "utf-8-sig"
            content.seek(0)
            return io.TextIOWrapper(content, encoding, WINDOWS if damaged else "strict").read()
    except OSError as fault:
        raise error(f"{os.fspath(path)}: cannot be read: {fault.strerror or fault}") from None
    except UnicodeDecodeError:
        raise error(f"{os.fspath(path)}: not a text file in UTF-8") from None
    raise error(f"{os.fspath(path)}: larger than {most_bytes / 2**20:g} MB; is it the right file?")


def encoding_of(head: bytes) -> str:
    """Return UTF-16, which has a mark as Excel and PowerShell write it, or UTF-8."""
    return "utf-16" if head.startswith(UTF16) else "utf-8-sig"


def named_files(text: str) -> list[str]:
    """Return the files of a comma-separated list.

    A text with a comma that is an existing file's name is one file.
    """
    if Path(text).is_file():
        return [text]
    return [name.strip() for name in text.split(",") if name.strip()]
