# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Process flights on this computer, each in a child process; if it is killed, try again.

The child answers several times with the part that is done, and at last with the flight's summary.
"""

from __future__ import annotations

import os
import pickle
import queue
import re
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, final

import cv2
import numpy as np

from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.errors import ManyFlightsError, PictureError, TirgeoError, shown
from tirgeo_ros.core.types.missing_package import missing_line
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess, parent_pipes
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.messages.topics import resolved
from tirgeo_ros.tools.many_flights.flight_record import FlightTask, Record, written_record
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.results import error_line, plain
from tirgeo_ros.tools.replay.process import process
from tirgeo_ros.tools.replay.still_outputs import thumbnail_of

#: How often a flight is tried if its process is killed.
ATTEMPTS = 3
#: The child's program; it sets the command's environment before anything else is imported.
_RUN = """\
import os
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
from tirgeo_ros.tools.many_flights.flight_process import run_child
run_child()
"""
_POLL_S = 0.2  # between two polls, or two reports of progress
_END_S = 10.0  # time for a child that is stopped to remove its unfinished files
_PICTURE = "tirgeo/overlay/image/compressed"


@final
class FlightProgress:
    """Collect the progress of all threads, and report it from one; each flight counts as 1."""

    def __init__(self, total: int, progress: Report = silent) -> None:
        self._total, self._progress = total, progress
        self._parts: dict[str, float] = {}

    def part(self, name: str, part: float) -> None:
        """Set which part (0 to 1) of a flight is done; a failed flight is done too."""
        self._parts[name] = part

    def show(self) -> None:
        """Report the present progress."""
        self._progress(sum(list(self._parts.values())), self._total)


def run_here(
    tasks: Sequence[FlightTask], workers: int | None, progress: FlightProgress
) -> Generator[tuple[FlightTask, Record], None, None]:
    """Yield each task with its record, in the order in which they end.

    ``workers`` processes run at a time (None: as many as there are cores); each has its share of
    the cores. When the generator is closed, the running processes are ended.
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
                for future in wait(pending, _POLL_S, FIRST_COMPLETED).done:
                    task = pending.pop(future)
                    progress.part(task.name, 1.0)
                    yield task, future.result()
        finally:
            stopped.set()
            pool.shutdown(cancel_futures=True)


def core_shares(workers: int | None, flights: int) -> list[list[int]]:
    """Return the cores of each worker, evenly shared; there are never more workers than flights.

    With more workers than cores, several workers share a core.
    """
    cores = sorted(os.sched_getaffinity(0))
    number = min(workers or len(cores), flights)
    return [cores[k::number] or [cores[k % len(cores)]] for k in range(number)]


class Stopped(Exception):  # noqa: N818  not an error: the user has stopped the command
    """Report that the command was stopped while a flight was processed."""


def run_flight(
    task: FlightTask,
    is_stopped: Callable[[], bool],
    report: Callable[[float], None],
    cores: Sequence[int] = (),
) -> Record:
    """Process a flight, write its record and return it; ``report`` gets the part that is done.

    The record of a flight that fails has its error. Its process runs on ``cores``; without cores,
    it uses one at a time, which may be any. Raise Stopped once ``is_stopped`` returns true.
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
    """Run a process once; return its summary and "", or None and how it ended without one."""
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
        how = f"exit code {ended.code}"
        if ended.code < 0:
            how = f"signal {-ended.code} ({signal.Signals(-ended.code).name})"
        if ended.code == -signal.SIGKILL:
            how += "; if memory ran out, use fewer --workers"
        return None, how + ended.last
    finally:
        child.end(_END_S)
        remove_parts(task, child.number)
    raise Stopped


def remove_parts(task: FlightTask, number: int | None = None) -> None:
    """Remove a flight's unfinished files: those of one process (its number), or of any process."""
    which = r"\d+" if number is None else str(number)
    part = re.compile(rf"\.{re.escape(task.name)}\.(mcap|mp4|ts|jpg|json)\.{which}\.\w+")
    for path in Path(task.folder).iterdir():
        if part.fullmatch(path.name):
            path.unlink(missing_ok=True)


def run_child() -> None:
    """Process the parent's task on the cores that it sends; answer with the summary."""
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
    """Return a Report that answers with the part that is done, a few times a second."""
    next_s = time.monotonic()

    def report(done: float, total: float | None) -> None:
        nonlocal next_s
        if time.monotonic() >= next_s and total:
            next_s = time.monotonic() + _POLL_S
            answer(min(max(done / total, 0.0), 1.0))

    return report


def _outcome(task: FlightTask, cores: int, report: Report) -> dict[str, Any]:
    """Return the summary of a flight or, if it fails, its error in one line.

    Raise PictureError, because the flight is not at fault if a process was killed.
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
    except Exception as error:  # noqa: BLE001  a failed flight does not stop the others
        place = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        return {"error": shown(f"{task.bag}: {what}; report this error with this flight")}


def _processed(task: FlightTask, cores: int, report: Report) -> dict[str, Any]:
    """Process the flight; return its summary, facts and sizes of outputs, in JSON's types."""
    cv2.setNumThreads(cores)
    video = task.path(task.video) if task.video else None
    bag_out, picture = task.path(".mcap"), task.path(".jpg")
    options = {k: v for k, v in task.options.items() if k != "logs"}
    logs = LogOptions(**task.options.get("logs", {}))
    more: dict[str, Any] = {"video": video, "logs": logs, "progress": report, "cores": cores}
    summary: dict[str, Any] = process(task.bag, bag_out, **options, **more)
    facts, jpeg = flight_facts(bag_out, task.options["namespace"], summary["duration_s"])
    if jpeg:
        write_files({picture: jpeg}, ManyFlightsError)
    else:
        picture.unlink(missing_ok=True)
    sizes = {path.name: path.stat().st_size for path in (bag_out, video) if path and path.exists()}
    whole = plain(summary | {"season": {"outputs": sizes, "facts": facts}})
    assert isinstance(whole, dict)
    return whole


def flight_facts(bag: Path, namespace: str, duration_s: float) -> tuple[dict[str, Any], bytes]:
    """Return the facts of an output bag of ``process``, and a small JPEG; b"" without pictures.

    The facts are the begin in UTC, ``duration_s`` before the bag's end and, if there are
    positions, the first one (degrees) and the distance over the ground (m), from second to second.
    The picture is that in the middle or, if the video ends before, the last.
    """
    reader, cdr = BagReader(bag), Cdr()
    begin_ns, end_ns = reader.span_ns
    fix, overlay = resolved("tirgeo/fix", namespace), resolved(_PICTURE, namespace)
    places: dict[int, tuple[float, float]] = {}  # the first position of each second
    jpeg = None
    for message in reader.messages({fix, overlay} & reader.topics().keys()):
        if message.topic == fix:
            content = cdr.deserialize(message.data, message.typename)
            second = convert.stamp_ns(content) // 1_000_000_000
            places.setdefault(second, (content.latitude, content.longitude))
        elif jpeg is None or jpeg.log_time_ns < (begin_ns + end_ns) // 2:
            jpeg = message
    begin = utc(end_ns - round(duration_s * 1e9))[:19]  # whole seconds
    facts: dict[str, Any] = {"begin_utc": f"{begin}Z"}
    if places:
        latitude, longitude = np.radians(list(places.values())).T
        places_e = ecef_from_geodetic(latitude, longitude, np.zeros(len(places)))
        distance_m = float(np.linalg.norm(np.diff(places_e, axis=0), axis=1).sum())
        facts |= {"place_deg": next(iter(places.values())), "distance_m": distance_m}
    if jpeg is None:
        return facts, b""
    return facts, thumbnail_of(bytes(cdr.deserialize(jpeg.data, jpeg.typename).data))
