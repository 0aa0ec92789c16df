"""Keep a season's records: of each flight a file ``NAME.json`` beside its outputs.

It is the summary of ``tirgeo process --json``, and under the key ``season`` what this needs to
know: the flight, what its outputs are made from, their sizes, and the facts that the page shows.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import SeasonError
from tirgeo_ros.io.files.whole_files import read_text, write_files
from tirgeo_ros.tools.presentation.results import plain
from tirgeo_ros.tools.season.flight_task import FlightTask, Stamp, place_of

Record = dict[str, Any]


def read_records(folder: Path) -> dict[str, Record]:
    """Return a folder's records by the names of their flights; other files are passed over."""
    found: dict[str, Record] = {}
    for path in filter(Path.is_file, sorted(folder.glob("*.json"))):  # a pipe never ends
        with suppress(SeasonError, ValueError, RecursionError):
            record = json.loads(read_text(path, SeasonError))
            if _is_record(record):
                found[path.stem] = record
    return found


def written_record(task: FlightTask, found: Mapping[str, Any], attempts: int) -> Record:
    """Write the record of a flight from what its process found; return it.

    If it cannot be written, it has that as its error, unless it has another one.
    """
    record = record_of(task, found, attempts)
    text = json.dumps(plain(record), allow_nan=False, ensure_ascii=False, indent=1)
    try:
        write_files({task.path(".json"): text + "\n"}, SeasonError)
    except SeasonError as error:
        record["error"] = record["error"] or str(error)
    return record


def record_of(task: FlightTask, found: Mapping[str, Any], attempts: int) -> Record:
    """Return the record of a flight from what its process found: a summary, or an error alone."""
    season = {
        "name": task.name,
        "bag": str(place_of(Path(task.working_folder, task.bag))),
        "attempts": attempts,
        "made_from": task.made_from,
        "outputs": {},
        "facts": {},
    }
    return {"input": task.bag, "output": None, **found, "season": season | found.get("season", {})}


def is_done(record: Record | None, task: FlightTask) -> bool:
    """Return whether a flight's outputs are complete, and made from what they would be now."""
    if record is None or not record["output"]:
        return False
    season = record["season"]
    sizes = {name: _size(Path(task.folder, name)) for name in season["outputs"]}
    return bool(season["made_from"] == task.made_from and sizes == season["outputs"])


def same_place(record: Record, bag: Path) -> bool:
    """Return whether a record is of a flight in this place."""
    return bool(record["season"]["bag"] == str(place_of(bag)))


def same_files(record: Record, stamps: Sequence[Stamp]) -> bool:
    """Return whether a record is of a flight of these files, wherever they were."""
    there = all(size is not None for _, size, _ in stamps)
    return there and bool(record["season"]["made_from"]["flight"] == stamps)


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except OSError:
        return None


def _is_record(found: object) -> bool:
    """Return whether this is a record: so much of it as the rest relies on."""
    if not isinstance(found, dict) or not isinstance(season := found.get("season"), dict):
        return False
    kinds = {"name": str, "bag": str, "made_from": dict, "outputs": dict, "facts": dict}
    return (
        all(isinstance(season.get(key), kind) for key, kind in kinds.items())
        and isinstance(season["made_from"].get("flight"), list)
        and found.keys() >= {"input", "output", "error"}
    )
