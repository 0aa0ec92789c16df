"""Do slow work on the newest of what comes, in a thread of its own.

OpenCV encodes and decodes pictures without Python's lock, so a node handles its other messages
meanwhile, and on a slow computer the next picture is drawn while this one is encoded.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class NewestWorker(Generic[T]):
    """Call ``work`` with one item after another, in their order, in a thread.

    One item waits while another is worked on; a newer one replaces it, counted in ``replaced``.
    ``work`` must raise nothing. ``close`` ends the thread; what waits then is dropped.
    """

    def __init__(self, name: str, work: Callable[[T], object]) -> None:
        self.replaced = 0
        self._work = work
        self._waiting: list[T] = []  # one at most
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def put(self, item: T) -> None:
        """Hand over an item; the first one starts the thread."""
        with self._changed:
            if self._closed:
                return
            self.replaced += len(self._waiting)
            self._waiting = [item]
            self._changed.notify()
            if self._thread.ident is None:
                self._thread.start()

    def close(self) -> None:
        """Wait for the item that is worked on, and end the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._waiting)
                if self._closed:
                    return
                item = self._waiting.pop()
            self._work(item)
