"""Process flights on this computer, each in a process of its own, some at a time."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from functools import partial

from tirgeo_ros.tools.season.board import Board
from tirgeo_ros.tools.season.flight_process import run_flight
from tirgeo_ros.tools.season.flight_record import Record
from tirgeo_ros.tools.season.flight_task import FlightTask

_SHOW_S = 0.2


def run_here(
    tasks: Sequence[FlightTask], workers: int | None, board: Board
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
            return run_flight(task, stopped.is_set, partial(board.part, task.name), cores)
        finally:
            shares.put(cores)

    with ThreadPoolExecutor(shares.qsize()) as pool:
        try:
            pending = {pool.submit(work, task): task for task in tasks}
            while pending:
                board.show()
                for future in wait(pending, _SHOW_S, FIRST_COMPLETED).done:
                    task = pending.pop(future)
                    board.done(task.name)
                    yield task, future.result()
        finally:
            stopped.set()
            pool.shutdown(cancel_futures=True)


def core_shares(workers: int | None, flights: int) -> list[list[int]]:
    """Return the cores of each worker, as equal in number as can be; never more than flights.

    With more workers than cores, some share one.
    """
    cores = sorted(os.sched_getaffinity(0))
    number = min(workers or len(cores), flights)
    return [cores[k::number] or [cores[k % len(cores)]] for k in range(number)]
