"""Read every other format with GDAL, where pyogrio is installed (the extra ``maps``)."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.io.files.offline_reading import check_closed, elsewhere
from tirgeo_ros.io.maps.style_condition import Wanted
from tirgeo_ros.io.maps.table import ShapeBuilder, Table, check_count, check_layer, empty_map
from tirgeo_ros.io.maps.wkb import wkb_parts

#: Possible names of a table's coordinate columns (GDAL's options for CSV).
_COLUMNS = {
    "X_POSSIBLE_NAMES": "lon,lng,long,longitude,lon_*,longitude_*,x,easting",
    "Y_POSSIBLE_NAMES": "lat,latitude,lat_*,latitude_*,y,northing",
    "GEOM_POSSIBLE_NAMES": "wkt,geom,geometry,the_geom,shape",
}
_TABLES = {".csv", ".tsv", ".txt"}
_NO_COLUMNS = "a table needs columns lon and lat, or one called WKT"
_KNOWN = "GeoJSON, GeoPackage, Shapefile, KML and KMZ"


def read_other(path: Path, layer: str, wanted: Wanted) -> list[Table]:
    """Read the tables that GDAL finds in a file, or only its table ``layer``.

    Raises MapError, naming the file, if GDAL finds none, or where pyogrio is absent.
    """
    try:
        import pyogrio  # noqa: PLC0415  optional
    except ImportError:
        raise MapError(
            f"{path}: none of {_KNOWN}; other formats need pyogrio: pip install 'tirgeo[maps]'"
        ) from None
    check_closed()
    try:
        return _tables(pyogrio, path, layer, wanted)
    except (MapError, ConfigError):
        raise
    except Exception as error:  # noqa: BLE001  GDAL's drivers raise what they like
        line = " ".join(str(error).split())[:160]
        hint = elsewhere(f"{path} {line}")
        raise MapError(
            f"{path}: no map that can be read: {line}{hint}; save it as a GeoPackage"
        ) from None


def _tables(pyogrio: Any, path: Path, layer: str, wanted: Wanted) -> list[Table]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GDAL's remarks on the form of a file that it takes
        names = [str(name) for name in pyogrio.list_layers(path)[:, 0]]
        check_layer(path, layer, names)
        return [_table(pyogrio, path, name, wanted) for name in names if layer in {"", name}]


def _table(pyogrio: Any, path: Path, name: str, wanted: Wanted) -> Table:
    where = f"{path}: layer {name}"
    fields = [str(each) for each in pyogrio.read_info(path, layer=name)["fields"]]
    names = wanted.columns(fields, where)
    options = _COLUMNS if path.suffix.lower() in _TABLES else {}
    meta, _, geometries, columns = pyogrio.raw.read(path, layer=name, columns=names, **options)
    empty = empty_map(path, _NO_COLUMNS) if options and geometries is None else ""
    geometries = [] if geometries is None else geometries  # a table without any
    check_count(len(geometries), where)
    shapes = ShapeBuilder()
    for number, blob in enumerate(geometries):
        shapes.take(number, () if blob is None else wkb_parts(bytes(blob)))
    values = [column.tolist() for column in columns]
    rows = zip(*values, strict=True) if values else [()] * len(geometries)
    read = [str(each) for each in meta["fields"]]
    properties = [dict(zip(read, row, strict=True)) for row in rows]
    return Table(
        where,
        name,
        meta["crs"],
        shapes.shapes(),
        properties,
        fields,
        no_crs="names no system",
        faults=shapes.faults,
        empty=empty,
    )
