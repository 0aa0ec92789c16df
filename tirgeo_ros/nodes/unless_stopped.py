"""Run work before a node spins, so that a stop signal can interrupt it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from typing import TypeVar

from tirgeo_ros.nodes.start import STOP_SIGNALS

T = TypeVar("T")
_POLL_S = 0.05


def stop_is_due() -> bool:
    """Return whether a stop signal is pending that ``runner`` has not taken yet."""
    return bool(signal.sigpending() & set(STOP_SIGNALS))


def done_or_stopped(done: threading.Event) -> bool:
    """Wait for ``done``; return False if a stop signal comes before."""
    while not done.wait(_POLL_S):
        if stop_is_due():
            return False
    return True


def unless_stopped(work: Callable[[], T]) -> T | None:
    """Run ``work`` in a thread; return or raise its result, or None if a stop signal comes first.

    In that case the thread is left behind: it ends with the process.
    """
    done = threading.Event()
    found: list[T] = []
    raised: list[BaseException] = []

    def run() -> None:
        try:
            found.append(work())
        except BaseException as error:  # noqa: BLE001  raised again below
            raised.append(error)
        done.set()

    threading.Thread(target=run, name="before the node runs", daemon=True).start()
    if not done_or_stopped(done):
        return None
    if raised:
        raise raised[0]
    return found[0]
