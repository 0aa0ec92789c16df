"""Every other format, by GDAL, where pyogrio is installed (the extra ``maps``)."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tirgeo_ros.core.errors import ConfigError, MapError
from tirgeo_ros.io.label_rule import LabelRule
from tirgeo_ros.io.maps.table import ShapeBuilder, Table, check_count, check_layer
from tirgeo_ros.io.maps.wkb import Part, wkb_parts
from tirgeo_ros.io.offline import check_closed, elsewhere

_KNOWN = "GeoJSON, GeoPackage, Shapefile, KML and KMZ"


def read_other(path: Path, layer: str, rule: LabelRule) -> list[Table]:
    """The tables that GDAL finds in a file, or its one table ``layer``.

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
        return _tables(pyogrio, path, layer, rule)
    except (MapError, ConfigError):
        raise
    except Exception as error:  # noqa: BLE001  GDAL's drivers raise what they like
        line = " ".join(str(error).split())[:160]
        hint = elsewhere(f"{path} {line}")
        raise MapError(f"{path}: no map that can be read: {line}{hint}") from None


def _tables(pyogrio: Any, path: Path, layer: str, rule: LabelRule) -> list[Table]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GDAL's remarks on the form of a file that it takes
        names = [str(name) for name in pyogrio.list_layers(path)[:, 0]]
        check_layer(path, layer, names)
        return [_table(pyogrio, path, name, rule) for name in names if layer in {"", name}]


def _table(pyogrio: Any, path: Path, name: str, rule: LabelRule) -> Table:
    where = f"{path}: layer {name}"
    fields = [str(each) for each in pyogrio.read_info(path, layer=name)["fields"]]
    wanted = [each for each in dict.fromkeys(rule.columns(fields, where)) if each is not None]
    meta, _, geometries, columns = pyogrio.raw.read(path, layer=name, columns=wanted)
    geometries = [] if geometries is None else geometries  # a table without any
    check_count(len(geometries), where)
    shapes = ShapeBuilder(where)
    for number, blob in enumerate(geometries):
        for kind, points in _parts(blob, f"{where}: feature {number + 1}"):
            shapes.add(number, kind, points)
    values = [column.tolist() for column in columns]
    rows = zip(*values, strict=True) if values else [()] * len(geometries)
    read = [str(each) for each in meta["fields"]]
    properties = [dict(zip(read, row, strict=True)) for row in rows]
    return Table(
        where, name, meta["crs"], shapes.shapes(), properties, fields, no_crs="names no system"
    )


def _parts(blob: bytes | None, where: str) -> Iterable[Part]:
    return () if blob is None else wkb_parts(bytes(blob), 0, where)
