"""Writers of maps as people have them, and their contents."""

from __future__ import annotations

import json
import sqlite3
import zipfile
from contextlib import closing

import numpy as np
import pyogrio
import pyproj
from map_files import RING, gpb, wkb, write_geopackage, write_shapefile

FAR_EAST = [(114.0 + x - 16.0, y - 18.0) for x, y in RING]  # in the zone of EPSG:4547


def moved(crs, ring=RING):
    """The ring in another system, x before y."""
    transformer = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    return [tuple(transformer.transform(*point)) for point in ring]


def feature(kind="LineString", coordinates=RING, **members):
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"name": "a"}, "geometry": geometry, **members}


def collection(*features, **members):
    return json.dumps({"type": "FeatureCollection", "features": features, **members})


def named(crs):
    return {"crs": {"type": "name", "properties": {"name": crs}}}


def text(content, encoding="utf-8"):
    """Writes a text."""
    return lambda path: path.write_bytes(content.encode(encoding))


def kml(inner):
    head = '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
    return f"{head}{inner}</Document></kml>"


def mark(name, geometry):
    return f"<Placemark><name>{name}</name>{geometry}</Placemark>"


PLACES = " ".join(f"{x},{y}" for x, y in RING)
LINE = f"<LineString><coordinates>{PLACES}</coordinates></LineString>"
COORDS = "".join(f"<gx:coord>{x} {y} 5</gx:coord>" for x, y in RING)
GPX_PLACES = "".join(f'<trkpt lat="{y}" lon="{x}"/>' for x, y in RING)


def kmz(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("doc.kml", kml(mark("a", LINE)))
        archive.writestr("files/icon.png", b"\x89PNG")


def spreadsheet(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>")


def shapefile(crs=None, ring=RING, cpg=None, name="a", encoding="utf-8"):
    def write(path):
        prj = crs and pyproj.CRS(crs).to_wkt("WKT1_ESRI")
        write_shapefile(path, [ring], [name], prj, encoding)
        if cpg:
            path.with_suffix(".cpg").write_text(cpg)

    return write


def zipped_shapefile(path):
    inside = path.with_name("inside.shp")
    shapefile("EPSG:4326")(inside)
    with zipfile.ZipFile(path, "w") as archive:
        for suffix in (".shp", ".shx", ".dbf", ".prj"):
            archive.write(inside.with_suffix(suffix), f"roads{suffix}")


def geopackage(srs_id=4326, ring=RING, view=False):
    def write(path):
        row = (gpb(wkb("LineString", ring), srs_id=srs_id), "a", 1)
        write_geopackage(path, {"main": (srs_id, [row]), "more": (srs_id, [row]), "no": (0, [])})
        if view:
            with closing(sqlite3.connect(path)) as database:
                database.executescript(
                    "ALTER TABLE main RENAME TO t; CREATE VIEW main AS SELECT * FROM t"
                )

    return write


def mbtiles(path):
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TABLE metadata (name, value);"
            "CREATE TABLE map (zoom_level, tile_column, tile_row, tile_data);"
            "CREATE VIEW tiles AS SELECT * FROM map"
        )


def by_gdal(driver, crs="EPSG:4326", **options):
    def write(path):
        shape = np.array([wkb("LineString", moved(crs))], object)
        names = [] if driver == "DXF" else [np.array(["a"], object)]
        fields = ["name"] if names else []
        pyogrio.raw.write(
            path,
            shape,
            names,
            fields,
            crs=crs,
            geometry_type="LineString",
            driver=driver,
            **options,
        )

    return write


def csv(*lines):
    return text("\n".join(lines) + "\n")


BAD = [
    feature("LineString", RING[:1], id=7),
    feature("LineString", [RING[0], [float("nan"), 48.0]]),
    feature("LineString", [RING[0], [float("inf"), 48.0]]),
    feature("Polygon", [[]]),
    feature("Polygon", RING),
    feature("Point", ["16", "48"]),
    feature("Point", [500_000, 5_300_000]),
]
MERCATOR = collection(feature(coordinates=moved("EPSG:3857")))
PLAIN = collection(feature())
NAMED = r"save the map in WGS84 \(EPSG:4326\), or name its system"
