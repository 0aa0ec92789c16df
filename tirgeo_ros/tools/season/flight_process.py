"""Process a flight in a child process of this Python, and again if it is killed."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess
from tirgeo_ros.tools.season.flight_record import Record, written_record
from tirgeo_ros.tools.season.flight_task import FlightTask

#: How often a flight is begun whose process is killed.
ATTEMPTS = 3
#: With the environment of the command, before anything else is imported.
_RUN = """\
import os
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
from tirgeo_ros.tools.season.flight_child import main
main()
"""
_POLL_S = 0.2
_END_S = 10.0  # a child that is told to end removes what it has begun


class Stopped(Exception):  # noqa: N818  no error: the user has stopped the season
    """Report that a season was stopped while a flight was processed."""


def run_flight(
    task: FlightTask,
    is_stopped: Callable[[], bool],
    report: Callable[[float], None],
    cores: Sequence[int] = (),
) -> Record:
    """Process a flight, write its record and return it; ``report`` gets the part that is done.

    A flight that fails gives a record with its error. Its process keeps to ``cores``; with none
    given it uses one at a time, of all. Raises Stopped once ``is_stopped`` returns true.
    """
    found, attempts = None, 0
    while found is None and attempts < ATTEMPTS:
        found, fault = _once(task, is_stopped, report, cores)
        attempts += 1
    line = f"{task.bag}: its process ended {attempts} times without a result: {fault}"
    return written_record(task, found or {"error": line}, attempts)


def _once(
    task: FlightTask,
    is_stopped: Callable[[], bool],
    report: Callable[[float], None],
    cores: Sequence[int],
) -> tuple[dict[str, Any] | None, str]:
    """Return what a process found; or None, and how it ended without an answer."""
    child = ChildProcess(_RUN)
    try:
        child.send((task, list(cores)))
        while not is_stopped():
            if child.answers_within(_POLL_S):
                answer = child.receive()
                if not isinstance(answer, float):
                    return answer, ""
                report(answer)
    except ChildEndedError as ended:
        return None, _fault(ended)
    finally:
        child.end(_END_S)
        remove_parts(task, child.number)
    raise Stopped


def _fault(ended: ChildEndedError) -> str:
    """Return how a child ended, with its last words."""
    how = f"exit code {ended.code}"
    if ended.code < 0:
        how = f"signal {-ended.code} ({signal.Signals(-ended.code).name})"
    memory = "; if memory ran out, use fewer --workers" if ended.code == -signal.SIGKILL else ""
    return f"{how}{memory}{ended.last}"


def remove_parts(task: FlightTask, number: int | None = None) -> None:
    """Remove the unfinished files that a killed process, or any, has left of a flight."""
    which = r"\d+" if number is None else str(number)
    part = re.compile(rf"\.{re.escape(task.name)}\.(mcap|mp4|webm|ts|jpg|json)\.{which}\.\w+")
    for path in Path(task.folder).iterdir():
        if part.fullmatch(path.name):
            path.unlink(missing_ok=True)
