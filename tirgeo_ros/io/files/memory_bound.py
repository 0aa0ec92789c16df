"""A bound on the memory that a file from outside may fill."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: A GeoJSON of two million vertices just fits. With the program itself, below 1 GB.
MOST_BYTES = 720 << 20


@contextmanager
def bounded_memory(most_bytes: int = MOST_BYTES) -> Iterator[None]:
    """Hold the process to so much more memory; what asks for more of it gets a MemoryError.

    It is a bound of the kernel's (Linux), so that it holds in libraries too, and while it is open
    for every thread.
    """
    before, hard = resource.getrlimit(resource.RLIMIT_DATA)
    used = _used_bytes()
    most = [used + most_bytes, *(each for each in (before, hard) if each >= 0)]
    if used:
        resource.setrlimit(resource.RLIMIT_DATA, (min(most), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (before, hard))


def _used_bytes() -> int:
    """Private memory of the process, as the bound counts it; 0 where the system does not say."""
    with suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        said = next(line for line in lines if line.startswith("VmData:"))
        return int(said.split()[1]) << 10
    return 0
