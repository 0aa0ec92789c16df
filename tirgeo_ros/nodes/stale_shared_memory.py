"""Remove the shared memory segments that Fast DDS left behind for processes that died.

A process that is killed cannot remove its files in /dev/shm, 17 MB each with this package's
profile, and nothing else removes them: the memory is lost until the computer restarts. Fast DDS
holds a lock (flock) on a file beside each segment (``_el``) for as long as the process lives. If
nobody holds the lock, the owner is dead. A segment's name is random, so a dead one is never used
again.
Ports are left alone: their names are numbers, which the next process may take at any moment, and
Fast DDS itself recreates a dead port.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
from pathlib import Path

FOLDER = Path("/dev/shm")  # noqa: S108 Fast DDS puts them there
_SEGMENT = re.compile(r"fastrtps_[0-9a-f]{16}")
_LOCK = "_el"
#: A younger file may still be in creation, and not locked yet.
_YOUNG_S = 2.0


def remove_dead(folder: Path = FOLDER) -> list[str]:
    """Remove the segments whose owners are dead; return their names.

    Files of other users, and files that disappear meanwhile, are skipped.
    """
    names = {path.name.removesuffix(_LOCK) for path in folder.glob("fastrtps_*")}
    segments = filter(_SEGMENT.fullmatch, names)
    dead = []
    for name in sorted(segments):
        lock = folder / (name + _LOCK)
        if not (_young(folder / name) or _young(lock) or _locked(lock)):
            dead.append(name)
    for name in dead:
        for file in (name, name + _LOCK):
            with contextlib.suppress(OSError):
                (folder / file).unlink()
    return dead


def _young(path: Path) -> bool:
    try:
        return time.time() - path.lstat().st_mtime < _YOUNG_S
    except OSError:
        return False


def _locked(path: Path) -> bool:
    """Return whether some process holds the lock of a file.

    A file that cannot be opened counts as held.
    """
    try:
        file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(file)
    return False
