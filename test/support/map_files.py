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
"""Map files made for tests, by code that shares nothing with the readers."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing

import numpy as np
import pytest

RING = [(16.0, 48.0), (16.001, 48.0), (16.001, 48.001), (16.0, 48.0)]
HOLE = [(16.0003, 48.0003), (16.0006, 48.0003), (16.0006, 48.0006), (16.0003, 48.0003)]

WKB_TYPES = {
    "Point": 1,
    "LineString": 2,
    "Polygon": 3,
    "MultiPoint": 4,
    "MultiLineString": 5,
    "MultiPolygon": 6,
    "GeometryCollection": 7,
}
_SINGLE = {"MultiPoint": "Point", "MultiLineString": "LineString", "MultiPolygon": "Polygon"}


def wkb(kind, coordinates, dims=""):
    """A geometry as WKB; ``dims`` is "" or "Z", and coordinates have as many more."""
    head = struct.pack("<BI", 1, WKB_TYPES[kind] + (1000 if dims else 0))

    def counted(items):
        return struct.pack("<I", len(items)) + b"".join(items)

    def numbers(position):
        return struct.pack(f"<{len(position)}d", *position)

    if kind == "Point":
        return head + numbers(coordinates)
    if kind == "LineString":
        return head + counted([numbers(point) for point in coordinates])
    if kind == "Polygon":
        return head + counted([counted([numbers(p) for p in ring]) for ring in coordinates])
    if kind == "GeometryCollection":
        return head + counted([wkb(k, c, dims) for k, c in coordinates])
    return head + counted([wkb(_SINGLE[kind], c, dims) for c in coordinates])


def gpb(body, srs_id=4326):
    """A geometry in GeoPackage's frame."""
    return struct.pack("<2sBBi", b"GP", 0, 1, srs_id) + body


SYSTEMS = {
    -1: ("NONE", -1, "undefined"),
    0: ("NONE", 0, "undefined"),
    4326: ("EPSG", 4326, "GEOGCS[...]"),
    32633: ("EPSG", 32633, "PROJCS[...]"),
}


def write_geopackage(path, tables, journal="delete"):
    """``tables``: name -> (srs_id, [(geometry blob or None, name, ref)]); left closed."""
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as database:
        fill_geopackage(database, tables, journal)


def fill_geopackage(database, tables, journal="delete"):
    database.execute(f"PRAGMA journal_mode = {journal}")
    database.executescript(
        """
        PRAGMA application_id = 0x47504B47;
        PRAGMA user_version = 10200;
        CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT, srs_id INTEGER PRIMARY KEY,
            organization TEXT, organization_coordsys_id INTEGER, definition TEXT);
        CREATE TABLE gpkg_contents (table_name TEXT PRIMARY KEY, data_type TEXT, identifier TEXT,
            description TEXT DEFAULT '', last_change TEXT DEFAULT '2026-01-01T00:00:00.000Z',
            min_x REAL, min_y REAL, max_x REAL, max_y REAL, srs_id INTEGER);
        CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT,
            geometry_type_name TEXT, srs_id INTEGER, z INTEGER, m INTEGER);
        """
    )
    for srs_id, system in SYSTEMS.items():
        database.execute(
            "INSERT INTO gpkg_spatial_ref_sys VALUES ('', ?, ?, ?, ?)", (srs_id, *system)
        )
    for name, (srs_id, rows) in tables.items():
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id)"
            " VALUES (?, 'features', ?, ?)",
            (name, name, srs_id),
        )
        database.execute(
            "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'GEOMETRY', ?, 2, 2)",
            (name, srs_id),
        )
        quoted = name.replace('"', '""')
        database.execute(
            f'CREATE TABLE "{quoted}" (fid INTEGER PRIMARY KEY, geom BLOB, name TEXT, ref INTEGER)'
        )
        database.executemany(f'INSERT INTO "{quoted}" VALUES (NULL, ?, ?, ?)', rows)
    database.commit()


WGS84_PRJ = (
    'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]'
)
UTM33_PRJ = (
    f'PROJCS["WGS_1984_UTM_Zone_33N",{WGS84_PRJ},PROJECTION["Transverse_Mercator"],'
    'PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],'
    'PARAMETER["Central_Meridian",15.0],PARAMETER["Scale_Factor",0.9996],'
    'PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]'
)


def write_shapefile(path, shapes, names=(), prj=WGS84_PRJ, encoding="utf-8"):
    """Lines of positions, or None; labels of 40 letters in an encoding that no file names."""
    deep = any(len(point) == 3 for shape in shapes if shape for point in shape)
    given = [*names, *(f"n{number}" for number in range(len(names), len(shapes)))]
    texts = [name.encode(encoding).decode("latin-1") for name in given]
    # A quick test calls this, and ROS's build farm has no pyogrio.
    pytest.importorskip("pyogrio").raw.write(
        path,
        np.array(
            [shape and wkb("LineString", shape, dims="Z" if deep else "") for shape in shapes],
            object,
        ),
        [np.array(texts, object), np.arange(len(shapes), dtype=float)],
        ["NAME", "REF"],
        geometry_type="LineString Z" if deep else "LineString",
        crs="EPSG:4326",
        driver="ESRI Shapefile",
        encoding="ISO-8859-1",
    )
    for suffix in (".cpg", ".prj"):
        path.with_suffix(suffix).unlink(missing_ok=True)
    if prj is not None:
        path.with_suffix(".prj").write_text(prj)
    return path
