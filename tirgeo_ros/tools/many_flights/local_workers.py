"""Process flights on this computer, each in a process of its own, some at a time."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from functools import partial
from typing import final

from tirgeo_ros.tools.many_flights.flight_process import run_flight
from tirgeo_ros.tools.many_flights.flight_record import FlightTask, Record
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent

_SHOW_S = 0.2
_NAMED = 3  # flights; of more the number is told


def run_here(
    tasks: Sequence[FlightTask], workers: int | None, progress: FlightProgress
) -> Generator[tuple[FlightTask, Record], None, None]:
    """Yield each task with its record, in the order in which they end.

    ``workers`` processes run at a time (None: as many as there are cores); each has its share of
    the cores. When the generator is closed, those that run are ended.
    """
    shares: queue.SimpleQueue[list[int]] = queue.SimpleQueue()
    for share in core_shares(workers, len(tasks)):
        shares.put(share)
    stopped = threading.Event()

    def work(task: FlightTask) -> Record:
        cores = shares.get()
        try:
            return run_flight(task, stopped.is_set, partial(progress.part, task.name), cores)
        finally:
            shares.put(cores)

    with ThreadPoolExecutor(shares.qsize()) as pool:
        try:
            pending = {pool.submit(work, task): task for task in tasks}
            while pending:
                progress.show()
                for future in wait(pending, _SHOW_S, FIRST_COMPLETED).done:
                    task = pending.pop(future)
                    progress.done(task.name)
                    yield task, future.result()
        finally:
            stopped.set()
            pool.shutdown(cancel_futures=True)


def core_shares(workers: int | None, flights: int) -> list[list[int]]:
    """Return the cores of each worker, evenly shared; there are never more workers than flights.

    With more workers than cores, some share one.
    """
    cores = sorted(os.sched_getaffinity(0))
    number = min(workers or len(cores), flights)
    return [cores[k::number] or [cores[k % len(cores)]] for k in range(number)]


@final
class FlightProgress:
    """Collect from all threads what is done, and report it from one; flights count as 1.

    A progress bar has the names of the flights in work in front.
    """

    def __init__(self, total: int, progress: Report = silent) -> None:
        self._total, self._progress = total, progress
        self._done = 0
        self._parts: dict[str, float] = {}
        self._lock = threading.Lock()

    def part(self, name: str, part: float) -> None:
        """Set which part (0 to 1) of a flight is done."""
        with self._lock:
            self._parts[name] = part

    def in_work(self, names: Iterable[str]) -> None:
        """Set the names of the flights in work, where their parts are unknown."""
        with self._lock:
            self._parts = dict.fromkeys(names, 0.0)

    def done(self, name: str) -> None:
        """Count a flight that is done, or has failed."""
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
