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
"""Read the layers of a map file into tables of shapes and properties, by GDAL but for GeoJSON.

GDAL reads GeoPackage, Shapefile, KML and dozens more. It limits neither its time nor its memory:
call this module only in the process of ``map_process``.
"""

from __future__ import annotations

import itertools
import re
import struct
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.files.bounded_reading import bounded_time, elsewhere
from tirgeo_ros.io.maps.geojson import geojson_table
from tirgeo_ros.io.maps.style_sheet import Wanted
from tirgeo_ros.io.maps.tables import (
    Part,
    Table,
    check_layer,
    check_number,
    shapes_of,
    wanted_columns,
)

#: GDAL's warnings of geometries that it leaves out; most others concern the file's format.
_LOST = re.compile(r"NULL geometry|coord")
_MOST_WARNINGS = 3
_MEMORY = re.compile(r"out of memory|alloc", re.IGNORECASE)
#: Possible names of a table's coordinate columns (GDAL's options for CSV).
_COLUMNS = {
    "X_POSSIBLE_NAMES": "lon,lng,long,longitude,lon_*,longitude_*,x,easting",
    "Y_POSSIBLE_NAMES": "lat,latitude,lat_*,latitude_*,y,northing",
    "GEOM_POSSIBLE_NAMES": "wkt,geom,geometry,the_geom,shape",
}
_CSV = (".csv", ".tsv", ".txt")
_KML = (".kml", ".kmz")
#: Elements of a KML with positions: commas, in gx:coord blanks, separate the numbers.
_POSITIONS = re.compile(rb"<(?:\w+:)?coord(inates)?(?:\s[^<>]*)?(?<!/)>([^<]*)")
_NUMBER = rb"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_POSITION = re.compile(rb"N,N(?:,N?)?".replace(b"N", _NUMBER))
_COMMENT = re.compile(rb"<!--.*?-->|<!\[CDATA\[|\]\]>", re.DOTALL)
#: The beginning of a line in GeoJSON of one feature a line: GDAL skips damaged lines silently.
_JSON_LINE = re.compile(rb"^\x1e?\{", re.MULTILINE)
#: Endings of the maps that are looked for in a zip.
_ZIPPED = (".shp", ".gpkg", ".geojson", ".json", ".kml", ".gml")

#: Types of well-known binary (OGC 06-103r4, ISO 13249-3). Collections: multi-point, multi-line,
#: multi-polygon, geometry collection, polyhedral surface, TIN.
_POINT, _LINE, _POLYGON, _TRIANGLE = 1, 2, 3, 17
_COLLECTIONS = {4, 5, 6, 7, 15, 16}


def read_tables(path: Path, layer: str, wanted: Wanted) -> list[Table]:
    """Read the layers of a map file, or only ``layer``, with the properties that are ``wanted``.

    Raises MapError, naming the file, if it cannot be read or has no such layer.
    """
    if not path.exists():
        raise MapError(f"{path}: there is no such map; check its name")
    try:
        with bounded_time():
            table = geojson_table(path, wanted)
            if table is not None:
                check_layer(path, layer, [table.name])
                return [table]
            pyogrio = needed("pyogrio", f"reading {path}", MapError)
            _check_content(path)
            return _tables(pyogrio, path, layer, wanted)
    except (MapError, ConfigError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001  GDAL's drivers raise what they like
        if _MEMORY.search(str(error)):
            raise MemoryError from None
        line = " ".join(str(error).partition("; It might help")[0].split())
        line = line.removeprefix(f"'{path}' ")[:160]
        raise MapError(
            f"{path}: not a readable map: {line}{elsewhere(f'{path} {line}')}; save it as a "
            "GeoPackage or as GeoJSON (UTF-8)"
        ) from None


def _check_content(path: Path) -> None:
    """Raise MapError for a damaged file that GDAL would read wrongly without an error.

    These are a shapefile that is shorter than its header says, and a KML, a KMZ or the KML in a
    zip with positions that are not numbers.
    """
    suffix, texts = path.suffix.lower(), []
    if suffix == ".shp":
        with path.open("rb") as file:
            length = 2 * int.from_bytes(file.read(28)[24:], "big")
        if path.stat().st_size < length:
            sizes = f"{path.stat().st_size} bytes, and its header says {length}"
            raise MapError(f"{path}: a damaged shapefile: {sizes}; copy it again")
    elif suffix == ".kml":
        texts = [path.read_bytes()]
    elif suffix in {".kmz", ".zip"}:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".kml")]
            texts = [archive.read(name) for name in names]
    for block in itertools.chain(*(_POSITIONS.finditer(_COMMENT.sub(b"", t)) for t in texts)):
        words = block[2].split()
        positions = b" ".join(words).replace(b" ,", b",").replace(b", ", b",").split()
        for position in positions if block[1] else [b",".join(words)] if words else []:
            if not _POSITION.fullmatch(position):
                shown = position[:40].decode(errors="replace")
                raise MapError(f"{path}: the position {shown!r} is not lon,lat[,height]")


def _tables(pyogrio: Any, path: Path, layer: str, wanted: Wanted) -> list[Table]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about the format of files that GDAL can read
        listed = [
            (place, str(name), kind)
            for place in _places(path)
            for name, kind in pyogrio.list_layers(place)
        ]
    drawn = [each for each in listed if each[2] is not None] or listed
    names = [name for _, name, _ in drawn]
    check_layer(path, layer, names)
    return [
        _table(pyogrio, path, place, name, wanted)
        for place, name, _ in drawn
        if layer in {"", name}
    ]


def _places(path: Path) -> list[str]:
    """Return what GDAL opens: the file, or the maps in a zip, also those in its folders."""
    if path.suffix.lower() != ".zip":
        return [str(path)]
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if not name.startswith("__MACOSX/")]
    maps = [name for name in names if name.lower().endswith(_ZIPPED)]
    if not maps:
        raise MapError(f"{path}: no map in the zip ({', '.join(_ZIPPED)}); give the map itself")
    return [f"/vsizip/{path.absolute()}/{name}" for name in maps]


def _table(pyogrio: Any, path: Path, place: str, name: str, wanted: Wanted) -> Table:
    where = f"{path}: layer {name}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        info = pyogrio.read_info(place, layer=name)
    check_number(where, info["features"])
    fields = list(map(str, info["fields"]))
    columns = wanted_columns(wanted, fields, where)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        meta, blobs, values = _read(pyogrio, place, name, sorted({*columns.values()}))
    names = list(map(str, meta["fields"]))
    places = {key: names.index(column) for key, column in columns.items()}
    rows = [{key: row[at] for key, at in places.items()} for row in zip(*values, strict=True)]
    shapes, faults = shapes_of(map(_parts, blobs))
    remarks = dict.fromkeys(str(each.message) for each in caught)
    table = Table(where, name, meta["crs"], shapes, rows or [{}] * len(blobs), fields, faults)
    table.notes += [f"{where}: {each}" for each in remarks if _LOST.search(each)][:_MOST_WARNINGS]
    if info.get("driver") == "GeoJSONSeq" and not place.startswith("/vsi"):
        lost = len(_JSON_LINE.findall(Path(place).read_bytes())) - len(blobs)
        if lost > 0:
            table.notes.append(f"{where}: {lost} damaged lines left out")
    if place.lower().endswith(_KML):
        if np.nan_to_num(shapes.points[:, 2]).any():
            table.notes.append(f"{where}: heights of a KML are above the sea or ground: left out")
        shapes.points[:, 2] = np.nan
    return table


def _read(
    pyogrio: Any, place: str, name: str, columns: list[str]
) -> tuple[dict[str, Any], Sequence[bytes | None], list[list[Any]]]:
    """Return description, geometries (WKB) and columns of a layer.

    UTF-8 is tried first: old shapefiles often hold it but declare another encoding or none.
    """
    options: dict[str, Any] = _COLUMNS if place.lower().endswith(_CSV) else {}
    options = {"layer": name, "columns": columns, **options}
    try:
        meta, _, blobs, values = pyogrio.raw.read(place, encoding="utf-8", **options)
    except UnicodeDecodeError:
        meta, _, blobs, values = pyogrio.raw.read(place, **options)
    if blobs is None and options.keys() & _COLUMNS.keys():
        raise MapError(
            f"{place}: the map has no feature with a geometry: a table needs columns lon and lat, "
            "or one called WKT"
        )
    return meta, [] if blobs is None else blobs, [each.tolist() for each in values]


def _parts(blob: bytes | None) -> list[Part] | str:
    """Return the parts of a geometry in WKB, or why there are none."""
    parts: list[Part] = []
    try:
        if blob is not None:
            _append_parts(bytes(blob), 0, parts)
    except (ValueError, struct.error) as error:
        return f"its geometry is damaged: {error}"
    return parts


def _append_parts(data: bytes, at: int, parts: list[Part]) -> int:
    """Append points, lines and rings of the WKB geometry at an offset; return its end's offset.

    The WKB is as GDAL writes it. Raises ValueError for a type that cannot be drawn.
    """
    (code,) = struct.unpack_from("<I", data, at + 1)
    thousands, kind = divmod(code & 0xFFFF, 1000)
    height = 3 if code >> 31 or thousands in {1, 3} else 2
    width = height + (thousands in {2, 3})
    at += 5

    def count() -> int:
        nonlocal at
        at += 4
        return int(struct.unpack_from("<I", data, at - 4)[0])

    def positions(name: str, number: int) -> None:
        nonlocal at
        points = np.frombuffer(data, "<f8", number * width, at).reshape(number, width)
        at += 8 * number * width
        if name != "Point" or not np.isnan(points[0, :2]).all():  # nan: an empty point
            parts.append((name, points[:, :height]))

    if kind == _POINT:
        positions("Point", 1)
    elif kind == _LINE:
        positions("LineString", count())
    elif kind in {_POLYGON, _TRIANGLE}:
        for _ in range(count()):
            positions("Polygon", count())
    elif kind in _COLLECTIONS:
        for _ in range(count()):
            at = _append_parts(data, at, parts)
    else:
        raise ValueError(f"a geometry of type {kind} (WKB) cannot be drawn; save it as lines")
    return at
