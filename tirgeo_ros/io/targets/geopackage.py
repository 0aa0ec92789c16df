"""Open, check and fill the GeoPackage of targets (OGC 12-128r18, version 1.3).

A store opens it for its process alone, and explains what is wrong with a file.
"""

from __future__ import annotations

import contextlib
import sqlite3
import struct
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import KINDS, Target
from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets.columns import COLUMNS, of_target

_WAIT_S = 2.0  # for a program that is just ending
#: A part of SQLite's message -> what to do.
_REMEDIES = {
    "locked": "another program has it open (a second viewer_node, QGIS): close that, or give the "
    "targets another file",
    "full": "no room on the disk: make some and do it again; what was there before is kept",
    "readonly": "it is read-only: choose a place that can be written",
    "unable to open": "its folder cannot be written: choose another place",
    "disk I/O": "the disk fails: what was there before is kept; choose another disk",
    "not a database": "it is no GeoPackage; give the targets another name",
}
_DAMAGED = (
    "it is damaged and was left as it is: move it away to begin a new one; the command "
    "'sqlite3 FILE .recover' gets back what it still holds"
)
_APPLICATION_ID, _VERSION = 0x47504B47, 10300  # "GPKG"
_WGS84 = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG",'
    '"7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT['
    '"degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]'
)
_SYSTEMS = (
    ("WGS 84", 4326, "EPSG", 4326, _WGS84, "longitude, latitude"),
    ("Undefined cartesian", -1, "NONE", -1, "undefined", None),
    ("Undefined geographic", 0, "NONE", 0, "undefined", None),
)
#: Table -> type of its geometry (None: no geometry), what it holds.
_LAYERS = {
    "targets": ("POINT", "places, each the average of its clicks"),
    "ellipses": ("POLYGON", "95 % ellipses of the places"),
    "clicks": (None, "every click; these count, the other two tables are made of them"),
    "pictures": (None, "cut-outs of the video, JPEG"),
    "marks": (None, "marks in time"),
}
_TABLES = f"""
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY,
    organization TEXT NOT NULL, organization_coordsys_id INTEGER NOT NULL,
    definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL,
    identifier TEXT UNIQUE, description TEXT DEFAULT '', last_change DATETIME NOT NULL
    DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')), min_x DOUBLE, min_y DOUBLE, max_x DOUBLE,
    max_y DOUBLE, srs_id INTEGER, CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id)
    REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL,
    geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL,
    m TINYINT NOT NULL, CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
    CONSTRAINT uk_gc_table_name UNIQUE (table_name), CONSTRAINT fk_gc_tn FOREIGN KEY (table_name)
    REFERENCES gpkg_contents(table_name), CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id)
    REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE targets (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POINT,
    {", ".join(f"{name} {kind}" for name, kind in COLUMNS.items())});
CREATE TABLE ellipses (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POLYGON,
    target TEXT NOT NULL, number INTEGER, name TEXT);
CREATE TABLE clicks (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, target TEXT NOT NULL,
    stamp_ns INTEGER NOT NULL, latitude_deg REAL NOT NULL, longitude_deg REAL NOT NULL,
    height_m REAL NOT NULL, covariance_enu TEXT NOT NULL);
CREATE TABLE pictures (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
    target TEXT NOT NULL UNIQUE, jpeg BLOB NOT NULL);
CREATE TABLE marks (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, stamp_ns INTEGER NOT NULL,
    time DATETIME NOT NULL, text TEXT NOT NULL);
CREATE TABLE tirgeo_changes (revision INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, at_ns INTEGER,
    action TEXT NOT NULL, target TEXT NOT NULL, before TEXT, undone INTEGER NOT NULL);
CREATE INDEX clicks_of_target ON clicks (target);
"""
#: Texts that are still to be chosen from (undo of the change that ``settled`` one opens it again),
#: and what is switched on. Older files hold both among the changes, by negative numbers.
_OF_PAGE = """
CREATE TABLE IF NOT EXISTS tirgeo_alternatives (target TEXT NOT NULL, field TEXT NOT NULL,
    text TEXT NOT NULL, settled INTEGER);
CREATE TABLE IF NOT EXISTS tirgeo_switches (what TEXT NOT NULL PRIMARY KEY);
INSERT OR IGNORE INTO tirgeo_alternatives SELECT target, json_extract(before, '$[0]'),
    json_extract(before, '$[1]'), nullif(undone, -1) FROM tirgeo_changes
    WHERE action = 'alternative' AND json_valid(before);
INSERT OR IGNORE INTO tirgeo_switches SELECT target FROM tirgeo_changes WHERE undone = -2;
UPDATE tirgeo_changes SET before = NULL, undone = 1 WHERE action IN ('alternative', 'on');
"""
#: A geometry's header in a GeoPackage: little-endian, no envelope, EPSG:4326.
_HEADER = b"GP" + struct.pack("<BBi", 0, 1, 4326)
_PUT = (
    f"INSERT INTO targets (fid, geom, {', '.join(COLUMNS)}) "  # noqa: S608  names of our own
    f"VALUES (:number, :geom, {', '.join(f':{name}' for name in COLUMNS)})"
)
_CLICK = "latitude_deg, longitude_deg, height_m, covariance_enu"


def make_tables(db: sqlite3.Connection) -> None:
    """Make the tables of an empty file, within the caller's transaction."""
    db.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
    db.execute(f"PRAGMA user_version = {_VERSION}")
    for statement in _TABLES.split(";\n")[:-1]:
        db.execute(statement)
    db.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", _SYSTEMS)
    contents = "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, srs_id)"
    for name, (shape, text) in _LAYERS.items():
        kind, system = ("features", 4326) if shape else ("attributes", None)
        db.execute(f"{contents} VALUES (?, ?, ?, ?, ?)", (name, kind, name, text, system))
        if shape:
            row = (name, "geom", shape, 4326, 0, 0)
            db.execute("INSERT INTO gpkg_geometry_columns VALUES (?, ?, ?, ?, ?, ?)", row)


def put_target(db: sqlite3.Connection, target: Target) -> None:
    """Write the rows of a target in place of those it had."""
    remove_target(db, target.id)
    place = target.place
    geometry = _HEADER + struct.pack("<BIdd", 1, 1, place.longitude_deg, place.latitude_deg)
    cells = of_target(target)
    db.execute(_PUT, cells | {"geom": geometry})
    ring = [(longitude, latitude) for latitude, longitude in place.outline()]
    geometry = _HEADER + struct.pack("<BIII", 1, 3, 1, len(ring))
    geometry += b"".join(struct.pack("<dd", *corner) for corner in ring)
    row = (target.number, geometry, target.id, target.number, cells["name"])
    db.execute(
        "INSERT INTO ellipses (fid, geom, target, number, name) VALUES (?, ?, ?, ?, ?)", row
    )
    db.executemany(
        f"INSERT INTO clicks (target, stamp_ns, {_CLICK}) VALUES (?, ?, ?, ?, ?, ?)",  # noqa: S608
        [(target.id, *_click_row(click)) for click in target.clicks],
    )


def _click_row(click: Located) -> tuple[object, ...]:
    covariance = " ".join(repr(float(number)) for number in click.covariance_enu)
    place = click.latitude_deg, click.longitude_deg, click.height_m
    return int(click.stamp_ns), *map(float, place), covariance


def put_picture(db: sqlite3.Connection, target_id: str, jpeg: bytes) -> None:
    """Write the picture of a target that has none."""
    db.execute("INSERT INTO pictures (target, jpeg) VALUES (?, ?)", (target_id, jpeg))


def remove_target(db: sqlite3.Connection, target_id: str) -> None:
    """Remove the rows of a target, but for its picture."""
    for statement in (
        "DELETE FROM targets WHERE id = ?",
        "DELETE FROM ellipses WHERE target = ?",
        "DELETE FROM clicks WHERE target = ?",
    ):
        db.execute(statement, (target_id,))
    db.execute("UPDATE gpkg_contents SET last_change = strftime('%Y-%m-%dT%H:%M:%fZ', 'now')")


def next_number(db: sqlite3.Connection) -> int:
    """Return a number that no target has or had."""
    highest = (
        "SELECT max(seq, (SELECT coalesce(max(number), 0) FROM targets)) FROM sqlite_sequence "
        "WHERE name = 'targets'"
    )
    row = db.execute(highest).fetchone()
    return 1 + (int(row[0]) if row else 0)


def read_file(path: Path) -> list[Target]:
    """Return the targets of a file, read without a change. Raises TargetError."""
    journal = path.with_name(f"{path.name}-journal")  # of a change that a crash cut short
    cut_short = journal.exists() and journal.stat().st_size > 0
    address = f"{path.resolve().as_uri()}?mode={'rw' if cut_short else 'ro'}"
    with explained(path), contextlib.closing(sqlite3.connect(address, _WAIT_S, uri=True)) as db:
        _check_tables(db, path)
        return _load(db, path)


def opened(path: Path) -> tuple[sqlite3.Connection, list[Target]]:
    """Open a file for this process alone, or make it; return it with its targets.

    Raises TargetError for a folder that does not exist, a file that cannot be written, is
    damaged, of another program or open in one.
    """
    if not path.parent.is_dir():
        raise TargetError(f"{path}: there is no such folder; make it, or give another place")
    if path.exists() and not path.is_file():
        raise TargetError(f"{path}: not a file; give the targets another name")
    with explained(path), contextlib.ExitStack() as stack:
        db = sqlite3.connect(path, _WAIT_S, isolation_level=None, check_same_thread=False)
        stack.callback(db.close)
        # The lock is kept until the file is closed. Each commit is complete in the one file, so
        # that a copy of it after a crash lacks nothing; a WAL would be a second file.
        for setting in ("locking_mode = EXCLUSIVE", "trusted_schema = OFF", "synchronous = EXTRA"):
            db.execute(f"PRAGMA {setting}")
        if not _is_empty(db):
            _check_tables(db, path)
        db.execute("PRAGMA journal_mode = DELETE")
        with transaction(db):
            if _is_empty(db):
                make_tables(db)
            for statement in _OF_PAGE.split(";\n")[:-1]:  # older files and exported ones lack them
                db.execute(statement)
            db.execute("UPDATE gpkg_contents SET srs_id = srs_id")  # can the file be written?
        targets = _load(db, path)
        db.text_factory = partial(str, encoding="utf-8", errors="replace")  # else one byte of the
        stack.pop_all()  # journal would keep all of it from being read
        return db, targets


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """Raise TargetError, naming the file and what to do, for what SQLite raises."""
    try:
        yield
    except sqlite3.Error as error:
        remedies = (text for part, text in _REMEDIES.items() if part in str(error))
        raise TargetError(f"{path}: {next(remedies, _DAMAGED)} ({error})") from None


@contextlib.contextmanager
def transaction(db: sqlite3.Connection) -> Iterator[None]:
    """Commit what is done within, or undo all of it if something is raised."""
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
    """Refuse a file that is damaged, or that another program made; neither is written to."""
    names = {name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not {*_LAYERS, "tirgeo_changes"} <= names:
        raise TargetError(
            f"{path}: a database that tirgeo did not make; give the targets another name"
        )
    (fault,) = db.execute("PRAGMA quick_check(1)").fetchone()
    if fault != "ok":
        raise TargetError(f"{path}: {_DAMAGED} ({fault})")


def _load(db: sqlite3.Connection, path: Path) -> list[Target]:
    """Return the targets by number. Raises TargetError for rows that are none of ours."""
    try:
        return _targets(db)
    except (TargetError, TypeError, ValueError, AttributeError) as error:
        raise TargetError(f"{path}: {_DAMAGED} ({error})") from None


def _targets(db: sqlite3.Connection) -> list[Target]:
    """Return the targets by number; rows that another program added have no clicks: left out.

    A target whose clicks are gone has one, at its place.
    """
    clicks: defaultdict[str, list[Located]] = defaultdict(list)
    rows = db.execute(f"SELECT target, stamp_ns, {_CLICK} FROM clicks ORDER BY fid")  # noqa: S608
    for target_id, *numbers in rows:
        clicks[target_id].append(_click(*numbers))
    made = "id, number, created_ns, changed_ns"
    columns = f"{made}, name, target_kind, note, aircraft, stamp_ns, {_CLICK}"
    targets = []
    for row in db.execute(f"SELECT {columns} FROM targets ORDER BY number"):  # noqa: S608
        own, words, place = row[:4], row[4:8], row[8:]
        places = clicks[row[0]]
        if not places and None not in (*own, *place):
            places = [_click(*place)]
        if places:
            targets.append(_target(own, words, places))
    return targets


def _click(
    stamp_ns: int, latitude: float, longitude: float, height_m: float, numbers: str
) -> Located:
    covariance = tuple(map(float, numbers.split()))
    return Located(stamp_ns, latitude, longitude, height_m, covariance)


def _target(own: Sequence[object], words: Sequence[object], clicks: Sequence[Located]) -> Target:
    """Return a target; names, kinds and notes may be those that a GIS gave it."""
    number, created_ns, changed_ns = (int(str(value)) for value in own[1:])
    name, kind, note, aircraft = (str(word or "") for word in words)
    kind = kind if kind in KINDS else "other"
    texts = (name, kind, note, aircraft)
    return Target(str(own[0]), number, *texts, created_ns, changed_ns, tuple(clicks))
