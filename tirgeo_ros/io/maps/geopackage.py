"""Read GeoPackage (OGC 12-128r19) with the standard library's SQLite.

A package is opened for reading only, so it may be open elsewhere, for example in QGIS. A layer may
be a view, which is a program: it is run up to a bound.
"""

from __future__ import annotations

import itertools
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from urllib.parse import quote

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import known
from tirgeo_ros.io.maps.feature_faults import FeatureError
from tirgeo_ros.io.maps.style_condition import Wanted
from tirgeo_ros.io.maps.table import Part, ShapeBuilder, Table, check_count, check_layer
from tirgeo_ros.io.maps.wkb import wkb_parts

MAGIC = b"SQLite format 3\0"
_READ_VERSION = 19  # byte of the header: 2 = write-ahead log
_ENVELOPES = (0, 32, 48, 48, 64)  # bytes, by the flags' code
_EMPTY, _EXTENDED = 0x10, 0x20  # flags of a geometry
_BUSY_S = 2.0
#: Bound of SQLite machine instructions for a package: a table takes some twenty per feature.
_MOST_STEPS = 50_000_000
_STEPS_AT_ONCE = 100_000

_LAYERS = """
SELECT g.table_name, g.column_name, g.srs_id, s.organization, s.organization_coordsys_id,
       s.definition
FROM gpkg_geometry_columns AS g LEFT JOIN gpkg_spatial_ref_sys AS s ON s.srs_id = g.srs_id
ORDER BY g.rowid"""

Row = tuple[object, ...]


def read_geopackage(path: Path, layer: str, wanted: Wanted) -> list[Table]:
    """Read the feature tables of a package, or only its table ``layer``.

    Raises MapError, naming file, table and feature, if it is damaged or no GeoPackage.
    """
    try:
        with closing(_connected(path)) as database:
            rows = database.execute(_LAYERS).fetchall()
            check_layer(path, layer, [str(row[0]) for row in rows])
            return [_table(database, path, row, wanted) for row in rows if layer in {"", row[0]}]
    except (sqlite3.Error, sqlite3.Warning, ValueError, OverflowError) as error:
        told = str(error)
        if told == "interrupted":
            told = "a view in it computes without end; save the layer as a table"
        raise MapError(f"{path}: no GeoPackage that can be read: {told}") from None


def kind_of(path: Path) -> str:
    """Return what an SQLite file is: ``package``, ``tiles`` (MBTiles), ``views`` (it has some).

    Returns "" for any other, and ``package`` for one that is too damaged to tell.
    """
    try:
        with closing(_connected(path)) as database:
            found = database.execute("SELECT name, type FROM sqlite_master").fetchall()
    except (sqlite3.Error, ValueError):  # ValueError: SQLite's own message is not valid text
        return "package"
    names = {name for name, _ in found}
    if "gpkg_geometry_columns" in names:
        return "package"
    if names & {"tiles", "gpkg_tile_matrix"}:
        return "tiles"
    return "views" if "view" in {kind for _, kind in found} else ""


def _connected(path: Path) -> sqlite3.Connection:
    """Return a connection that leaves the file, and the folder, unchanged.

    A log beside the file holds the newest changes of the program that has it open. Without such a
    log there is nothing to wait for, and SQLite would create one where it may write.
    """
    with path.open("rb") as file:
        logged = file.read(_READ_VERSION + 1)[_READ_VERSION:] == b"\2"
    waits = False
    with suppress(OSError):  # the other program may remove the log meanwhile
        waits = log_of(path).stat().st_size > 0
    way = "immutable=1" if logged and not waits else "mode=ro"
    uri = f"file:{quote(str(path.absolute()))}?{way}"
    database = sqlite3.connect(uri, uri=True, timeout=_BUSY_S)
    steps = itertools.count(_STEPS_AT_ONCE, _STEPS_AT_ONCE)
    database.set_progress_handler(lambda: next(steps) > _MOST_STEPS, _STEPS_AT_ONCE)
    database.text_factory = lambda text: text.decode("utf-8", "replace")
    return database


def log_of(path: Path) -> Path:
    """Return the path of the write-ahead log, which exists while a program writes the package."""
    return path.with_name(path.name + "-wal")


def _table(database: sqlite3.Connection, path: Path, row: Row, wanted: Wanted) -> Table:
    name, column = str(row[0]), str(row[1])
    where = f"{path}: layer {name}"
    info = database.execute(f"PRAGMA table_info({_quoted(name)})").fetchall()
    fields = [str(each[1]) for each in info if str(each[1]).lower() != column.lower()]
    names = wanted.columns(fields, where)
    if info and column.lower() not in {str(each[1]).lower() for each in info}:
        raise MapError(f"{where}: there is no column {column!r}, which is to hold the geometries")
    selected = ", ".join(map(_quoted, [column, *names]))
    # Names cannot be bound; they come from the package itself and are quoted.
    cursor = database.execute(f"SELECT {selected} FROM {_quoted(name)}")  # noqa: S608
    shapes = ShapeBuilder()
    properties = []
    for number, (geometry, *values) in enumerate(cursor):
        check_count(number + 1, where)
        properties.append(dict(zip(names, values, strict=True)))
        shapes.take(number, _parts(geometry))
    return Table(
        where,
        name,
        _crs(row),
        shapes.shapes(),
        properties,
        fields,
        no_crs="has an undefined geographic system",
        faults=shapes.faults,
    )


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _crs(row: Row) -> str | None:
    """Return the text of a table's system; None for "undefined geographic"."""
    srs_id, organization, code, definition = row[2:]
    if srs_id in {0, -1}:
        return None if srs_id == 0 else "undefined Cartesian"
    if organization is None:
        return f"srs_id {srs_id}, which the package does not have"
    coded = f"{organization}:{code}"
    return coded if known(coded) else str(definition or coded)


def _parts(blob: object) -> Iterator[Part]:
    """Yield the parts of a geometry in the package's own format of header and WKB."""
    if blob is None:
        return
    if not isinstance(blob, bytes) or len(blob) < 8 or blob[:2] != b"GP" or blob[2]:
        raise FeatureError("its geometry is none of a GeoPackage's")
    flags = blob[3]
    envelope = flags >> 1 & 7
    if flags & _EXTENDED or envelope >= len(_ENVELOPES):
        raise FeatureError("its geometry is of an extended or unknown form")
    if not flags & _EMPTY:
        yield from wkb_parts(blob, 8 + _ENVELOPES[envelope])
