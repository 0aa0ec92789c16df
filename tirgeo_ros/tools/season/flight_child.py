"""Process one flight, in a process of its own: what ``flight_process`` starts.

It answers numbers, the part that is done, and at last what it found.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from tirgeo_ros.core.types.errors import PictureError, SeasonError, TirgeoError, shown
from tirgeo_ros.io.files.child_process import parent_pipes
from tirgeo_ros.io.files.missing_package import missing_line
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.presentation.results import error_line, plain
from tirgeo_ros.tools.season.flight_task import FlightTask

_REPORT_S = 0.2


def main() -> None:
    """Process the task of the parent, on the cores that it gives."""
    signal.signal(signal.SIGTERM, _end)
    with parent_pipes(signal.SIGTERM) as (tasks, answers):
        task, cores = pickle.load(tasks)  # noqa: S301  from our own parent

        def answer(found: object) -> None:
            pickle.dump(found, answers)
            answers.flush()

        if cores:
            os.sched_setaffinity(0, cores)
        answer(_found(task, max(len(cores), 1), _reporting(answer)))


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


def _found(task: FlightTask, cores: int, report: Report) -> dict[str, Any]:
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
    """Process the flight; return the summary, with what the season adds, in JSON's types."""
    import cv2  # noqa: PLC0415  heavy, as the others

    from tirgeo_ros.tools.replay.process import process  # noqa: PLC0415
    from tirgeo_ros.tools.season.flight_facts import flight_facts  # noqa: PLC0415

    cv2.setNumThreads(cores)
    video = task.path(task.video) if task.video else None
    bag_out, picture = task.path(".mcap"), task.path(".jpg")
    summary: dict[str, Any] = process(
        task.bag, bag_out, **task.options, video=video, progress=report, cores=cores
    )
    facts, jpeg = flight_facts(bag_out, task.options["namespace"], summary["duration_s"])
    if jpeg:
        write_files({picture: jpeg}, SeasonError)
    else:
        picture.unlink(missing_ok=True)
    sizes = {path.name: path.stat().st_size for path in (bag_out, video) if path and path.exists()}
    found = plain(summary | {"season": {"outputs": sizes, "facts": facts}})
    assert isinstance(found, dict)
    return found
