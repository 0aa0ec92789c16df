"""Keep what is to be sent: the newest event of each object, until the network has taken it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import NamedTuple
from xml.etree import ElementTree as ET

#: Makes an event at a time of sending, ns.
Maker = Callable[[int], ET.Element]
#: Entries that wait at most; each is below 10 kB.
MOST = 5000


class Entry(NamedTuple):
    """Hold one thing to send."""

    uid: str
    make: Maker


class Outbox:
    """Hold the newest entry of each uid, in the order of sending; safe in all threads.

    A kept entry waits again after ``all_again``. Nothing that waits is lost but by ``forget`` or,
    counted in ``dropped``, by ``drop`` and by more than MOST entries: then the oldest goes.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: dict[str, Maker] = {}
        self._kept: dict[str, Maker] = {}
        self._gone_out: set[str] = set()
        self.shut = False  # nothing goes out
        self.dropped = 0

    def __len__(self) -> int:
        """Return how many wait."""
        return len(self._waiting)

    def put(self, uid: str, make: Maker, *, keep: bool) -> None:
        """Send an object's newest event next, instead of an older one that waits."""
        with self._lock:
            self._waiting.pop(uid, None)
            self._waiting[uid] = make
            self._kept.pop(uid, None)
            if keep:
                self._kept[uid] = make
            self._bound()

    def forget(self, uid: str) -> None:
        """Send no more of an object."""
        with self._lock:
            self._waiting.pop(uid, None)
            self._kept.pop(uid, None)

    def keep_no_more(self, uid: str) -> None:
        """Send an object once at most, if it waits."""
        with self._lock:
            self._kept.pop(uid, None)

    def all_again(self) -> None:
        """Let all kept entries wait."""
        with self._lock:
            for uid, make in self._kept.items():
                self._waiting.setdefault(uid, make)
            self._bound()

    def first(self) -> Entry | None:
        """Return what is to be sent next, unless it is shut; it waits until ``sent``."""
        with self._lock:
            waiting = () if self.shut else self._waiting.items()
            return next((Entry(*one) for one in waiting), None)

    def sent(self, entry: Entry) -> None:
        """Let an entry wait no more, unless a newer one came meanwhile."""
        with self._lock:
            if self._waiting.get(entry.uid) is entry.make:
                del self._waiting[entry.uid]
            if entry.uid in self._kept:
                self._gone_out.add(entry.uid)

    def drop(self, entry: Entry) -> None:
        """Send no more of an object that cannot be said; count it."""
        self.forget(entry.uid)
        self.dropped += 1

    def assume_sent(self, uids: Iterable[str]) -> None:
        """Count objects as sent, perhaps by an earlier run."""
        with self._lock:
            self._gone_out.update(uids)

    def was_sent(self, uid: str) -> bool:
        """Return whether an object that is kept may have gone out."""
        return uid in self._gone_out

    def _bound(self) -> None:
        while len(self._waiting) > MOST:
            del self._waiting[next(iter(self._waiting))]
            self.dropped += 1
