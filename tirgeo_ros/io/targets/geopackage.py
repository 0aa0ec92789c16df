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
"""Open, check and fill the GeoPackage of targets (OGC 12-128r18, version 1.3).

A store opens it for its own process alone. Errors say what is wrong with a file.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import KINDS, Target, known_status
from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.files.geopackage_layers import Layer, Positions, insert, make_file, make_layer
from tirgeo_ros.io.files.whole_files import PathLike, first_bytes
from tirgeo_ros.io.targets.columns import CLICK, COLUMNS, target_cells

_MAGIC = b"SQLite format 3\0"
_WAIT_S = 2.0  # for a program that is just ending
#: A part of SQLite's message -> what to do.
_REMEDIES = {
    "locked": "another program has it open (a second viewer_node, QGIS): close that, or give the "
    "targets another file",
    "full": "no room on the disk: free some and try again; the targets are unchanged",
    "readonly": "it is read-only: choose another place",
    "unable to open": "its folder cannot be written: choose another place",
    "disk I/O": "the disk fails: choose another one; the targets are unchanged",
    "not a database": "it is not a GeoPackage; give another file for the targets",
}
_DAMAGED = (
    "it is damaged and was left as it is: move it away to begin a new one; the command "
    "'sqlite3 FILE .recover' gets back what it still holds"
)
TARGETS = Layer("targets", "Point", COLUMNS, "places, each the average of its clicks")
ELLIPSES = Layer(
    "ellipses",
    "Polygon",
    {"target": "TEXT NOT NULL", "number": "INTEGER", "name": "TEXT"},
    "95 % ellipses of the places",
)
TARGET_LAYERS = TARGETS, ELLIPSES
_ABOUT_CLICKS = "every click; these count, the other two tables are made of them"
_CLICKS = Layer("clicks", "", {"target": "TEXT NOT NULL"} | CLICK, _ABOUT_CLICKS)
_PICTURE = {"target": "TEXT NOT NULL UNIQUE", "jpeg": "BLOB NOT NULL"}
_MARK = {"stamp_ns": "INTEGER NOT NULL", "time": "DATETIME NOT NULL", "text": "TEXT NOT NULL"}
_LAYERS = (
    TARGETS,
    ELLIPSES,
    _CLICKS,
    Layer("pictures", "", _PICTURE, "cut-outs of the video, JPEG"),
    Layer("marks", "", _MARK, "marks in time"),
)
_JOURNAL = (
    "CREATE TABLE tirgeo_changes (revision INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, "
    "at_ns INTEGER, action TEXT NOT NULL, target TEXT NOT NULL, before TEXT, "
    "undone INTEGER NOT NULL, status TEXT)"
)
#: Alternatives: texts that a person may still choose for a field; ``settled`` is the revision of
#: the choice, whose undo opens it again. Switches: what is switched on.
_PAGE_TABLES = {
    "alternatives": "target TEXT NOT NULL, field TEXT NOT NULL, text TEXT NOT NULL, settled INT",
    "switches": "what TEXT NOT NULL PRIMARY KEY",
}
_CLICK = ", ".join(CLICK)
#: Tables whose column ``status`` files of an earlier version lack.
_WITH_STATUS = ("targets", "tirgeo_changes")
#: An earlier version writes a target anew without its status, which the file then keeps itself.
_KEEP_STATUS = (
    "CREATE TABLE IF NOT EXISTS tirgeo_statuses (target TEXT NOT NULL PRIMARY KEY, status TEXT)",
    """CREATE TRIGGER IF NOT EXISTS tirgeo_keep_status BEFORE DELETE ON targets
    WHEN OLD.id IS NOT NULL
    BEGIN INSERT OR REPLACE INTO tirgeo_statuses VALUES (OLD.id, OLD.status); END""",
    """CREATE TRIGGER IF NOT EXISTS tirgeo_put_status AFTER INSERT ON targets
    WHEN NEW.status IS NULL
    BEGIN UPDATE targets SET status = (SELECT status FROM tirgeo_statuses WHERE target = NEW.id)
    WHERE fid = NEW.fid; END""",
)


def make_tables(db: sqlite3.Connection) -> None:
    """Make the tables of an empty file, within the caller's transaction."""
    make_file(db)
    for layer in _LAYERS:
        make_layer(db, layer)
    db.execute(_JOURNAL)
    db.execute("CREATE INDEX clicks_of_target ON clicks (target)")


def put_target(db: sqlite3.Connection, target: Target) -> None:
    """Write the rows of a target in place of its earlier ones."""
    remove_target(db, target.id)
    for layer, row, positions in rows_of_target(target):
        insert(db, layer, row, positions, target.number)
    for click in target.clicks:
        numbers = {key: getattr(click, key) for key in CLICK}
        texts = {"covariance_enu": " ".join(map(repr, map(float, click.covariance_enu)))}
        insert(db, _CLICKS, {"target": target.id} | numbers | texts)


def rows_of_target(target: Target) -> list[tuple[Layer, dict[str, Any], Positions]]:
    """Return the rows of a target and of its ellipse, with their layers and positions."""
    place, cells = target.place, target_cells(target)
    ring = [(longitude, latitude) for latitude, longitude in place.outline()]
    own = {"target": target.id, "number": target.number, "name": cells["name"]}
    at = [(place.longitude_deg, place.latitude_deg)]
    return [(TARGETS, cells, at), (ELLIPSES, own, ring)]


def put_picture(db: sqlite3.Connection, target_id: str, jpeg: bytes) -> None:
    """Write the picture of a target that has none."""
    db.execute("INSERT INTO pictures (target, jpeg) VALUES (?, ?)", (target_id, jpeg))


def remove_target(db: sqlite3.Connection, target_id: str) -> None:
    """Remove the rows of a target; its picture stays."""
    db.execute("DELETE FROM targets WHERE id = ?", (target_id,))
    db.execute("DELETE FROM ellipses WHERE target = ?", (target_id,))
    db.execute("DELETE FROM clicks WHERE target = ?", (target_id,))
    db.execute("UPDATE gpkg_contents SET last_change = strftime('%Y-%m-%dT%H:%M:%fZ', 'now')")


def next_number(db: sqlite3.Connection) -> int:
    """Return a number that no target has or had."""
    highest = (
        "SELECT max(seq, (SELECT coalesce(max(number), 0) FROM targets)) FROM sqlite_sequence "
        "WHERE name = 'targets'"
    )
    row = db.execute(highest).fetchone()
    return 1 + (int(row[0]) if row else 0)


def read_targets(path: PathLike) -> list[Target]:
    """Return the targets of a file, which stays unchanged. Raises TargetError naming it."""
    path = Path(path)
    if first_bytes(path, len(_MAGIC), TargetError) != _MAGIC:
        raise TargetError(f"{path}: not a GeoPackage; give a file of targets from tirgeo (.gpkg)")
    journal = path.with_name(f"{path.name}-journal")  # of a change that a crash cut short
    cut_short = journal.exists() and journal.stat().st_size > 0
    address = f"{path.resolve().as_uri()}?mode={'rw' if cut_short else 'ro'}"
    with explained(path), contextlib.closing(sqlite3.connect(address, _WAIT_S, uri=True)) as db:
        _check_tables(db, path)
        return _load(db, path)


def opened(path: Path) -> tuple[sqlite3.Connection, list[Target]]:
    """Open a file for this process alone, or make it; return it with its targets.

    Raises TargetError if the folder does not exist, or if the file cannot be written, is damaged,
    was made by another program or is open in one.
    """
    if not path.parent.is_dir():
        raise TargetError(f"{path}: there is no such folder; make it, or give another place")
    if path.exists() and not path.is_file():
        raise TargetError(f"{path}: not a file; give another one for the targets")
    with explained(path), contextlib.ExitStack() as stack:
        db = sqlite3.connect(path, _WAIT_S, isolation_level=None, check_same_thread=False)
        stack.callback(db.close)
        # The lock is kept until the file is closed. Each commit is complete in this one file: a
        # copy of it after a crash lacks nothing. A WAL would be a second file.
        for setting in ("locking_mode = EXCLUSIVE", "trusted_schema = OFF", "synchronous = EXTRA"):
            db.execute(f"PRAGMA {setting}")
        if not _is_empty(db):
            _check_tables(db, path)
        db.execute("PRAGMA journal_mode = DELETE")
        with transaction(db):
            if _is_empty(db):
                make_tables(db)
            for name, columns in _PAGE_TABLES.items():  # exported files lack them
                db.execute(f"CREATE TABLE IF NOT EXISTS tirgeo_{name} ({columns})")
            _add_status(db)
            db.execute("UPDATE gpkg_contents SET srs_id = srs_id")  # fails if read-only
        targets = _load(db, path)
        # Otherwise one damaged byte of the journal would make all of it unreadable.
        db.text_factory = partial(str, encoding="utf-8", errors="replace")
        stack.pop_all()
        return db, targets


def _add_status(db: sqlite3.Connection) -> None:
    """Add what a file of an earlier version lacks."""
    for table in _WITH_STATUS:
        if not _has_status(db, table):
            db.execute(f"ALTER TABLE {table} ADD COLUMN status TEXT")
    for statement in _KEEP_STATUS:
        db.execute(statement)


def _has_status(db: sqlite3.Connection, table: str) -> bool:
    return "status" in {name for _, name, *_ in db.execute(f"PRAGMA table_info({table})")}


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """Raise TargetError, naming the file and what to do, for any error of SQLite."""
    try:
        yield
    except sqlite3.Error as error:
        remedies = (text for part, text in _REMEDIES.items() if part in str(error))
        raise TargetError(f"{path}: {next(remedies, _DAMAGED)} ({error})") from None


@contextlib.contextmanager
def transaction(db: sqlite3.Connection) -> Iterator[None]:
    """Commit the changes of the block, or undo all of them if it raises an error."""
    db.execute("BEGIN EXCLUSIVE")
    try:
        yield
        db.execute("COMMIT")
    except BaseException:
        if db.in_transaction:
            db.execute("ROLLBACK")
        raise


def _is_empty(db: sqlite3.Connection) -> bool:
    return not db.execute("SELECT name FROM sqlite_master LIMIT 1").fetchall()


def _check_tables(db: sqlite3.Connection, path: Path) -> None:
    """Raise TargetError for a file that is damaged or that another program made."""
    names = {name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not {"tirgeo_changes", *(layer.name for layer in _LAYERS)} <= names:
        raise TargetError(
            f"{path}: a database that tirgeo did not make; give another file for the targets"
        )
    (fault,) = db.execute("PRAGMA quick_check(1)").fetchone()
    if fault != "ok":
        raise TargetError(f"{path}: {_DAMAGED} ({fault})")


def _load(db: sqlite3.Connection, path: Path) -> list[Target]:
    """Return the targets by number, without rows that another program added without clicks.

    A target that lost its clicks gets one at its place. Names, kinds and notes may have been
    changed in a GIS. Raises TargetError for rows that tirgeo cannot have written.
    """
    clicks: defaultdict[str, list[Located]] = defaultdict(list)
    status = "status" if _has_status(db, "targets") else "NULL"
    own = f"id, number, created_ns, changed_ns, name, target_kind, note, aircraft, {status}"
    targets = []
    try:
        for target_id, *numbers in db.execute(f"SELECT target, {_CLICK} FROM clicks ORDER BY fid"):  # noqa: S608  constants of ours
            clicks[target_id].append(_click(*numbers))
        for row in db.execute(f"SELECT {own}, {_CLICK} FROM targets ORDER BY number"):  # noqa: S608  constants of ours
            places = clicks[row[0]]
            if not places and None not in (*row[:4], *row[9:]):
                places = [_click(*row[9:])]
            if places:
                number, created_ns, changed_ns = (int(str(value)) for value in row[1:4])
                name, kind, note, aircraft = (str(word or "") for word in row[4:8])
                texts = name, kind if kind in KINDS else "other", note, aircraft
                own_values = str(row[0]), number, *texts, created_ns, changed_ns
                targets.append(Target(*own_values, tuple(places), known_status(row[8])))
    except (TargetError, TypeError, ValueError, AttributeError) as error:
        raise TargetError(f"{path}: {_DAMAGED} ({error})") from None
    return targets


def _click(
    stamp_ns: int, latitude: float, longitude: float, height_m: float, numbers: str
) -> Located:
    covariance = tuple(map(float, numbers.split()))
    return Located(stamp_ns, latitude, longitude, height_m, covariance)
