"""Write layers to a GeoPackage (OGC 12-128r18, version 1.3), in WGS84 (EPSG:4326).

SQLite alone does it: rows are written as they come, and a file of layers gets what a GIS asks for
besides, the spatial index (RTree) and the styles in which QGIS shows it.
"""

from __future__ import annotations

import contextlib
import sqlite3
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.files.whole_files import check_place, part_of

_ROWS = 1000  # of a commit
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
CREATE TABLE gpkg_extensions (table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL,
    definition TEXT NOT NULL, scope TEXT NOT NULL, CONSTRAINT ge_tce
    UNIQUE (table_name, column_name, extension_name));
"""
#: What keeps a layer's index right when a GIS edits the layer (annex F.3), and its extent.
_INDEXED = """
CREATE TRIGGER {index}_insert AFTER INSERT ON {layer}
    WHEN NEW.geom NOTNULL AND NOT ST_IsEmpty(NEW.geom) BEGIN {put}; END;
CREATE TRIGGER {index}_update1 AFTER UPDATE OF geom ON {layer}
    WHEN OLD.fid = NEW.fid AND NEW.geom NOTNULL AND NOT ST_IsEmpty(NEW.geom) BEGIN {put}; END;
CREATE TRIGGER {index}_update2 AFTER UPDATE OF geom ON {layer}
    WHEN OLD.fid = NEW.fid AND (NEW.geom ISNULL OR ST_IsEmpty(NEW.geom))
    BEGIN DELETE FROM {index} WHERE id = OLD.fid; END;
CREATE TRIGGER {index}_update3 AFTER UPDATE ON {layer}
    WHEN OLD.fid != NEW.fid AND NEW.geom NOTNULL AND NOT ST_IsEmpty(NEW.geom)
    BEGIN DELETE FROM {index} WHERE id = OLD.fid; {put}; END;
CREATE TRIGGER {index}_update4 AFTER UPDATE ON {layer}
    WHEN OLD.fid != NEW.fid AND (NEW.geom ISNULL OR ST_IsEmpty(NEW.geom))
    BEGIN DELETE FROM {index} WHERE id IN (OLD.fid, NEW.fid); END;
CREATE TRIGGER {index}_delete AFTER DELETE ON {layer} WHEN OLD.geom NOTNULL
    BEGIN DELETE FROM {index} WHERE id = OLD.fid; END;
INSERT INTO gpkg_extensions VALUES ('{layer}', 'geom', 'gpkg_rtree_index',
    'http://www.geopackage.org/spec120/#extension_rtree', 'write-only');
UPDATE gpkg_contents SET (min_x, max_x, min_y, max_y) = (SELECT min(minx), max(maxx), min(miny),
    max(maxy) FROM {index}) WHERE table_name = '{layer}';
"""
_PUT = (
    "INSERT OR REPLACE INTO {index} VALUES (NEW.fid, ST_MinX(NEW.geom), ST_MaxX(NEW.geom), "
    "ST_MinY(NEW.geom), ST_MaxY(NEW.geom))"
)
_CONTENTS = (
    "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, srs_id) "
    "VALUES (?, ?, ?, ?, ?)"
)
#: Positions (N, 2): longitude and latitude, deg; (N, 3): and height, m.
Positions = Array | Sequence[Sequence[float]]


class Layer(NamedTuple):
    """Define a layer: its geometry, ``Point``, ``Point Z``, ``LineString Z``, ``Polygon`` or none.

    ``columns`` have types of SQL: TEXT, INTEGER, REAL, BOOLEAN or DATETIME (UTC). ``style`` is the
    QML in which QGIS shows it.
    """

    name: str
    geometry: str
    columns: Mapping[str, str]
    about: str
    style: str = ""


_STYLES = Layer(
    "layer_styles",
    "",
    {
        **dict.fromkeys(("f_table_catalog", "f_table_schema", "f_table_name"), "TEXT"),
        **dict.fromkeys(("f_geometry_column", "styleName", "styleQML", "styleSLD"), "TEXT"),
        "useAsDefault": "BOOLEAN",
        **dict.fromkeys(("description", "owner", "ui"), "TEXT"),
        "update_time": "DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now'))",
    },
    "the styles in which QGIS shows the layers",
)


def make_file(db: sqlite3.Connection) -> None:
    """Make the tables of an empty file that describe its layers."""
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
    row = (layer.name, kind, layer.name, layer.about, system)
    db.execute(_CONTENTS, row)
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


class LayerFile:
    """Write layers, the first of them the one that a GIS lists first, with index and styles.

    Under its name the file is complete or absent. ``counts`` has the number of rows by layer.
    Raises ExportError naming the file.
    """

    def __init__(self, path: Path, layers: Iterable[Layer]) -> None:
        check_place(path, ExportError)
        self.path, self._layers = path, {layer.name: layer for layer in layers}
        self._part = part_of(path).with_suffix(".gpkg")
        self.counts = dict.fromkeys(self._layers, 0)
        with self._explained():
            self._db = sqlite3.connect(self._part, isolation_level=None)
            # Whatever ends this too early, the file is thrown away.
            for setting in ("journal_mode = OFF", "synchronous = OFF"):
                self._db.execute(f"PRAGMA {setting}")
            self._db.execute("BEGIN")
            make_file(self._db)
            for layer in self._layers.values():
                make_layer(self._db, layer)
                self._db.execute(
                    f"CREATE VIRTUAL TABLE {_index(layer)} USING rtree(id, minx, maxx, miny, maxy)"
                )

    def add(self, name: str, positions: Positions, row: Mapping[str, Any]) -> None:
        """Append a row to a layer; its values are those of the columns, None or nan for NULL."""
        layer, points = self._layers[name], np.asarray(positions, float)
        (west, south), (east, north) = points[:, :2].min(0).tolist(), points[:, :2].max(0).tolist()
        with self._explained():
            fid = insert(self._db, layer, row, points)
            bounds = (fid, west, east, south, north)
            self._db.execute(f"INSERT INTO {_index(layer)} VALUES (?, ?, ?, ?, ?)", bounds)  # noqa: S608
            self.counts[name] += 1
            if self.counts[name] % _ROWS == 0:
                self._db.execute("COMMIT")
                self._db.execute("BEGIN")

    def finish(self) -> None:
        """Write the styles and what keeps the index, and give the file its name."""
        with self._explained():
            make_layer(self._db, _STYLES)
            for layer in self._layers.values():
                insert(self._db, _STYLES, _style_row(layer))
            self._db.execute("COMMIT")
            for layer in self._layers.values():
                names = {"layer": layer.name, "index": _index(layer)}
                put = _PUT.format_map(names)
                self._db.executescript(_INDEXED.format_map(names | {"put": put}))
            self._db.close()
            self._part.replace(self.path)

    def close(self) -> None:
        """Remove what is not finished."""
        self._db.close()
        self._part.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, OSError) as error:
            why = f"{error}; is there room in its folder?"
            raise ExportError(f"{self.path}: cannot be written: {why}") from None


def _index(layer: Layer) -> str:
    return f"rtree_{layer.name}_geom"


def _style_row(layer: Layer) -> dict[str, object]:
    return {
        **dict.fromkeys(("f_table_catalog", "f_table_schema", "styleSLD", "owner", "ui"), ""),
        "f_table_name": layer.name,
        "f_geometry_column": "geom",
        "styleName": layer.name,
        "styleQML": layer.style,
        "useAsDefault": True,
        "description": layer.about,
    }
