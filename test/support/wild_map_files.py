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
"""Maps as people have them: their writers, their contents, and what is to come of each.

All hold the ring ``RING`` where they can be drawn, whatever their system and format.
"""

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


#: Name of the file, how it is written, and what of it is remarked upon (patterns of each note).
READ = {
    "shapefile without .prj": (
        "a.shp",
        shapefile(),
        ["no known coordinate system: taken as WGS84"],
    ),
    "shapefile, Lambert-93 of ESRI": (
        "a.shp",
        shapefile("EPSG:2154", ring=moved("EPSG:2154")),
        [],
    ),
    "shapefile, letters by .cpg": (
        "a.shp",
        shapefile("EPSG:4326", cpg="GBK", name="消防栓", encoding="gbk"),
        [],
    ),
    "shapefile with heights": ("a.shp", shapefile("EPSG:4326", [(*p, 7.0) for p in RING]), []),
    "zip of a shapefile": ("a.zip", zipped_shapefile, []),
    "KML of folders in folders": (
        "a.kml",
        text(kml(f"<Folder><Folder>{mark('a', LINE)}</Folder></Folder>")),
        [],
    ),
    "KML of a track": (
        "a.kml",
        text(kml(mark("a", f"<gx:Track>{COORDS}</gx:Track>"))),
        ["heights of a KML are above the sea or ground: left out"],
    ),
    "KMZ": ("a.kmz", kmz, []),
    "GPX with a segment of one point": (
        "a.gpx",
        text(
            '<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk>'
            f'<name>a</name><trkseg>{GPX_PLACES}</trkseg><trkseg><trkpt lat="48" lon="16"/>'
            "</trkseg></trk></gpx>"
        ),
        [r"part of feature 1 \(a\): a LineString of 1 positions is too short; left out"],
    ),
    "FlatGeobuf in UTM": ("a.fgb", by_gdal("FlatGeobuf", "EPSG:32633"), []),
    "GML": ("a.gml", by_gdal("GML"), []),
    "DXF in degrees": ("a.dxf", by_gdal("DXF"), ["no known coordinate system: taken as WGS84"]),
    "geodatabase": ("a.gdb", by_gdal("OpenFileGDB", "EPSG:25833"), []),
    "GeoJSON with a crs member": (
        "a.geojson",
        text(collection(feature(coordinates=moved("EPSG:2154")), **named("EPSG:2154"))),
        [],
    ),
    "GeoJSON of heights above the sea": (
        "a.geojson",
        text(
            collection(
                feature(coordinates=[(*p, 200.0) for p in moved("EPSG:32633")]),
                **named("EPSG:32633+5773"),
            )
        ),
        ["heights of .* are not above the ellipsoid: left out"],
    ),
    "GeoJSON, a feature a line": (
        "a.geojsonl",
        text("".join(f"\x1e{json.dumps(feature())}\n" for _ in range(2))),
        [],
    ),
    "GeoJSON with BOM and CRLF": (
        "a.geojson",
        text(json.dumps(feature(), indent=1).replace("\n", "\r\n"), "utf-8-sig"),
        [],
    ),
    "GeoJSON with bad features": (
        "a.geojson",
        text(collection(*BAD, *[feature()] * 8)),
        [
            r"feature 1 \(a\): a LineString of 1 positions is too short; left out",
            r"feature 2 \(a\): \(nan, 48, nan\) is not finite; left out",
            "feature 3 .*inf.* is not finite; left out",
            "1 more features left out",
            "3 features without a geometry left out",
        ],
    ),
    "GeoPackage of several layers": ("a.gpkg", geopackage(), []),
    "GeoPackage with a view": ("a.gpkg", geopackage(view=True), []),
    "GeoPackage in UTM": ("a.gpkg", geopackage(32633, moved("EPSG:32633")), []),
    "GeoPackage of an unknown system": (
        "a.gpkg",
        geopackage(0),
        ["layer main: Undefined geographic", "layer more: Undefined geographic"],
    ),
    "CSV of lon and lat": (
        "a.csv",
        csv("name;Longitude;Latitude", *(f"a;{x};{y}" for x, y in RING)),
        ["no known coordinate system: taken as WGS84"],
    ),
    "CSV of WKT": (
        "a.csv",
        csv("name,WKT", 'a,"LINESTRING (' + ",".join(f"{x} {y}" for x, y in RING) + ')"'),
        ["no known coordinate system: taken as WGS84"],
    ),
}
#: Of other places: name, how it is written, the places (deg), and what is remarked upon.
ELSEWHERE = {
    "CGCS2000": (
        "a.geojson",
        text(collection(feature(coordinates=moved("EPSG:4547", FAR_EAST)), **named("EPSG:4547"))),
        FAR_EAST,
        [],
    ),
    "180 degrees and a rounding": (
        "a.geojson",
        text(collection(feature(coordinates=[[179.9, 1.0], [180.00000000000006, 1.0]]))),
        [[179.9, 1.0], [180.0, 1.0]],
        [],
    ),
    "across 180 degrees": (
        "a.geojson",
        text(collection(feature(coordinates=[[179.9, 1.0], [180.1, 1.0]]))),
        [[179.9, 1.0], [-179.9, 1.0]],
        ["360 is subtracted from longitudes beyond 180"],
    ),
}
#: Name of the file, how it is written, and the message, which says what to do.
REFUSED = {
    "KML of links": (
        "a.kml",
        text(kml("<NetworkLink><Link><href>b.kml</href></Link></NetworkLink>")),
        "it links to other files; open it in Google Earth or QGIS and save the places",
    ),
    "KML of an overlay": (
        "a.kml",
        text(kml("<GroundOverlay/><Style/>")),
        "the map has no feature with a geometry",
    ),
    "DXF in metres": ("a.dxf", by_gdal("DXF", "EPSG:32633"), NAMED),
    "web mercator, not named": ("a.geojson", text(MERCATOR), NAMED),
    "latitude first": (
        "a.geojson",
        text(collection(feature(coordinates=[[48.0, 116.0], [48.1, 116.0]]))),
        rf"\(48, 116\) is not .* \(are the two swapped\?\); {NAMED}",
    ),
    "GeoJSON of nothing": (
        "a.geojson",
        text(collection()),
        "the map has no feature with a geometry",
    ),
    "GeoJSON with comments": (
        "a.geojson",
        text("{ // mine\n" + PLAIN[1:]),
        "Expecting property name enclosed in double quotes: line 1 column 3",
    ),
    "GeoJSON in UTF-16": ("a.geojson", text(PLAIN, "utf-16"), r"save it as .*GeoJSON \(UTF-8\)"),
    "GeoJSON of bad features": (
        "a.geojson",
        text(collection(*BAD[:4])),
        r"feature 1 \(a\): a LineString of 1 positions is too short .none of 3 features",
    ),
    "web page": ("a.geojson", text("<!DOCTYPE html><html>404</html>"), "Expecting value"),
    "geocentric CGCS2000": (
        "a.geojson",
        text(collection(feature(), **named("EPSG:4479"))),
        f"'EPSG:4479' is a Geocentric CRS, .*{NAMED}",
    ),
    "Xian 1980": (
        "a.geojson",
        text(collection(feature(), **named("EPSG:4610"))),
        "the transformation from the datum of Xian 1980 to WGS84 is not known",
    ),
    "GeoPackage of an undefined plane": (
        "a.gpkg",
        geopackage(-1),
        f"layer main: .*Undefined Cartesian.* is a Engineering CRS, .*{NAMED}",
    ),
    "MBTiles": ("a.mbtiles", mbtiles, "not a readable map: .*save it as a GeoPackage"),
    "spreadsheet": ("a.xlsx", spreadsheet, "not a readable map"),
    "CSV without places": (
        "a.csv",
        csv("name,street", "a,b"),
        "no feature with a geometry: a table needs columns lon and lat, or one called WKT",
    ),
}
