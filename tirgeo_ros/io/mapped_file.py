"""A bag's file in memory as the system maps it: read where it is looked at, and no sooner."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from mmap import ACCESS_READ, mmap
from pathlib import Path

from tirgeo_ros.core.errors import BagError


@contextmanager
def mapped(path: Path) -> Iterator[mmap]:
    """The bytes of a file. Raises BagError, naming it, if it is empty or cannot be read."""
    try:
        with path.open("rb") as file:
            if not os.fstat(file.fileno()).st_size:
                raise BagError(f"{path}: the file is empty")
            with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
                yield data
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {error.strerror or error}") from None
