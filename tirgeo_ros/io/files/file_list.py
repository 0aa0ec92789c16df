"""Split a parameter that names several files."""

from __future__ import annotations

from pathlib import Path


def named_files(text: str) -> list[str]:
    """Return the files of a comma-separated list.

    A text with a comma that is an existing file's name is one file.
    """
    if Path(text).is_file():
        return [text]
    return [name.strip() for name in text.split(",") if name.strip()]
