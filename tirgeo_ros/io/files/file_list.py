"""Several files in one parameter."""

from __future__ import annotations

from pathlib import Path


def named_files(text: str) -> list[str]:
    """The files of a list with commas; a file whose name has a comma is one too."""
    if Path(text).is_file():
        return [text]
    return [name.strip() for name in text.split(",") if name.strip()]
