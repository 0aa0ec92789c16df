"""Define the GeoPackage of targets (OGC 12-128r18, version 1.3) and the rows of a target in it."""

from __future__ import annotations

import sqlite3
import struct
from collections import defaultdict
from collections.abc import Sequence

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import KINDS, Target
from tirgeo_ros.io.targets.properties import COLUMNS, of_target

APPLICATION_ID, VERSION = 0x47504B47, 10300  # "GPKG"
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
#: What is on, and texts that are still to be chosen from (undo of the change that ``settled`` one
#: opens it again). Older files hold both among the changes.
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
_PUT = (
    f"INSERT INTO targets (fid, geom, {', '.join(COLUMNS)}) "  # noqa: S608  names of our own
    f"VALUES (:number, :geom, {', '.join(f':{name}' for name in COLUMNS)})"
)
_MADE = "id, number, created_ns, changed_ns"
_CLICK = "latitude_deg, longitude_deg, height_m, covariance_enu"


def make_tables(db: sqlite3.Connection) -> None:
    """Make the tables of an empty file, within the caller's transaction."""
    db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    db.execute(f"PRAGMA user_version = {VERSION}")
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


def is_of_targets(db: sqlite3.Connection) -> bool:
    """Return whether the file has all our tables."""
    names = ("clicks", "ellipses", "marks", "pictures", "targets", "tirgeo_changes")
    found = db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
    return set(names) <= {name for (name,) in found}


def renew(db: sqlite3.Connection) -> None:
    """Add what older files and exported ones lack, within the caller's transaction."""
    for statement in _OF_PAGE.split(";\n")[:-1]:
        db.execute(statement)


def put_target(db: sqlite3.Connection, target: Target) -> None:
    """Write the rows of a target in place of those it had."""
    remove_target(db, target.id)
    place = target.place
    geometry = _header() + struct.pack("<BIdd", 1, 1, place.longitude_deg, place.latitude_deg)
    said = of_target(target)
    db.execute(_PUT, said | {"geom": geometry})
    ring = [(longitude, latitude) for latitude, longitude in place.outline()]
    geometry = _header() + struct.pack("<BIII", 1, 3, 1, len(ring))
    geometry += b"".join(struct.pack("<dd", *corner) for corner in ring)
    row = (target.number, geometry, target.id, target.number, said["name"])
    db.execute(
        "INSERT INTO ellipses (fid, geom, target, number, name) VALUES (?, ?, ?, ?, ?)", row
    )
    db.executemany(
        f"INSERT INTO clicks (target, stamp_ns, {_CLICK}) VALUES (?, ?, ?, ?, ?, ?)",  # noqa: S608
        [(target.id, *_click_row(one)) for one in target.clicks],
    )


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


def load_targets(db: sqlite3.Connection) -> list[Target]:
    """Return the targets by number; rows that another program added have no clicks: left out.

    A target whose clicks are gone has one, at its place. Raises TargetError, TypeError or
    ValueError for rows that are none of ours.
    """
    clicks: defaultdict[str, list[Located]] = defaultdict(list)
    rows = db.execute(f"SELECT target, stamp_ns, {_CLICK} FROM clicks ORDER BY fid")  # noqa: S608
    for target_id, *click in rows:
        clicks[target_id].append(_click(*click))
    columns = f"name, target_kind, note, aircraft, {_MADE}, stamp_ns, {_CLICK}"
    targets = []
    for row in db.execute(f"SELECT {columns} FROM targets ORDER BY number"):  # noqa: S608
        own = clicks[row[4]]
        if not own and None not in row[4:]:
            own = [_click(*row[-5:])]
        if own:
            targets.append(_target(row, own))
    return targets


def _click(
    stamp_ns: int, latitude: float, longitude: float, height_m: float, numbers: str
) -> Located:
    return Located(stamp_ns, latitude, longitude, height_m, tuple(map(float, numbers.split())))


def _target(row: Sequence[object], clicks: Sequence[Located]) -> Target:
    """Return a target; names, kinds and notes may be those that a GIS gave it."""
    name, kind, note, aircraft, target_id, number, created_ns, changed_ns, *_ = row
    known = str(kind) if kind in KINDS else "other"
    words = (str(name or ""), known, str(note or ""), str(aircraft or ""))
    times = (int(str(created_ns)), int(str(changed_ns)))
    return Target(str(target_id), int(str(number)), *words, *times, tuple(clicks))


def _click_row(one: Located) -> tuple[object, ...]:
    covariance = " ".join(repr(float(number)) for number in one.covariance_enu)
    place = (one.latitude_deg, one.longitude_deg, one.height_m)
    return int(one.stamp_ns), *map(float, place), covariance


def _header() -> bytes:
    """Return the GeoPackage's header of a geometry: little-endian, no envelope, EPSG:4326."""
    return struct.pack("<2sBBi", b"GP", 0, 1, 4326)
