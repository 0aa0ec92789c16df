"""Make GeoPackages (OGC 12-128r18, version 1.3) with SQLite: tables, layers and geometries."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Mapping, Sequence

import numpy as np

from tirgeo_ros.core.types.arrays import Array

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
_TABLES = """
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
"""
#: A geometry's header: little-endian, no envelope, EPSG:4326.
_HEADER = b"GP" + struct.pack("<BBi", 0, 1, 4326)
_KINDS, _Z = {"Point": 1, "LineString": 2, "Polygon": 3}, 1000  # in WKB (OGC 06-103r4)
#: Positions (N, 2): longitude and latitude, deg; (N, 3): and height, m.
Positions = Array | Sequence[Sequence[float]]


def make_package(db: sqlite3.Connection) -> None:
    """Make the tables that every GeoPackage has, in an empty file."""
    db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    db.execute(f"PRAGMA user_version = {VERSION}")
    for statement in _TABLES.split(";\n")[:-1]:
        db.execute(statement)
    db.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", _SYSTEMS)


def make_layer(
    db: sqlite3.Connection, name: str, geometry: str, columns: Mapping[str, str], about: str
) -> None:
    """Make a table of places in WGS84 (``Point``, ``LineString Z``), or of none (``""``).

    ``columns`` have types of SQL; the first column is the key ``fid``.
    """
    shape, _, z = geometry.partition(" ")
    typed = [f'"{column}" {kind}' for column, kind in columns.items()]
    place = [f"geom {shape.upper()}"] if shape else []
    key = "fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL"
    db.execute(f'CREATE TABLE "{name}" ({", ".join([key, *place, *typed])})')
    kind, system = ("features", 4326) if shape else ("attributes", None)
    db.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, srs_id) "
        "VALUES (?, ?, ?, ?, ?)",
        (name, kind, name, about, system),
    )
    if shape:
        row = (name, "geom", shape.upper(), 4326, int(z == "Z"), 0)
        db.execute("INSERT INTO gpkg_geometry_columns VALUES (?, ?, ?, ?, ?, ?)", row)


def blob(geometry: str, positions: Positions) -> bytes:
    """Return a geometry as a GeoPackage has it; a polygon has one ring, which is closed here."""
    shape, _, z = geometry.partition(" ")
    points = np.asarray(positions, "<f8")
    if shape == "Polygon":
        points = np.vstack([points, points[:1]])
    kind = _KINDS[shape] + (_Z if z else 0)
    counts = {"Point": b"", "LineString": struct.pack("<I", len(points))}
    count = counts.get(shape, struct.pack("<II", 1, len(points)))
    return _HEADER + struct.pack("<BI", 1, kind) + count + points.tobytes()
