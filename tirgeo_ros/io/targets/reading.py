"""Read targets from what tirgeo wrote: GeoPackage, GeoJSON and CSV."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import re
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tirgeo_ros.core.targets.target import KINDS, Fixing, Target
from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.files.whole_files import PathLike, read_text
from tirgeo_ros.io.surveys.survey import MOST_ROWS
from tirgeo_ros.io.targets.geopackage import load_targets
from tirgeo_ros.io.targets.properties import target_of_pixel
from tirgeo_ros.io.targets.target_file import DAMAGED, check_tables, explained

_WAIT_S = 2.0
#: What ``exports`` put an apostrophe before.
_QUOTED = re.compile(r"""(^|[;|\t\n])'(?=['" ]*[=+\-@\t\r])""")
_WRITTEN = "which tirgeo did not write; give a GeoPackage, GeoJSON or CSV of targets from tirgeo"


def read_targets(path: PathLike) -> list[Target]:
    """Return the targets of a file in its order, or by number (GeoPackage).

    GeoJSON and CSV hold the average of the clicks, so their targets have one click. Pixels that
    ``tirgeo locate`` located are targets too; refused ones are left out. Raises TargetError
    naming the file.
    """
    path = Path(path)
    with contextlib.suppress(OSError), path.open("rb") as file:
        if file.read(16) == b"SQLite format 3\0":
            return _from_geopackage(path)
    text = read_text(path, TargetError)
    rows = _json_rows(path, text) if text.lstrip().startswith("{") else _csv_rows(path, text)
    if len(rows) > MOST_ROWS:
        raise TargetError(f"{path}: {len(rows)} rows, more than the {MOST_ROWS} allowed")
    targets: list[Target] = []
    for line, row in enumerate(rows, 1):
        if row.get("latitude_deg") in {None, ""}:
            continue  # a refused pixel
        try:
            targets.append(_target(row, len(targets) + 1))
        except (KeyError, TypeError, ValueError, OverflowError, TargetError):
            raise TargetError(f"{path}: row {line} is one {_WRITTEN}") from None
    for what in ("id", "number"):
        if len({getattr(one, what) for one in targets}) < len(targets):
            raise TargetError(f"{path}: two targets have the same {what}; remove one of them")
    return targets


def _from_geopackage(path: Path) -> list[Target]:
    """Return the targets of a file, read without a change; Raises TargetError."""
    journal = path.with_name(f"{path.name}-journal")  # of a change that a crash cut short
    cut_short = journal.exists() and journal.stat().st_size > 0
    address = f"{path.resolve().as_uri()}?mode={'rw' if cut_short else 'ro'}"
    with explained(path), contextlib.closing(sqlite3.connect(address, _WAIT_S, uri=True)) as db:
        check_tables(db, path)
        try:
            return load_targets(db)
        except (TargetError, TypeError, ValueError, AttributeError) as error:
            raise TargetError(f"{path}: {DAMAGED} ({error})") from None


def _json_rows(path: Path, text: str) -> list[dict[str, Any]]:
    """Return the properties of the points."""
    try:
        features = json.loads(text)["features"]
        every = [feature["properties"] for feature in features]
        points = [row for row in every if {"point": True, "ellipse": False}[row["kind"]]]
    except (KeyError, TypeError, ValueError, RecursionError):
        raise TargetError(f"{path}: a file {_WRITTEN}") from None
    return points


def _csv_rows(path: Path, text: str) -> list[dict[str, Any]]:
    """Return the cells of the rows, as they were before the apostrophes."""
    reader = csv.DictReader(io.StringIO(text, newline=""))
    try:
        rows = [
            {key: cell and _QUOTED.sub(r"\1", cell) for key, cell in row.items()} for row in reader
        ]
    except (AttributeError, TypeError, csv.Error):
        raise TargetError(f"{path}: line {reader.line_num} is one {_WRITTEN}") from None
    if "covariance_enu" not in (reader.fieldnames or ()):
        raise TargetError(f"{path}: a file {_WRITTEN}")
    return rows


def _target(row: Mapping[str, Any], place_in_file: int) -> Target:
    """Return a row's target; one without a number is a located pixel's."""
    covariance = tuple(float(word) for word in row["covariance_enu"].split())
    latitude, longitude, height_m = (
        float(row[key]) for key in ("latitude_deg", "longitude_deg", "height_m")
    )
    fixing = Fixing(int(row["stamp_ns"]), latitude, longitude, height_m, covariance)
    if "number" not in row:
        return target_of_pixel(place_in_file, str(row["id"]), fixing)
    kind = row["target_kind"] if row["target_kind"] in KINDS else "other"
    words = str(row["name"]), kind, str(row["note"]), str(row["aircraft"])
    times = int(row["created_ns"]), int(row["changed_ns"])
    return Target(str(row["id"]), int(row["number"]), *words, *times, (fixing,))
