"""Keep a season's folder to one run at a time."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tirgeo_ros.core.types.errors import SeasonError


def running_mark(folder: Path) -> Path:
    """Return the file that exists while a run works in a folder: its workers look for it."""
    return folder / ".running"


@contextmanager
def only_run(folder: Path) -> Iterator[None]:
    """Mark the folder as in use, and remove the mark at the end.

    Raises SeasonError while another run does the same. A run that was killed leaves a mark that
    stops nobody.
    """
    mark = running_mark(folder)
    try:
        file = mark.open("w")
    except OSError as error:
        raise SeasonError(f"{folder}: cannot be written: {error.strerror}") from None
    with file:
        _lock(file.fileno(), folder)
        try:
            yield
        finally:
            mark.unlink(missing_ok=True)


def _lock(number: int, folder: Path) -> None:
    with suppress(OSError):  # a file system without locks
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SeasonError(
                f"{folder}: another tirgeo process works in this folder; "
                "wait for it, or give another folder"
            ) from None
