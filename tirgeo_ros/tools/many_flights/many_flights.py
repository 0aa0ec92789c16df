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
"""Process many flights into a folder: the work of ``tirgeo process FLIGHT... -o DIR``.

Each flight is one task in a process of its own. A flight that an earlier run has processed, from
the same files with the same options, is not processed again.
"""

from __future__ import annotations

import fcntl
import os
import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import BagError, ManyFlightsError
from tirgeo_ros.core.types.finding import NO_GO
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.bags.bag import METADATA
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, made_folder, writing
from tirgeo_ros.io.maps import map_files
from tirgeo_ros.io.parameters.parameter_file import paths_of
from tirgeo_ros.tools.many_flights.flight_process import FlightProgress, remove_parts, run_here
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
)
from tirgeo_ros.tools.many_flights.flights_page import PAGE, write_page
from tirgeo_ros.tools.presentation.progress import Report, silent, three
from tirgeo_ros.tools.presentation.results import listed, plain
from tirgeo_ros.tools.replay.node_configs import node_configs

_ENDINGS = re.compile(r"\.(mcap|db3)(\.zstd)?$", re.IGNORECASE)
_NAMED = 3  # most flights that the error names; all are in the result and on the page
#: Outcomes of a flight, and their words for a person.
_WORDS = {
    "processed": "processed",
    "kept": "already done",
    "in_part": "in part",
    "failed": "failed",
}


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
    """Process flights into a folder and return a summary; ``error`` names flights with an error.

    ``options`` are the keywords of ``process`` except ``progress``; ``video`` is the file name
    extension of the videos, with its dot. ``workers`` is the number of processes on this computer
    (None: one per core), ``scheduler`` the address of a Dask scheduler to use instead. The
    folder's page is written anew, also if the run is interrupted. Raise ConfigError, BagError and
    ManyFlightsError for errors that concern all flights.
    """
    begun_s = time.perf_counter()
    if video:
        needed("av", f"writing {video[1:]} videos", ManyFlightsError)
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

    Raise ManyFlightsError while another run uses the folder. The mark that a killed run leaves
    does not stop the next one.
    """
    mark = running_mark(folder)
    with writing(folder, ManyFlightsError):
        file = mark.open("w")
    with file:
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ManyFlightsError(
                f"{folder}: another tirgeo process works in this folder; "
                "wait until it ends, or give another folder"
            ) from None
        except OSError:  # a file system without locks
            pass
        try:
            yield
        finally:
            mark.unlink(missing_ok=True)


def flight_tasks(
    flights: Iterable[PathLike],
    folder: Path,
    records: Mapping[str, Record],
    video: str,
    options: Mapping[str, Any],
) -> list[FlightTask]:
    """Return a task for each flight; a flight that is named twice is one task.

    Raise ConfigError for the parameters, and BagError if an output would overwrite an input.
    """
    keywords: dict[str, Any] = {"namespace": ""} | {
        name: plain(value) for name, value in options.items()
    }
    params, chosen = keywords.get("params"), ("method", "dem", "ground_height", "camera")
    overrides = {key: keywords[key] for key in chosen if key in keywords}
    configs = node_configs(params, keywords["namespace"], **overrides)
    used = [*paths_of(params), *configs.files, *map_files(keywords.get("map") or "")]
    once: dict[str, PathLike] = {}
    for bag in flights:
        once.setdefault(os.path.realpath(bag), bag)  # Path.resolve raises at a loop of links
    bags = {place_of(bag): os.fspath(bag) for bag in once.values()}
    stamps = {path: bag_stamps(path) for path in bags}
    names = flight_names(stamps, records)
    own, digests = keywords | {"video": video}, digests_of(used)
    places = os.fspath(folder.resolve()), os.fspath(Path.cwd())
    tasks = [
        FlightTask(
            *(names[path], bag, *places, keywords, video),
            made_from(stamps[path], own, digests),
        )
        for path, bag in bags.items()
    ]
    outputs = [path for task in tasks for path in task.outputs]
    others = [path for path in outputs if path.is_file() or not path.exists()]
    check_outputs([*bags.values(), *used], [folder / PAGE, *others], BagError)
    return tasks


def _run(
    tasks: Sequence[FlightTask],
    records: dict[str, Record],
    workers: int | None,
    scheduler: str | None,
    progress: FlightProgress,
) -> None:
    """Run the tasks, and add their records to ``records``."""
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
    """Return the outcome of each flight; ``kept`` names the flights done by earlier runs.

    ``error`` is None, or how many flights have an error, and the names of the first ones.
    """
    flights: list[dict[str, object]] = []
    outcomes: Counter[str] = Counter()
    for task in tasks:
        record, is_kept = records[task.name], task.name in kept
        own = {key: record.get(key) for key in ("output", "duration_s", "elapsed_s", "error")}
        attempts = record["season"].get("attempts", 1)
        lead = {"name": task.name, "input": task.bag, "kept": is_kept, "attempts": attempts}
        flights.append(lead | own)
        if record["error"] and not record["error"].startswith(NO_GO):
            outcomes["in_part" if record["output"] else "failed"] += 1
        else:
            outcomes["kept" if is_kept else "processed"] += 1
    errors = [str(flight["name"]) for flight in flights if flight["error"]]
    error = f"{len(errors)} of {len(flights)} flights have an error: {listed(errors, _NAMED)}"
    return {
        "flights": flights,
        **{outcome: outcomes[outcome] for outcome in _WORDS},
        "error": error if errors else None,
    }


def summary_lines(result: Mapping[str, Any]) -> str:
    """Return a line of totals, then a line for each flight with an error, then the page."""
    outcomes = ", ".join(
        f"{result[outcome]} {word}" for outcome, word in _WORDS.items() if result[outcome]
    )
    flown_s = sum(x["duration_s"] or 0.0 for x in result["flights"] if not x["kept"])
    times = f"{three(flown_s)} s of flight in {three(result['elapsed_s'])} s"
    lines = [f"  flights  {len(result['flights'])}: {outcomes}; {times}"]
    lines += [f"! {x['name']:<8} {x['error']}" for x in result["flights"] if x["error"]]
    return "\n".join([*lines, f"  page     {result['page']}"])


def flight_names(
    flights: Mapping[Path, Sequence[Stamp]], records: Mapping[str, Record]
) -> dict[Path, str]:
    """Return a unique name for each flight; ``flights`` are paths with the stamps of their files.

    A flight that has a record keeps its name, also if it was moved, and no other flight gets it.
    Other flights are named by their file or folder; equal names get the names of the folders above
    in front until they differ, and if they never do, a number at the end.
    """
    names: dict[Path, str] = {}
    for name, record in records.items():
        place, files = record["season"]["bag"], record["season"]["made_from"]["flight"]
        rest = [path for path in flights if path not in names]
        same = [path for path in rest if str(place_of(path)) == place]
        present = [path for path in rest if all(size is not None for _, size, _ in flights[path])]
        moved = [path for path in present if flights[path] == files]
        names |= dict.fromkeys((same + moved)[:1], name)
    parts = {path: _parts(path) for path in flights if path not in names}
    taken = {*names.values(), *records}
    depths = dict.fromkeys(parts, 1)
    while True:
        joined = {path: "_".join(parts[path][-depths[path] :]) for path in parts}
        counts = Counter(joined.values())
        clashes = [p for p, name in joined.items() if name in taken or counts[name] > 1]
        deeper = [path for path in clashes if depths[path] < len(parts[path])]
        for path in deeper:
            depths[path] += 1
        if not deeper:
            break
    for path, name in joined.items():
        used, number = {*records, *names.values()}, 2
        names[path] = name
        while names[path] in used:
            names[path], number = f"{name}-{number}", number + 1
    return names


def _parts(path: Path) -> list[str]:
    """Return the names of a flight's folders and its own name, without a bag's ending."""
    whole = place_of(path)
    *folders, last = (whole.parent if whole.name == METADATA else whole).parts[1:]
    return [*folders, _ENDINGS.sub("", last)]
