"""Write layers to a GeoPackage, in batches: under its name it is complete or absent."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.files.whole_files import check_place, part_of
from tirgeo_ros.io.geopackage.container import Positions, blob, make_layer, make_package

_ROWS = 1000  # that wait in memory
#: Nobody reads the file before it is complete: it needs no journal.
_QUICKLY = ("journal_mode = OFF", "synchronous = OFF", "cache_size = -8000")
_EXTENSIONS = """
CREATE TABLE gpkg_extensions (table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL,
    definition TEXT NOT NULL, scope TEXT NOT NULL,
    CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name))
"""
_INDEX_OF = "INSERT INTO gpkg_extensions VALUES (?, 'geom', 'gpkg_rtree_index', ?, 'write-only')"
_INDEX_IS = "http://www.geopackage.org/spec120/#extension_rtree"
#: What keeps the spatial index while others edit the file (annex F.3 of the standard): its name,
#: when it acts, and what it does.
_PUT = (
    "INSERT OR REPLACE INTO {index} VALUES (NEW.fid, ST_MinX(NEW.geom), ST_MaxX(NEW.geom), "
    "ST_MinY(NEW.geom), ST_MaxY(NEW.geom))"
)
_DROP = "DELETE FROM {index} WHERE id = OLD.fid"
_THERE, _GONE = (
    "(NEW.geom NOT NULL AND NOT ST_IsEmpty(NEW.geom))",
    "(NEW.geom ISNULL OR ST_IsEmpty(NEW.geom))",
)
_TRIGGERS = {
    "insert": ("INSERT", _THERE, _PUT),
    "update1": ("UPDATE OF geom", f"OLD.fid = NEW.fid AND {_THERE}", _PUT),
    "update2": ("UPDATE OF geom", f"OLD.fid = NEW.fid AND {_GONE}", _DROP),
    "update3": ("UPDATE", f"OLD.fid != NEW.fid AND {_THERE}", f"{_DROP}; {_PUT}"),
    "update4": ("UPDATE", f"OLD.fid != NEW.fid AND {_GONE}", f"{_DROP} OR id = NEW.fid"),
    "delete": ("DELETE", "OLD.geom NOT NULL", _DROP),
}
_BOUNDS = """
UPDATE gpkg_contents SET (min_x, max_x, min_y, max_y) =
    (SELECT min(minx), max(maxx), min(miny), max(maxy) FROM {index}) WHERE table_name = ?
"""
#: The table in which QGIS looks for the style of a layer that it opens.
_STYLES = {
    **dict.fromkeys(("f_table_catalog", "f_table_schema", "f_table_name"), "TEXT(256)"),
    "f_geometry_column": "TEXT(256)",
    "styleName": "TEXT(30)",
    "styleQML": "TEXT",
    "styleSLD": "TEXT",
    "useAsDefault": "BOOLEAN",
    "description": "TEXT",
    "owner": "TEXT(30)",
    "ui": "TEXT(30)",
    "update_time": "DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now'))",
}
_STYLE = (
    "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, "
    "styleName, styleQML, styleSLD, useAsDefault, description, owner, ui) "
    "VALUES ('', '', :name, 'geom', :name, :style, '', 1, :about, '', '')"
)


class Layer(NamedTuple):
    """Define a layer: its geometry, ``Point``, ``Point Z``, ``LineString Z`` or ``Polygon``.

    ``columns`` have types of SQL: TEXT, INTEGER, REAL, BOOLEAN or DATETIME (UTC). ``style`` is the
    QML in which QGIS shows it.
    """

    name: str
    geometry: str
    columns: Mapping[str, str]
    about: str
    style: str

    @property
    def rtree(self) -> str:
        """Return the name of its spatial index."""
        return f'"rtree_{self.name}_geom"'


class LayerFile:
    """Write layers in WGS84 (EPSG:4326), the first of them the one that a GIS lists first.

    ``counts`` has the number of rows by layer. Raises ExportError naming the file.
    """

    def __init__(self, path: Path, layers: Iterable[Layer]) -> None:
        check_place(path, ExportError)
        self.path, self._layers = path, {layer.name: layer for layer in layers}
        self._part = part_of(path).with_suffix(".gpkg")
        self.counts = dict.fromkeys(self._layers, 0)
        self._waiting: dict[str, list[tuple[Any, ...]]] = {name: [] for name in self._layers}
        with self._writing():
            self._part.unlink(missing_ok=True)
            self._db = sqlite3.connect(self._part, isolation_level=None)
            for pragma in _QUICKLY:
                self._db.execute(f"PRAGMA {pragma}")
            make_package(self._db)
            self._db.execute(_EXTENSIONS)
            for layer in self._layers.values():
                make_layer(self._db, layer.name, layer.geometry, layer.columns, layer.about)
                self._db.execute(
                    f"CREATE VIRTUAL TABLE {layer.rtree} USING rtree(id, minx, maxx, miny, maxy)"
                )
                self._db.execute(_INDEX_OF, (layer.name, _INDEX_IS))

    def add(self, name: str, positions: Positions, row: Mapping[str, Any]) -> None:
        """Append a row to a layer; its values are those of the columns, None or nan for NULL."""
        layer, rows = self._layers[name], self._waiting[name]
        self.counts[name] += 1
        points = np.asarray(positions, float)
        (west, south), (east, north) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        box = float(west), float(east), float(south), float(north)
        cells = [_cell(row[column], kind) for column, kind in layer.columns.items()]
        rows.append((self.counts[name], *box, blob(layer.geometry, points), *cells))
        if len(rows) >= _ROWS:
            with self._writing():
                self._write(layer)

    def finish(self) -> None:
        """Write what waits, the styles and what keeps the index, and give the file its name."""
        with self._writing():
            make_layer(self._db, "layer_styles", "", _STYLES, "")
            for layer in self._layers.values():
                self._write(layer)
                self._db.execute(_STYLE, layer._asdict())
                self._db.execute(_BOUNDS.format(index=layer.rtree), (layer.name,))
                for name, (event, condition, action) in _TRIGGERS.items():
                    self._db.execute(
                        f'CREATE TRIGGER "rtree_{layer.name}_geom_{name}" AFTER {event} ON '
                        f'"{layer.name}" WHEN {condition} '
                        f"BEGIN {action.format(index=layer.rtree)}; END"
                    )
            self._db.close()
            self._part.replace(self.path)

    def close(self) -> None:
        """Remove what is not finished."""
        self._db.close()
        self._part.unlink(missing_ok=True)

    def _write(self, layer: Layer) -> None:
        """Write the rows of a layer that wait."""
        rows, self._waiting[layer.name] = self._waiting[layer.name], []
        columns = ", ".join(("fid", "geom", *(f'"{column}"' for column in layer.columns)))
        places = ", ".join("?" * (len(layer.columns) + 2))
        self._db.execute("BEGIN")
        self._db.executemany(
            f'INSERT INTO "{layer.name}" ({columns}) VALUES ({places})',  # noqa: S608  our names
            [(row[0], *row[5:]) for row in rows],
        )
        self._db.executemany(
            f"INSERT INTO {layer.rtree} VALUES (?, ?, ?, ?, ?)",  # noqa: S608
            [row[:5] for row in rows],
        )
        self._db.execute("COMMIT")

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, OSError) as error:
            why = " ".join(str(error).split())
            raise ExportError(
                f"{self.path}: cannot be written: {why}; is there room in its folder?"
            ) from None


def _cell(cell: Any, kind: str) -> Any:
    """Return a value as SQLite takes it; DATETIME is from nanoseconds, rounded down."""
    if cell is None:
        return None
    if kind == "DATETIME":
        return utc(int(cell))
    if kind in {"BOOLEAN", "INTEGER"}:
        return int(cell)
    return float(cell) if kind == "REAL" else cell
