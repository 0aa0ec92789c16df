"""Map a bag's file into memory: the system reads a part only when it is accessed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from mmap import ACCESS_READ, MADV_DONTNEED, mmap
from pathlib import Path

from tirgeo_ros.core.types.errors import BagError


@contextmanager
def mapped(path: Path) -> Iterator[mmap]:
    """Yield the bytes of a file. Raises BagError, naming it, if it is empty or cannot be read."""
    try:
        with path.open("rb") as file:
            if not os.fstat(file.fileno()).st_size:
                raise BagError(f"{path}: the file is empty")
            with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
                yield data
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {error.strerror or error}") from None


def part_of_file(data: mmap, start: int, length: int) -> bytes:
    """Return a copy of a part, and release all pages mapped so far.

    Otherwise every page of a file that was read once counts as this process's memory until the
    file is closed.
    """
    part = data[start : start + length]
    data.madvise(MADV_DONTNEED)
    return part
