"""Read shapefiles with pyshp: the .shp with its .dbf, .prj and .cpg, loose or in one .zip."""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps.archive import Archive
from tirgeo_ros.io.maps.feature_faults import FeatureError
from tirgeo_ros.io.maps.style_condition import Wanted
from tirgeo_ros.io.maps.table import Part, ShapeBuilder, Table, check_count, check_layer

MAGIC = b"\x00\x00\x27\x0a"
SIDECARS = (".shx", ".dbf", ".prj", ".cpg")

_NULL, _MULTIPATCH = 0, 31
_POINTS = {1, 8, 11, 18, 21, 28}
_LINES = {3, 13, 23}
_RINGS = {5, 15, 25}
_WITH_Z = {11, 13, 15, 18}
_HEADER_BYTES = 100
_NO_DATA = -1e38  # less than this is "no data"

#: Code pages by the number (hexadecimal) in the header of a .dbf, used without a .cpg.
_LANGUAGES = {
    int(number, 16): f"cp{page}"
    for number, page in re.findall(
        r"(\w+):(\d+)",
        "01:437 02:850 03:1252 13:932 4D:936 4E:949 4F:950 57:1252 58:1252 59:1252 64:852 65:866 "
        "66:865 67:861 6A:737 6B:857 78:950 79:949 7A:936 7B:932 7C:874 7D:1255 7E:1256 C8:1250 "
        "C9:1251 CA:1254 CB:1253 CC:1257",
    )
}

#: What pyshp raises beside its own exception, or lets through, for a damaged file.
_DAMAGE = (
    struct.error,
    ArithmeticError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
    AssertionError,
    OSError,
)
_LAST_NUMBER = re.compile(r"\d+$")
Fetch = Callable[[str], bytes | None]  # the content of the file with a suffix, None if absent


def read_shapefile(path: Path, layer: str, wanted: Wanted) -> list[Table]:
    """Return the only table of a shapefile, named as its file.

    Raises MapError, naming file and feature, if it is damaged or holds multipatches.
    """
    check_layer(path, layer, {path.stem})

    def fetch(suffix: str) -> bytes | None:
        file = sidecar(path, suffix)
        return file.read_bytes() if file.is_file() else None

    return [_table(str(path), path.stem, fetch, wanted)]


def sidecar(path: Path, suffix: str) -> Path:
    """Return the file beside a .shp, with the suffix in the case in which it exists."""
    spellings = [path.with_suffix(each) for each in (suffix, suffix.upper())]
    return next((each for each in spellings if each.is_file()), spellings[0])


def read_zipped_shapefiles(
    path: Path, archive: Archive, layer: str, wanted: Wanted
) -> list[Table]:
    """Return a table for each shapefile in a zip.

    Raises MapError, and ValueError for a damaged zip.
    """
    names = {PurePosixPath(name).stem: name[:-4] for name in archive.names(".shp")}
    check_layer(path, layer, names)
    members = {name.lower(): name for name in archive.names("")}

    def fetch(stem: str, suffix: str) -> bytes | None:
        name = members.get((stem + suffix).lower())
        return None if name is None else archive.read(name)

    return [
        _table(f"{path}: layer {name}", name, partial(fetch, stem), wanted)
        for name, stem in names.items()
        if layer in {"", name}
    ]


def _table(where: str, name: str, fetch: Fetch, wanted: Wanted) -> Table:
    fields, records, told = _records(where, fetch, wanted)
    shapes = ShapeBuilder()
    properties: list[Mapping[str, Any]] = []
    for number, shape in enumerate(_shapes(fetch(".shp") or b"", where)):
        check_count(number + 1, where)
        record = records[number] if number < len(records) else {}
        properties.append(record or {})
        if record is not None:
            shapes.take(number, _parts(shape))
    if records and len(records) != len(properties):
        told += (f"{where}: {len(records)} records for {len(properties)} shapes",)
    prj = fetch(".prj")
    crs = (prj or b"").decode("utf-8-sig", "replace").strip() or None
    no_crs = "has no .prj" if prj is None else "has an empty .prj"
    deleted = sum(record is None for record in records[: len(properties)])
    found, faults = shapes.shapes(), shapes.faults
    return Table(where, name, crs, found, properties, fields, told, deleted, no_crs, faults)


def _shapes(content: bytes, where: str) -> Iterator[Any]:
    """Yield the shapes as pyshp returns them."""
    content = _whole(content, where)
    pyshp = _pyshp()
    room = len(content) // 12  # a record takes at least this many bytes; more records mean a loop
    try:
        with pyshp.Reader(shp=io.BytesIO(content)) as reader:
            for number, shape in enumerate(reader.iterShapes()):
                if number > room:
                    raise ValueError("a record leads back to another")
                yield shape
    except (pyshp.ShapefileException, *_DAMAGE) as error:
        raise MapError(f"{where}: a damaged shapefile: {_line(error)}") from None


def _whole(content: bytes, where: str) -> bytes:
    """Return the bytes that the header declares (in words of two); raises MapError if cut."""
    size = 2 * int.from_bytes(content[24:28], "big")
    if not _HEADER_BYTES <= size <= len(content):
        raise MapError(f"{where}: a damaged shapefile: {len(content)} bytes, to be {size}")
    return content[:size]


def _parts(shape: Any) -> Iterator[Part]:
    """Yield the points, lines and rings of a shape.

    Raises FeatureError for one that is not drawn.
    """
    kind = int(shape.shapeType)
    if kind == _NULL:
        return
    points = _points(shape, kind in _WITH_Z)
    if kind in _POINTS:
        yield from (("Point", row[None]) for row in points)
    elif kind in _LINES | _RINGS:
        starts = list(shape.parts)
        if starts != sorted(starts) or starts[:1] != [0] or starts[-1] > len(points):
            raise FeatureError("it is damaged: its parts overlap")
        name = "LineString" if kind in _LINES else "Polygon"
        yield from ((name, part) for part in np.split(points, starts[1:]))
    elif kind == _MULTIPATCH:
        raise FeatureError("a MultiPatch is not drawn; save it as outlines (its footprint)")
    else:
        raise FeatureError(f"a shape of the unknown type {kind}")


def _points(shape: Any, has_z: bool) -> NDArray[np.float64]:
    flat = np.array([point[:2] for point in shape.points], float).reshape(-1, 2)
    z = np.array(list(getattr(shape, "z", ())) if has_z else (), float)
    if len(z) != len(flat):
        return flat
    return np.column_stack([flat, np.where(z < _NO_DATA, np.nan, z)])


def _records(
    where: str, fetch: Fetch, wanted: Wanted
) -> tuple[Sequence[str], list[Mapping[str, Any] | None], tuple[str, ...]]:
    """Return the names of the fields, the records, and remarks.

    A record has the wanted fields; it is None if it is deleted.
    """
    content = fetch(".dbf")
    if content is None:
        return (), [], (f"{where}: has no .dbf: no labels",)
    pyshp = _pyshp()
    try:
        with pyshp.Reader(
            dbf=io.BytesIO(content),
            encoding=_encoding(fetch(".cpg"), content),
            encodingErrors="replace",
        ) as reader:
            fields = [each[0] for each in reader.fields if each[0] != "DeletionFlag"]
            names = wanted.columns(fields, where)
            found = (reader.record(number, fields=names) for number in range(len(reader)))
            rows: list[Mapping[str, Any] | None] = [
                None if row is None else dict(zip(names, row, strict=True)) for row in found
            ]
            return fields, rows, ()
    except (pyshp.ShapefileException, *_DAMAGE) as error:
        raise MapError(f"{where}: a damaged .dbf: {_line(error)}") from None


def _encoding(cpg: bytes | None, dbf: bytes) -> str:
    """Return the code page of the .cpg, else of the .dbf; else UTF-8 if it fits, else Latin.

    Many programs write the number of Windows's Latin whatever they write, so the bytes take
    precedence over that number.
    """
    named = (cpg or b"").decode("ascii", "replace").strip().strip("\0").lower()
    number = _LAST_NUMBER.search(named)
    told = _LANGUAGES.get(dbf[29] if len(dbf) > 29 else 0)
    for name in (
        named,
        f"cp{number.group()}" if number else "",
        named.replace(" ", "-"),
        "" if told == "cp1252" else told,
    ):
        if name and _known(name):
            return name
    return "utf-8" if _is_utf8(dbf) else "cp1252"


def _is_utf8(dbf: bytes) -> bool:
    """Return whether most non-ASCII letters are valid UTF-8: a field's end may cut one in two."""
    records = dbf[int.from_bytes(dbf[8:10], "little") :]  # the header has numbers in bytes
    text = records.decode("utf-8", "replace")
    right = sum(not each.isascii() for each in text) - text.count("\ufffd")
    return text.count("\ufffd") <= right


def _known(name: str) -> bool:
    try:
        return isinstance(b"a".decode(name), str)
    except (LookupError, ValueError):  # unknown, or a codec of no text
        return False


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:100] or type(error).__name__


def _pyshp() -> Any:
    try:
        import shapefile  # noqa: PLC0415  the other formats work without it
    except ModuleNotFoundError:
        raise MapError("a Shapefile needs the library pyshp: pip install pyshp") from None
    return shapefile
