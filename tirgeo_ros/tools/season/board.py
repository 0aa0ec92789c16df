"""Show how far a season is: the flights that are done, and the names of those in work."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import final

from tirgeo_ros.tools.presentation.progress import Progress, Report, silent

_NAMED = 3  # flights; of more the number is told


@final
class Board:
    """Collect from all threads what is done, and report it from one; flights count as 1.

    A progress bar has the names of the flights in work in front.
    """

    def __init__(self, total: int, progress: Report = silent) -> None:
        self._total, self._progress = total, progress
        self._done = 0
        self._parts: dict[str, float] = {}
        self._lock = threading.Lock()

    def part(self, name: str, part: float) -> None:
        """Take the part, 0 to 1, that is done of a flight in work."""
        with self._lock:
            self._parts[name] = part

    def in_work(self, names: Iterable[str]) -> None:
        """Take the names of the flights in work, where nothing is known of their parts."""
        with self._lock:
            self._parts = dict.fromkeys(names, 0.0)

    def done(self, name: str) -> None:
        """Take a flight that is done, or has failed."""
        with self._lock:
            self._parts.pop(name, None)
            self._done += 1

    def show(self) -> None:
        """Report the present state."""
        with self._lock:
            names, done = sorted(self._parts), self._done + sum(self._parts.values())
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        if isinstance(self._progress, Progress):
            self._progress.what = ", ".join(names[:_NAMED]) + more
        self._progress(done, self._total)
