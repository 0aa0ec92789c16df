"""Process many flights into a folder: the work of ``tirgeo process FLIGHT... -o DIR``.

Each flight is one task in a process of its own. What an earlier run has done, from the same files
with the same options, is not done again.
"""

from __future__ import annotations

import fcntl
import os
import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import BagError, ManyFlightsError
from tirgeo_ros.core.types.finding import NO_GO
from tirgeo_ros.io.bags.bag import METADATA
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, made_folder
from tirgeo_ros.io.maps import map_files
from tirgeo_ros.io.parameters.parameter_file import paths_of
from tirgeo_ros.tools.many_flights.flight_process import remove_parts
from tirgeo_ros.tools.many_flights.flight_record import (
    FlightTask,
    Record,
    Stamp,
    bag_stamps,
    digests_of,
    is_done,
    made_from,
    place_of,
    read_records,
    running_mark,
    same_files,
    same_place,
)
from tirgeo_ros.tools.many_flights.flights_page import PAGE, write_page
from tirgeo_ros.tools.many_flights.local_workers import FlightProgress, run_here
from tirgeo_ros.tools.presentation.progress import Report, silent, three
from tirgeo_ros.tools.presentation.results import plain
from tirgeo_ros.tools.replay.node_configs import node_configs

_NAMED = 3  # errors in the line of the whole; all are in the result and on the page
#: What becomes of a flight, and in words for a person.
_WORDS = {
    "processed": "processed",
    "kept": "already done",
    "in_part": "in part",
    "failed": "failed",
}
_OF_RECORD = ("output", "duration_s", "elapsed_s", "error")


def process_flights(
    flights: Iterable[PathLike],
    folder: PathLike,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    video: str = "",
    progress: Report = silent,
    **options: Any,
) -> dict[str, object]:
    """Process flights into a folder and return a summary; ``error`` names those that have failed.

    ``options`` are the keywords of ``process``, but for ``progress``; ``video`` is the ending of
    the videos, with its dot. ``workers`` is the number of processes on this computer (None: one a
    core), ``scheduler`` the address of a Dask scheduler to use instead. A ``progress`` bar names
    the flights in work. The folder's page is made anew, also if the run is interrupted. Raises
    ConfigError, BagError and ManyFlightsError for what concerns all flights.
    """
    begun_s = time.perf_counter()
    place = made_folder(folder, ManyFlightsError)
    with only_run(place):
        records = read_records(place)
        tasks = flight_tasks(flights, place, records, video, options)
        kept = [task.name for task in tasks if is_done(records.get(task.name), task)]
        wanted = [task for task in tasks if task.name not in kept]
        for task in wanted:
            remove_parts(task)
        try:
            _run(wanted, records, workers, scheduler, FlightProgress(len(wanted), progress))
        finally:
            write_page(place)
    return {
        **flights_summary(tasks, kept, records),
        "page": os.fspath(place / PAGE),
        "elapsed_s": time.perf_counter() - begun_s,
    }


@contextmanager
def only_run(folder: Path) -> Iterator[None]:
    """Mark the folder as in use, and remove the mark at the end.

    Raises ManyFlightsError while another run does the same. A run that was killed leaves a mark
    that stops nobody.
    """
    mark = running_mark(folder)
    try:
        file = mark.open("w")
    except OSError as error:
        raise ManyFlightsError(f"{folder}: cannot be written: {error.strerror}") from None
    with file:
        _lock(file.fileno(), folder)
        try:
            yield
        finally:
            mark.unlink(missing_ok=True)


def _lock(number: int, folder: Path) -> None:
    with suppress(OSError):  # a file system without locks
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ManyFlightsError(
                f"{folder}: another tirgeo process works in this folder; "
                "wait for it, or give another folder"
            ) from None


def flight_tasks(
    flights: Iterable[PathLike],
    folder: Path,
    records: Mapping[str, Record],
    video: str,
    options: Mapping[str, Any],
) -> list[FlightTask]:
    """Return a task for each flight; one that is given twice is one task.

    Raises ConfigError for the parameters, and BagError for an output in the place of an input.
    """
    keywords: dict[str, Any] = {"namespace": ""} | {
        name: plain(value) for name, value in options.items()
    }
    used = _files(keywords)
    digests, own = digests_of(used), keywords | {"video": video}
    bags = {place_of(bag): os.fspath(bag) for bag in _each_once(flights)}
    stamps = {path: bag_stamps(path) for path in bags}
    names = flight_names(stamps, records)
    places = os.fspath(folder.resolve()), os.fspath(Path.cwd())
    tasks = []
    for path, bag in bags.items():
        made = made_from(stamps[path], own, digests)
        tasks.append(FlightTask(names[path], bag, *places, keywords, video, made))
    outputs = [path for task in tasks for path in task.outputs]
    others = [path for path in outputs if path.is_file() or not path.exists()]
    check_outputs([*bags.values(), *used], [folder / PAGE, *others], BagError)
    return tasks


def _files(keywords: Mapping[str, Any]) -> list[PathLike]:
    """Return the parameter files and what they and the options name. Raises ConfigError."""
    params, keys = keywords.get("params"), ("method", "dem", "ground_height", "camera")
    chosen = {key: keywords[key] for key in keys if key in keywords}
    configs = node_configs(params, keywords["namespace"], **chosen)
    return [*paths_of(params), *configs.files, *map_files(keywords.get("map") or "")]


def _each_once(flights: Iterable[PathLike]) -> Iterable[PathLike]:
    """Return each flight once, also one that is given by two names."""
    once: dict[Path, PathLike] = {}
    for bag in flights:
        once.setdefault(Path(os.path.realpath(bag)), bag)  # resolve() raises at a loop of links
    return once.values()


def _run(
    tasks: Sequence[FlightTask],
    records: dict[str, Record],
    workers: int | None,
    scheduler: str | None,
    progress: FlightProgress,
) -> None:
    """Run the tasks, and put their records among the others."""
    if not tasks:
        return
    if scheduler is None:
        running = run_here(tasks, workers, progress)
    else:
        from tirgeo_ros.tools.many_flights.dask_workers import run_on_cluster  # noqa: PLC0415  an extra

        running = run_on_cluster(tasks, scheduler, progress)
    with closing(running):
        for task, record in running:
            records[task.name] = record


def flights_summary(
    tasks: Sequence[FlightTask], kept: Sequence[str], records: Mapping[str, Record]
) -> dict[str, object]:
    """Return what became of each flight; ``kept`` are the names of those done by earlier runs.

    ``error`` is None, or how many flights have an error, and the names of the first ones.
    """
    flights = [_flight(task, records[task.name], task.name in kept) for task in tasks]
    errors = [str(flight["name"]) for flight in flights if flight["error"]]
    more = f" and {len(errors) - _NAMED} more" if len(errors) > _NAMED else ""
    first = f"{len(errors)} of {len(flights)} flights have an error: {', '.join(errors[:_NAMED])}"
    fates = Counter(map(_fate, flights))
    return {
        "flights": flights,
        **{fate: fates[fate] for fate in _WORDS},
        "error": first + more if errors else None,
    }


def summary_lines(result: Mapping[str, Any]) -> str:
    """Return what was done, then a line for each flight with an error, then the page."""
    fates = ", ".join(f"{result[fate]} {word}" for fate, word in _WORDS.items() if result[fate])
    times = f"{three(_flown_s(result))} s of flight in {three(result['elapsed_s'])} s"
    lines = [f"  flights  {len(result['flights'])}: {fates}; {times}"]
    lines += [f"! {x['name']:<8} {x['error']}" for x in result["flights"] if x["error"]]
    return "\n".join([*lines, f"  page     {result['page']}"])


def _fate(flight: Mapping[str, object]) -> str:
    if flight["error"] and not str(flight["error"]).startswith(NO_GO):
        return "in_part" if flight["output"] else "failed"
    return "kept" if flight["kept"] else "processed"


def _flown_s(result: Mapping[str, Any]) -> float:
    """Return the length of the flights that were processed now."""
    return float(sum(x["duration_s"] or 0 for x in result["flights"] if not x["kept"]))


def _flight(task: FlightTask, record: Record, kept: bool) -> dict[str, object]:
    own = {name: record.get(name) for name in _OF_RECORD}
    attempts = record["season"].get("attempts", 1)
    return {"name": task.name, "input": task.bag, "kept": kept, "attempts": attempts, **own}


_ENDINGS = re.compile(r"\.(mcap|db3)(\.zstd)?$", re.IGNORECASE)


def flight_names(
    flights: Mapping[Path, Sequence[Stamp]], records: Mapping[str, Record]
) -> dict[Path, str]:
    """Return a name for each flight (its path, and the stamps of its files), all different.

    A flight that has a record keeps its name, and no other flight gets it. The others have the
    name of their file or folder; where several have the same, those of the folders around come
    before it until they differ, and at last a number behind it.
    """
    names = _recorded(flights, records)
    parts = {path: _parts(path) for path in flights if path not in names}
    taken = {*names.values(), *records}
    depths = dict.fromkeys(parts, 1)
    while True:
        made = {path: "_".join(parts[path][-depths[path] :]) for path in parts}
        counts = Counter(made.values())
        clashes = [p for p, name in made.items() if name in taken or counts[name] > 1]
        deeper = [path for path in clashes if depths[path] < len(parts[path])]
        for path in deeper:
            depths[path] += 1
        if not deeper:
            return names | _numbered(made, taken)


def _recorded(
    flights: Mapping[Path, Sequence[Stamp]], records: Mapping[str, Record]
) -> dict[Path, str]:
    """Return the names of the flights that have a record; no two share one."""
    names: dict[Path, str] = {}
    for name, record in records.items():
        rest = [path for path in flights if path not in names]
        here = (path for path in rest if same_place(record, path))
        moved = (path for path in rest if same_files(record, flights[path]))
        path = next(here, None) or next(moved, None)
        if path is not None:
            names[path] = name
    return names


def _parts(path: Path) -> list[str]:
    """Return the names of a flight's folders and its own name, without a bag's ending."""
    whole = place_of(path)
    *folders, last = (whole.parent if whole.name == METADATA else whole).parts[1:]
    return [*folders, _ENDINGS.sub("", last)]


def _numbered(made: Mapping[Path, str], taken: set[str]) -> dict[Path, str]:
    names: dict[Path, str] = {}
    for path, name in made.items():
        used, number = taken | set(names.values()), 2
        names[path] = name
        while names[path] in used:
            names[path], number = f"{name}-{number}", number + 1
    return names
