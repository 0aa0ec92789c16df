"""Bound the memory and the time that a file from outside may take."""

from __future__ import annotations

import math
import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: A GeoJSON of two million vertices just fits. Together with the program it stays below 1 GB.
MOST_BYTES = 720 << 20
#: Seconds of computing: GDAL reads the largest map that is drawn in one or two.
MOST_S = 7


@contextmanager
def bounded_memory(most_bytes: int = MOST_BYTES) -> Iterator[None]:
    """Limit the process's additional memory; an allocation beyond it gets a MemoryError.

    The kernel (Linux) enforces the limit, so it holds in libraries too, and while it is open for
    every thread.
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
    """Return the process's private memory in bytes, as the limit counts it.

    Returns 0 if the system does not tell.
    """
    with suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        said = next(line for line in lines if line.startswith("VmData:"))
        return int(said.split()[1]) << 10
    return 0


@contextmanager
def bounded_time(most_s: int = MOST_S) -> Iterator[None]:
    """Limit the process's additional seconds of computing; SIGXCPU ends it beyond them."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    before, hard = resource.getrlimit(resource.RLIMIT_CPU)
    most = [math.ceil(used.ru_utime + used.ru_stime) + most_s]
    limit = min(most + [each for each in (before, hard) if each >= 0])
    resource.setrlimit(resource.RLIMIT_CPU, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, (before, hard))
