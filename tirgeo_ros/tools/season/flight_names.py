"""Name a season's flights: by their files, and by their folders where two files have one name."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from tirgeo_ros.io.bags.bag_files import METADATA
from tirgeo_ros.tools.season.flight_record import Record, same_files, same_place
from tirgeo_ros.tools.season.flight_task import Stamp, place_of

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
    """Return the names of the flights that have records; a record is one flight's."""
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
    """Return the names of the folders to a flight and its own, without a bag's ending."""
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
