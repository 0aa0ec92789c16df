"""Write layers to a GeoPackage by GDAL, in batches: under its name it is complete or absent.

GDAL makes the spatial index (RTree) and all tables that the standard asks for.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.io.files.missing_package import missing_line
from tirgeo_ros.io.files.whole_files import check_place, part_of

_ROWS = 1000  # that wait in memory
_UTC = 100  # GDAL's number for it
_KINDS, _Z = {"Point": 1, "LineString": 2, "Polygon": 3}, 1000  # in WKB (OGC 06-103r4)
#: Positions (N, 2): longitude and latitude, deg; (N, 3): and height, m.
Positions = Array | Sequence[Sequence[float]]
_DTYPES = {"INTEGER": "i8", "BOOLEAN": "?"}


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


@dataclass
class _Rows:
    """Hold rows that wait: their geometries (WKB), and their cells in the columns' order."""

    shapes: list[bytes] = field(default_factory=list)
    cells: list[Sequence[Any]] = field(default_factory=list)


class LayerFile:
    """Write layers in WGS84 (EPSG:4326), the first of them the one that a GIS lists first.

    ``counts`` has the number of rows by layer. Raises ExportError naming the file.
    """

    def __init__(self, path: Path, layers: Iterable[Layer]) -> None:
        check_place(path, ExportError)
        self.path, self._layers = path, {layer.name: layer for layer in layers}
        self._part = part_of(path).with_suffix(".gpkg")
        self.counts = dict.fromkeys(self._layers, 0)
        self._waiting = {name: _Rows() for name in self._layers}
        self._made: set[str] = set()
        for name in self._layers:
            self._write(name)

    def add(self, name: str, positions: Positions, row: Mapping[str, Any]) -> None:
        """Append a row to a layer; its values are those of the columns, None or nan for NULL."""
        layer, rows = self._layers[name], self._waiting[name]
        rows.shapes.append(_wkb(layer.geometry, positions))
        rows.cells.append([row[column] for column in layer.columns])
        self.counts[name] += 1
        if len(rows.shapes) >= _ROWS:
            self._write(name)

    def finish(self) -> None:
        """Write what waits and the styles, and give the file its name."""
        for name, rows in self._waiting.items():
            if rows.shapes:
                self._write(name)
        self._write_styles()
        try:
            self._part.replace(self.path)
        except OSError as error:
            raise self._error(error) from None

    def close(self) -> None:
        """Remove what is not finished."""
        self._part.unlink(missing_ok=True)

    def _write(self, name: str) -> None:
        """Write the rows of a layer that wait; make it if it is new."""
        layer, rows = self._layers[name], self._waiting[name]
        columns = [
            _column([cells[k] for cells in rows.cells], kind)
            for k, kind in enumerate(layer.columns.values())
        ]
        times = [column for column, kind in layer.columns.items() if kind == "DATETIME"]
        self._to_gdal(
            layer.name,
            np.array(rows.shapes, "O"),
            columns,
            list(layer.columns),
            geometry_type=layer.geometry,
            crs="EPSG:4326",
            gdal_tz_offsets={column: np.full(len(rows.shapes), _UTC) for column in times},
            layer_options={"DESCRIPTION": layer.about},
        )
        self._waiting[name] = _Rows()

    def _write_styles(self) -> None:
        """Write the table in which QGIS looks for the style of a layer that it opens."""
        rows = [
            {
                **dict.fromkeys(("f_table_catalog", "f_table_schema"), ""),
                "f_table_name": layer.name,
                "f_geometry_column": "geom",
                "styleName": layer.name,
                "styleQML": layer.style,
                "description": layer.about,
                **dict.fromkeys(("styleSLD", "owner", "ui"), ""),
            }
            for layer in self._layers.values()
        ]
        texts = {name: np.array([row[name] for row in rows], "O") for name in rows[0]}
        columns = texts | {
            "useAsDefault": np.ones(len(rows), np.bool_),
            "update_time": np.full(len(rows), np.datetime64("now", "ms")),
        }
        times = {"update_time": np.full(len(rows), _UTC)}
        self._to_gdal(
            "layer_styles", None, list(columns.values()), list(columns), gdal_tz_offsets=times
        )

    def _to_gdal(
        self,
        name: str,
        shapes: NDArray[Any] | None,
        columns: Sequence[NDArray[Any]],
        names: Sequence[str],
        **options: Any,
    ) -> None:
        try:
            from pyogrio import raw  # noqa: PLC0415  heavy
        except ImportError:
            raise ExportError(f"{self.path}: {missing_line('pyogrio')}") from None
        table = (self._part, shapes, columns, names)
        append = name in self._made
        try:
            raw.write(*table, layer=name, driver="GPKG", append=append, **options)
        except (RuntimeError, OSError) as error:  # pyogrio's own are RuntimeErrors
            raise self._error(error) from None
        self._made.add(name)

    def _error(self, error: Exception) -> ExportError:
        why = " ".join(str(error).split())
        return ExportError(f"{self.path}: cannot be written: {why}; is there room in its folder?")


def _column(cells: Sequence[Any], kind: str) -> NDArray[Any]:
    """Return a column as GDAL takes it; DATETIME is from nanoseconds, rounded down."""
    if kind == "DATETIME":
        return np.array([cell // 1_000_000 for cell in cells], "datetime64[ms]")
    if kind == "REAL":
        return np.array([np.nan if cell is None else cell for cell in cells], float)
    return np.array(cells, _DTYPES.get(kind.partition(" ")[0], "O"))


def _wkb(geometry: str, positions: Positions) -> bytes:
    """Return a geometry as WKB, little-endian; a polygon has one ring, which is closed here."""
    shape, _, z = geometry.partition(" ")
    points = np.asarray(positions, "<f8")
    if shape == "Polygon":
        points = np.vstack([points, points[:1]])
    kind = _KINDS[shape] + (_Z if z else 0)
    counts = {"Point": b"", "LineString": struct.pack("<I", len(points))}
    count = counts.get(shape, struct.pack("<II", 1, len(points)))
    return struct.pack("<BI", 1, kind) + count + points.tobytes()
