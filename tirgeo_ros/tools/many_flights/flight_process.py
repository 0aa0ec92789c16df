"""Process a flight in a child process of this Python, and again if it is killed.

The child answers numbers, the part that is done, and at last the flight's summary.
"""

from __future__ import annotations

import os
import pickle
import re
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from tirgeo_ros.core.types.errors import ManyFlightsError, PictureError, TirgeoError, shown
from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess, parent_pipes
from tirgeo_ros.io.files.missing_package import missing_line
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.tools.many_flights.flight_record import FlightTask, Record, written_record
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.presentation.results import error_line, plain

#: How often a flight is begun whose process is killed.
ATTEMPTS = 3
#: With the environment of the command, before anything else is imported.
_RUN = """\
import os
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
from tirgeo_ros.tools.many_flights.flight_process import run_child
run_child()
"""
_POLL_S, _REPORT_S = 0.2, 0.2
_END_S = 10.0  # a child that is told to end removes what it has begun


class Stopped(Exception):  # noqa: N818  no error: the user has stopped the command
    """Report that the command was stopped while a flight was processed."""


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
    summary, attempts = None, 0
    while summary is None and attempts < ATTEMPTS:
        summary, fault = _once(task, is_stopped, report, cores)
        attempts += 1
    line = f"{task.bag}: its process ended {attempts} times without a result: {fault}"
    return written_record(task, summary or {"error": line}, attempts)


def _once(
    task: FlightTask,
    is_stopped: Callable[[], bool],
    report: Callable[[float], None],
    cores: Sequence[int],
) -> tuple[dict[str, Any] | None, str]:
    """Return the summary that a process answers; or None, and how it ended without one."""
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
    """Return how a child ended, with the last line that it wrote."""
    how = f"exit code {ended.code}"
    if ended.code < 0:
        how = f"signal {-ended.code} ({signal.Signals(-ended.code).name})"
    memory = "; if memory ran out, use fewer --workers" if ended.code == -signal.SIGKILL else ""
    return f"{how}{memory}{ended.last}"


def remove_parts(task: FlightTask, number: int | None = None) -> None:
    """Remove the unfinished files of a flight, of one process or of any that was killed."""
    which = r"\d+" if number is None else str(number)
    part = re.compile(rf"\.{re.escape(task.name)}\.(mcap|mp4|webm|ts|jpg|json)\.{which}\.\w+")
    for path in Path(task.folder).iterdir():
        if part.fullmatch(path.name):
            path.unlink(missing_ok=True)


def run_child() -> None:
    """Process the task of the parent process, on the cores that it gives; answer the summary."""
    signal.signal(signal.SIGTERM, _end)
    with parent_pipes(signal.SIGTERM) as (tasks, answers):
        task, cores = pickle.load(tasks)  # noqa: S301  from our own parent

        def answer(content: object) -> None:
            pickle.dump(content, answers)
            answers.flush()

        if cores:
            os.sched_setaffinity(0, cores)
        answer(_outcome(task, max(len(cores), 1), _reporting(answer)))


def _end(number: int, _frame: object) -> NoReturn:
    sys.exit(128 + number)


def _reporting(answer: Callable[[object], None]) -> Report:
    """Return a Report that answers the part that is done, a few times a second."""
    next_s = time.monotonic()

    def report(done: float, total: float | None) -> None:
        nonlocal next_s
        if time.monotonic() >= next_s and total:
            next_s = time.monotonic() + _REPORT_S
            answer(min(max(done / total, 0.0), 1.0))

    return report


def _outcome(task: FlightTask, cores: int, report: Report) -> dict[str, Any]:
    """Return the summary of a flight; if it fails, its error in one line.

    Raises PictureError, as a process that was killed is no fault of the flight.
    """
    try:
        os.chdir(task.working_folder)
        return _processed(task, cores, report)
    except PictureError:
        raise
    except (TirgeoError, OSError) as error:
        return {"error": error_line(error)}
    except ModuleNotFoundError as error:
        return {"error": missing_line(str(error.name))}
    except Exception as error:  # noqa: BLE001  a flight that fails stops no other
        place = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        return {"error": shown(f"{task.bag}: {what}; report it with this flight")}


def _processed(task: FlightTask, cores: int, report: Report) -> dict[str, Any]:
    """Process the flight; return its summary, facts and sizes of outputs, in JSON's types."""
    import cv2  # noqa: PLC0415  heavy, as the others

    from tirgeo_ros.tools.many_flights.flight_facts import flight_facts  # noqa: PLC0415  heavy
    from tirgeo_ros.tools.replay.process import process  # noqa: PLC0415  heavy

    cv2.setNumThreads(cores)
    video = task.path(task.video) if task.video else None
    bag_out, picture = task.path(".mcap"), task.path(".jpg")
    summary: dict[str, Any] = process(
        task.bag, bag_out, **task.options, video=video, progress=report, cores=cores
    )
    facts, jpeg = flight_facts(bag_out, task.options["namespace"], summary["duration_s"])
    if jpeg:
        write_files({picture: jpeg}, ManyFlightsError)
    else:
        picture.unlink(missing_ok=True)
    sizes = {path.name: path.stat().st_size for path in (bag_out, video) if path and path.exists()}
    whole = plain(summary | {"season": {"outputs": sizes, "facts": facts}})
    assert isinstance(whole, dict)
    return whole
