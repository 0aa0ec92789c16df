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
"""Write layers to a GeoPackage (OGC 12-128r18, version 1.3), in WGS84 (EPSG:4326), by SQLite."""

from __future__ import annotations

import contextlib
import sqlite3
import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.files.whole_files import check_place, part_of

_APPLICATION_ID, _VERSION = 0x47504B47, 10300  # "GPKG"
_KINDS, _Z = {"Point": 1, "LineString": 2, "Polygon": 3}, 1000  # in WKB (OGC 06-103r4)
#: A geometry's header: little-endian, no envelope, EPSG:4326.
_HEADER = b"GP" + struct.pack("<BBi", 0, 1, 4326)
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
#: Positions (N, 2): longitude and latitude, deg; (N, 3): and height, m.
Positions = Array | Sequence[Sequence[float]]
#: A row of a layer: its geometry, and values of the layer's columns, None or nan for NULL.
Row = tuple[Positions, Mapping[str, Any]]


class Layer(NamedTuple):
    """Define a layer: its geometry, ``Point``, ``Point Z``, ``LineString Z``, ``Polygon`` or none.

    ``columns`` have types of SQL: TEXT, INTEGER, REAL, BOOLEAN or DATETIME (UTC).
    """

    name: str
    geometry: str
    columns: Mapping[str, str]
    about: str


def make_file(db: sqlite3.Connection) -> None:
    """Make, in an empty file, the tables that will describe its layers."""
    db.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
    db.execute(f"PRAGMA user_version = {_VERSION}")
    for statement in _TABLES.split(";\n")[:-1]:
        db.execute(statement)
    db.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", _SYSTEMS)


def make_layer(db: sqlite3.Connection, layer: Layer) -> None:
    """Make a layer's table."""
    shape, _, z = layer.geometry.partition(" ")
    columns = [f'"{name}" {kind}' for name, kind in layer.columns.items()]
    geometry = [f"geom {shape.upper()}"] if shape else []
    own = ", ".join(["fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL", *geometry, *columns])
    db.execute(f"CREATE TABLE {layer.name} ({own})")
    kind, system = ("features", 4326) if shape else ("attributes", None)
    db.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, srs_id) "
        "VALUES (?, ?, ?, ?, ?)",
        (layer.name, kind, layer.name, layer.about, system),
    )
    if shape:
        place = (layer.name, "geom", shape.upper(), 4326, int(bool(z)), 0)
        db.execute("INSERT INTO gpkg_geometry_columns VALUES (?, ?, ?, ?, ?, ?)", place)


def insert(
    db: sqlite3.Connection,
    layer: Layer,
    row: Mapping[str, Any],
    positions: Positions | None = None,
    fid: int | None = None,
) -> int:
    """Append a row with values of the layer's columns, None or nan for NULL; return its fid.

    A DATETIME may be nanoseconds. A polygon has one ring, which is closed here.
    """
    cells: dict[str, Any] = {"fid": fid}
    if positions is not None:
        cells["geom"] = _HEADER + _wkb(layer.geometry, positions)
    cells |= {name: row[name] for name in layer.columns if name in row}
    for name, kind in layer.columns.items():
        if kind == "DATETIME" and isinstance(cells.get(name), int):
            cells[name] = utc(cells[name])
    names, marks = ", ".join(f'"{name}"' for name in cells), ", ".join("?" * len(cells))
    statement = f"INSERT INTO {layer.name} ({names}) VALUES ({marks})"  # noqa: S608  our own names
    return int(db.execute(statement, list(cells.values())).lastrowid or 0)


def _wkb(geometry: str, positions: Positions) -> bytes:
    """Return a geometry as WKB, little-endian."""
    shape, _, z = geometry.partition(" ")
    points = np.asarray(positions, "<f8")
    if shape == "Polygon" and (points[0] != points[-1]).any():
        points = np.vstack([points, points[:1]])
    kind = _KINDS[shape] + (_Z if z else 0)
    counts = {"Point": b"", "LineString": struct.pack("<I", len(points))}
    count = counts.get(shape, struct.pack("<II", 1, len(points)))
    return struct.pack("<BI", 1, kind) + count + points.tobytes()


def write_layers(path: Path, layers: Iterable[tuple[Layer, Iterable[Row]]]) -> None:
    """Write layers with their rows, in the order in which a GIS lists them.

    The file is complete or absent. Raises ExportError naming the file.
    """
    check_place(path, ExportError)
    part = part_of(path).with_suffix(".gpkg")
    try:
        with contextlib.closing(sqlite3.connect(part, isolation_level=None)) as db:
            # No journal is needed: if writing ends too early, the file is thrown away.
            db.execute("PRAGMA journal_mode = OFF")
            db.execute("PRAGMA synchronous = OFF")
            db.execute("BEGIN")
            make_file(db)
            for layer, rows in layers:
                make_layer(db, layer)
                for positions, row in rows:
                    insert(db, layer, row, positions)
            db.execute("COMMIT")
        part.replace(path)
    except (sqlite3.Error, OSError) as error:
        why = f"{error}; is there room in its folder?"
        raise ExportError(f"{path}: cannot be written: {why}") from None
    finally:
        part.unlink(missing_ok=True)
