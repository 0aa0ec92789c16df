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
"""Define the task of one flight, and its record: a file ``NAME.json`` beside its outputs.

The record is the summary of ``tirgeo process --json``. Its key ``season`` has the flight's name
and bag, what its outputs are made from, their sizes, and the facts that the page shows.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tirgeo_ros import __version__
from tirgeo_ros.core.types.errors import BagError, ManyFlightsError
from tirgeo_ros.io.bags.bag import bag_files
from tirgeo_ros.io.files.whole_files import PathLike, read_text, write_files
from tirgeo_ros.tools.presentation.results import plain

#: Name, size in bytes and time of change (ns) of a file; None if size and time are not known.
Stamp = list[str | int | None]
#: SHA-256 of a file, or the stamps of a folder's files; None if it is absent.
Digest = str | list[Stamp] | None
Record = dict[str, Any]


@dataclass(frozen=True)
class FlightTask:
    """Hold what a process on this or another computer needs to process a flight."""

    name: str  # name of its files in ``folder``, without ending
    bag: str
    folder: str  # folder of the outputs
    working_folder: str  # relative paths begin here
    options: dict[str, Any]  # keywords of ``process``, in JSON's types
    video: str  # ending of its video; "" for none
    made_from: dict[str, Any]  # everything that decides its outputs

    def path(self, ending: str) -> Path:
        """Return the path of one of its files; ``ending`` begins with a dot."""
        return Path(self.folder) / f"{self.name}{ending}"

    @property
    def outputs(self) -> list[Path]:
        """Return the paths of all its files."""
        endings = (".mcap", ".json", ".jpg", self.video)
        return [self.path(ending) for ending in endings if ending]


def running_mark(folder: Path) -> Path:
    """Return the file that exists while a run works in a folder: its workers look for it."""
    return folder / ".running"


def place_of(bag: PathLike) -> Path:
    """Return the absolute path of a flight. A symbolic link keeps its own path."""
    return Path(os.path.normpath(Path(bag).absolute()))


def bag_stamps(bag: PathLike) -> list[Stamp]:
    """Return the stamps of a bag's files, or of its path if the bag cannot be read."""
    try:
        files, _ = bag_files(Path(bag))
    except (BagError, OSError):
        files = [Path(bag)]
    return [_stamp(path) for path in files]


def made_from(
    stamps: Iterable[Stamp], options: Mapping[str, Any], digests: Mapping[str, Digest]
) -> dict[str, Any]:
    """Return, in JSON's types, everything that decides a flight's outputs.

    ``digests`` are those of parameter files and of the files that they name. These are compared by
    contents, because they are small and are copied and edited; the flight's own files by size and
    time of change.
    """
    return {"version": __version__, "flight": list(stamps), "options": options, "files": digests}


def digests_of(paths: Iterable[PathLike]) -> dict[str, Digest]:
    """Return by path the SHA-256 of each file, or the stamps of the files in a folder."""
    return {str(path): _digest(Path(path)) for path in paths if path}


def _stamp(path: Path) -> Stamp:
    try:
        status = path.stat()
    except OSError:
        return [path.name, None, None]
    return [path.name, status.st_size, status.st_mtime_ns]


def _digest(path: Path) -> Digest:
    try:
        if path.is_dir():
            return [_stamp(entry) for entry in sorted(path.iterdir())]
        digest = hashlib.sha256()
        with path.open("rb") as file:
            while piece := file.read(1 << 20):
                digest.update(piece)
    except OSError:
        return None
    return digest.hexdigest()


def read_records(folder: Path) -> dict[str, Record]:
    """Return a folder's records by the names of their flights; other files are ignored."""
    records: dict[str, Record] = {}
    for path in filter(Path.is_file, sorted(folder.glob("*.json"))):  # a pipe never ends
        with suppress(ManyFlightsError, ValueError, RecursionError):
            record = json.loads(read_text(path, ManyFlightsError))
            if _is_record(record):
                records[path.stem] = record
    return records


def written_record(task: FlightTask, summary: Mapping[str, Any], attempts: int) -> Record:
    """Write and return the record of a flight from its summary, which may be only an error.

    If the record cannot be written, this is its error, unless the flight has an error itself.
    """
    season = {
        "name": task.name,
        "bag": str(place_of(Path(task.working_folder, task.bag))),
        "attempts": attempts,
        "made_from": task.made_from,
        "outputs": {},
        "facts": {},
    }
    own = season | summary.get("season", {})
    record = {"input": task.bag, "output": None, **summary, "season": own}
    text = json.dumps(plain(record), allow_nan=False, ensure_ascii=False, indent=1)
    try:
        write_files({task.path(".json"): text + "\n"}, ManyFlightsError)
    except ManyFlightsError as error:
        record["error"] = record["error"] or str(error)
    return record


def is_done(record: Record | None, task: FlightTask) -> bool:
    """Return whether a flight's outputs are complete, and a new run would write the same."""
    if record is None or not record["output"]:
        return False
    season = record["season"]
    sizes = {name: _stamp(Path(task.folder, name))[1] for name in season["outputs"]}
    return bool(season["made_from"] == task.made_from and sizes == season["outputs"])


def _is_record(tree: object) -> bool:
    """Return whether a tree has all parts of a record that others read without a check."""
    if not isinstance(tree, dict) or not isinstance(season := tree.get("season"), dict):
        return False
    kinds = {"name": str, "bag": str, "made_from": dict, "outputs": dict, "facts": dict}
    return (
        all(isinstance(season.get(key), kind) for key, kind in kinds.items())
        and isinstance(season["made_from"].get("flight"), list)
        and tree.keys() >= {"input", "output", "error"}
    )
