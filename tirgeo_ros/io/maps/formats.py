"""Choose the reader of a map file by its content, else by its name."""

from __future__ import annotations

import errno
import gc
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps import archive, geopackage, shapefile
from tirgeo_ros.io.maps.gdal_formats import read_other
from tirgeo_ros.io.maps.geojson import read_geojson
from tirgeo_ros.io.maps.kml import read_kml, read_kmz
from tirgeo_ros.io.maps.style_condition import Wanted
from tirgeo_ros.io.maps.table import Table

Reader = Callable[[Path, str, Wanted], list[Table]]

_HEAD_BYTES = 4096
#: First bytes of files that people take for maps, and what to do about them.
_NO_MAPS = {
    **dict.fromkeys(
        (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"),
        "a picture (TIFF); an elevation model belongs in the parameter dem",
    ),
    **dict.fromkeys((b"\x89PNG", b"\xff\xd8\xff"), "a picture"),
    b"%PDF": "a PDF; save its layers from the program that made it",
    b"AC10": "a drawing (DWG); save it as DXF or Shapefile",
    b"PMTiles": "tiles, cut up for a screen; save the layers themselves as a GeoPackage",
}
#: JSON of other kinds, which GDAL reads.
_OTHER_JSON = re.compile(rb'"type"\s*:\s*"Topology"|"esri(Geometry|FieldType)')
_BLANK = b" \t\r\n\xef\xbb\xbf\x1e"  # includes a byte order mark, and JSON's record separator


def read_tables(path: Path, layer: str, wanted: Wanted) -> list[Table]:
    """Read the tables of a map file, or only its table ``layer``, with what is ``wanted``.

    Raises MapError, naming the file, if it cannot be read or has no such layer.
    """
    path = main_file(path)
    try:
        with _no_garbage_collection():
            return _reader(path)(path, layer, wanted)
    except FileNotFoundError:
        raise MapError(f"{path}: there is no such map; check its name") from None
    except OSError as error:
        raise MapError(f"{path}: the map cannot be read: {error.strerror or error}") from None


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Disable garbage collection, which takes half the time of a large map and frees nothing."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def main_file(path: Path) -> Path:
    """Return the .shp if one of its companions is given, else the file itself."""
    if path.suffix.lower() not in shapefile.SIDECARS:
        return path
    main = shapefile.sidecar(path, ".shp")
    return main if main.is_file() else path


def companions(path: Path) -> list[Path]:
    """Return the files that are read together with a map file; some need not exist."""
    path = main_file(path)
    if path.suffix.lower() == ".shp":
        return [path, *(shapefile.sidecar(path, each) for each in shapefile.SIDECARS)]
    if path.suffix.lower() == ".gpkg":
        return [path, geopackage.log_of(path)]
    return [path]


def _reader(path: Path) -> Reader:
    if path.is_dir():
        if path.suffix.lower() == ".gdb":
            return read_other
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    return _by_content(path, head) or _BY_NAME.get(path.suffix.lower(), read_other)


def _by_content(path: Path, head: bytes) -> Reader | None:
    if head.startswith(geopackage.MAGIC):
        return _database
    if head.startswith(archive.MAGIC):
        return _zip
    if head.startswith(shapefile.MAGIC):
        return shapefile.read_shapefile
    for magic, what in _NO_MAPS.items():
        if head.startswith(magic):
            raise MapError(f"{path}: {what}; a map is of points, lines and outlines")
    text = head.lstrip(_BLANK)
    if text[:1] in {b"{", b"["}:
        return read_other if _OTHER_JSON.search(head) else read_geojson
    return read_kml if text[:1] == b"<" and b"kml" in head.lower() else None


def _database(path: Path, layer: str, wanted: Wanted) -> list[Table]:
    """Read an SQLite file; refuse views of other kinds, which GDAL would run without a bound."""
    kind = geopackage.kind_of(path)
    if kind == "package":
        return geopackage.read_geopackage(path, layer, wanted)
    if kind == "tiles":
        raise MapError(
            f"{path}: tiles, cut up for a screen (MBTiles); save the layers themselves as a "
            "GeoPackage"
        )
    if kind == "views":
        raise MapError(f"{path}: an SQLite file with views in it; save the map as a GeoPackage")
    return read_other(path, layer, wanted)


def _zip(path: Path, layer: str, wanted: Wanted) -> list[Table]:
    """Read a KMZ or a zip of shapefiles, depending on its members."""
    try:
        members = archive.Archive(path.read_bytes())
        if members.names(".kml"):
            return read_kmz(path, members, layer)
        if members.names(".shp"):
            return shapefile.read_zipped_shapefiles(path, members, layer, wanted)
    except ValueError as error:
        raise MapError(f"{path}: {error}") from None
    raise MapError(f"{path}: a zip without a .kml or a .shp in it; unpack it and name its map")


_BY_NAME: dict[str, Reader] = {
    **dict.fromkeys((".geojson", ".json", ".geojsonl", ".geojsons"), read_geojson),
    ".gpkg": geopackage.read_geopackage,
    ".shp": shapefile.read_shapefile,
    ".kml": read_kml,
    **dict.fromkeys((".kmz", ".zip"), _zip),
}
