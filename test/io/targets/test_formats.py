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
"""Targets and located pixels in the formats of other programs, read by those and by us."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import re
from xml.etree import ElementTree as ET

import pyogrio
import pytest
from target_samples import ANSWERS, COVARIANCE, FOUND, HOSTILE, STAMP_NS, TARGETS, click, target

from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.surveys.survey import Answered
from tirgeo_ros.io.targets.formats import FORMATS, exported, exported_answers, form_of
from tirgeo_ros.io.targets.geopackage import read_targets
from tirgeo_ros.io.targets.store import TargetStore

KML, GPX = "{http://www.opengis.net/kml/2.2}", "{http://www.topografix.com/GPX/1/1}"
SCALE_95 = math.sqrt(5.991464547)  # chi-square, two degrees of freedom


def features(answers):
    return json.loads(exported_answers(answers, "geojson"))["features"]


def rows(content, **how):
    """The rows of a CSV file, read without its mark."""
    return csv.DictReader(io.StringIO(content.decode("utf-8-sig"), newline=""), **how)


def written(folder, content, name="targets"):
    path = folder / name
    path.write_bytes(content)
    return path


def test_geojson_has_points_in_order_then_ellipses_and_reasons():
    point, refused, ellipse = features(ANSWERS)
    names = [(f["properties"]["kind"], f["properties"]["id"]) for f in (point, refused, ellipse)]
    assert names == [("point", ANSWERS[0].id), ("point", "cloud"), ("ellipse", ANSWERS[0].id)]
    assert point["geometry"] == {"type": "Point", "coordinates": [116.7, 39.85, 11.5]}
    cells = point["properties"]
    pixel = {"stamp_ns": STAMP_NS, "u": 320.5, "v": 256.25, "reason": None}
    assert cells.items() >= pixel.items()
    assert cells["ellipse_major_m"] == pytest.approx(2 * SCALE_95, abs=1e-4)
    assert cells["ellipse_minor_m"] == pytest.approx(0.5 * SCALE_95, abs=1e-4)
    assert cells["ellipse_azimuth_deg"] == pytest.approx(30, abs=1e-3)
    assert cells["sigma_height_m"] == pytest.approx(0.1)
    assert cells["sigma_north_m"] == pytest.approx(math.sqrt(COVARIANCE[1, 1]), abs=1e-4)
    ring = ellipse["geometry"]["coordinates"][0]
    assert [list(reversed(corner)) for corner in ring] == [list(c) for c in click().outline()]
    assert refused["geometry"] is None
    reason = {"reason": "the pixel is above the horizon", "height_m": None}
    assert refused["properties"].items() >= (reason | {"stamp_ns": STAMP_NS + 5}).items()
    assert list(refused["properties"]) == list(cells)


def test_a_height_just_below_zero_has_no_sign():
    low = [Answered("low", dataclasses.replace(click(), uv=(1.0, 2.0), height_m=-1e-9))]
    assert '"height_m": 0.0' in exported_answers(low, "geojson").decode()
    assert "; 0.00 m above" in exported_answers(low, "kml").decode()


def test_kml_holds_points_ellipses_and_reasons():
    document = ET.fromstring(exported_answers(ANSWERS, "kml"))[0]
    first, second = document.findall(f"{KML}Placemark")
    assert first.find(f"{KML}name").text == "sheep <1> & Ü"  # no XML holds a bell
    assert first.find(f".//{KML}Point/{KML}coordinates").text == "116.700000000,39.850000000"
    assert len(first.find(f".//{KML}LinearRing/{KML}coordinates").text.split()) == 61
    values = {d.get("name"): d.find(f"{KML}value").text for d in first.iter(f"{KML}Data")}
    assert values["height_m"] == "11.5"
    assert first.find(f".//{KML}when").text == "2021-10-20T12:00:35.605Z"
    assert "above the horizon" in second.find(f"{KML}description").text
    assert second.find(f".//{KML}Point") is None


def test_targets_have_the_properties_of_located_pixels_and_their_own():
    point, other, *ellipses = json.loads(exported(TARGETS, "geojson"))["features"]
    own = {"number": 1, "name": "Huber", "target_kind": "fire", "note": "roof\nwest"}
    assert own.items() <= point["properties"].items()
    assert point["properties"]["time"] == "2021-10-20T12:00:35.605Z"
    assert other["properties"]["clicks"] == 2
    of_pixels = set(features(ANSWERS)[0]["properties"])
    of_pixels -= {"u", "v", "reason", "temperature_c"}
    assert of_pixels <= set(point["properties"])
    assert [item["properties"]["kind"] for item in ellipses] == ["ellipse"] * 2


def test_each_format_has_the_status_and_kml_the_kind_s_colour():
    found = [dataclasses.replace(TARGETS[0], status="found"), TARGETS[1]]
    points = json.loads(exported(found, "geojson"))["features"][:2]
    assert [point["properties"]["status"] for point in points] == ["found", "new"]
    table = exported(found, "csv").decode().splitlines()
    assert table[0].split(",")[10] == "status"
    assert "; found; 95 %" in exported(found, "gpx").decode()
    document = ET.fromstring(exported(found, "kml"))[0]
    colours = {
        style.get("id"): style.find(f"{KML}IconStyle/{KML}color").text
        for style in document.findall(f"{KML}Style")
    }
    assert colours["fire"] == "ff0077ff"  # alpha, blue, green, red: as argb -35072 of CoT
    uses = [mark.find(f"{KML}styleUrl").text for mark in document.findall(f"{KML}Placemark")]
    assert uses == ["#fire", "#person"]
    assert [url[1:] in colours for url in uses] == [True, True]


def test_csv_has_a_line_for_each_target_and_excels_mark_of_utf_8():
    content = exported(TARGETS, "csv")
    assert content.startswith(b"\xef\xbb\xbfid,number,name,")
    first, second = rows(content)
    assert (first["number"], first["name"], first["target_kind"]) == ("1", "Huber", "fire")
    assert (second["number"], second["name"], second["target_kind"]) == ("3", "", "person")
    assert (first["latitude_deg"], first["mgrs"]) == ("39.85", "50S MK 74336 11151")
    assert first["utm"].startswith("50S 474336.")
    assert exported([], "csv").decode("utf-8-sig").split(",")[:2] == ["id", "number"]


def test_gpx_waypoints_are_as_the_schema_orders_them():
    edge = target(4, dataclasses.replace(click(), longitude_deg=180.0))
    root = ET.fromstring(exported([*TARGETS, edge], "gpx"))
    assert (root.tag, root.get("version"), root.get("creator")) == (f"{GPX}gpx", "1.1", "tirgeo")
    first, second, third = root.findall(f"{GPX}wpt")
    assert first.attrib == {"lat": "39.850000000", "lon": "116.700000000"}
    tags = [child.tag.removeprefix(GPX) for child in first]
    assert tags == ["time", "name", "cmt", "desc", "type"]
    assert first.find(f"{GPX}name").text == "Huber"
    assert first.find(f"{GPX}desc").text.startswith("roof west; 95 % within 4.90 x 1.22 m")
    assert second.find(f"{GPX}name").text == "3 person"
    assert third.get("lon") == "-180.000000000"  # the schema wants longitudes below 180


@pytest.mark.parametrize("form", ["geojson", "kml", "gpx", "gpkg"])
def test_gdal_reads_each_format(form, tmp_path):
    path = written(tmp_path, exported(TARGETS, form), f"targets.{form}")
    layer = {"gpx": "waypoints", "gpkg": "targets"}.get(form)
    meta, _, shapes, columns = pyogrio.raw.read(path, layer=layer)
    table = dict(zip(meta["fields"], columns, strict=True))
    names = table["Name" if form == "kml" and "Name" in table else "name"].tolist()
    assert names[0] == "Huber"
    assert len(shapes) == (4 if form == "geojson" else 2)
    assert meta["crs"] == "EPSG:4326"


@pytest.mark.parametrize("text", HOSTILE)
@pytest.mark.parametrize("form", FORMATS)
def test_texts_from_outside_do_no_harm_and_read_back(form, text, tmp_path):
    """Formulae, markup, control characters; ``repr`` where a format has no place for them."""
    assert exported([], form)  # nothing is a file too
    assert exported_answers([], form)
    content = exported([target(1, name=text, note=text), target(2, name="next")], form)
    if form == "geojson":
        first, second, *_ = json.loads(content)["features"]
        assert first["properties"]["name"] == text.encode(errors="backslashreplace").decode()
        assert second["properties"]["name"] == "next"
    if form == "csv":
        lines = list(csv.reader(io.StringIO(content.decode("utf-8-sig"), newline="")))
        assert len(lines) == 3
        assert not lines[1][2].startswith(("=", "+", "-", "@", "\t", "\r"))
    elif form in {"kml", "gpx"}:
        tag, mark, words = (
            (KML, "Placemark", "description") if form == "kml" else (GPX, "wpt", "desc")
        )
        first, second = ET.fromstring(content).iter(f"{tag}{mark}")
        assert second.find(f"{tag}name").text == "next"
        assert "<" not in first.find(f"{tag}{words}").text.replace("<br>", "")
    elif form == "gpkg":
        assert exported_answers([Answered(text, FOUND)], "gpkg").startswith(b"SQLite format 3\0")
    if form == "gpkg" and "\ud800" not in text:  # which the store keeps from a name
        path = written(tmp_path, content, "targets.gpkg")
        assert pyogrio.raw.read(path, layer="targets", columns=["name"])[3][0][0] == text


@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
@pytest.mark.parametrize(
    "end", ["=HYPERLINK(1)", "+1", "-1", "@SUM(1)", ' "=1', "'=1", ";=1", "\t=1", '""=1']
)
def test_no_cell_is_a_formula_with_any_separator(separator, end):
    """A spreadsheet splits at its country's separator, and then ignores quotes within a cell."""
    texts = [f"x{before}{end}" for before in ";\t|\n"]
    some = [target(n, name=text, note=text) for n, text in enumerate(texts, 1)]
    content = exported(some, "csv").decode("utf-8-sig")
    lines = csv.reader(io.StringIO(content, newline=""), delimiter=separator)
    cells = [cell.lstrip(' "') for line in lines for cell in line]
    assert not [cell for cell in cells if cell.startswith(("=", "+", "-", "@", "\t"))]


def test_the_ending_names_the_format():
    names = {"a.GPX": "gpx", "b.gpkg": "gpkg", "c.json": "geojson", "points": "geojson"}
    assert {name: form_of(name) for name in names} == names


def test_cursor_on_target_events_are_those_of_targets_at_the_pictures_time():
    (event,) = ET.fromstring(exported_answers(ANSWERS, "xml")).iter("event")
    assert event.get("time") == event.get("start") == "2021-10-20T12:00:35.605Z"
    assert event.find("detail/contact").get("callsign") == "1 sheep <1> & Ü"
    point = {key: float(value) for key, value in event.find("point").attrib.items()}
    assert point.items() >= {"lat": 39.85, "lon": 116.7, "hae": 11.5}.items()


def test_a_geopackage_holds_every_click_and_the_pictures(tmp_path):
    jpegs = {TARGETS[1].id: b"\xff\xd8 a picture"}
    path = written(tmp_path, exported(TARGETS, "gpkg", jpegs.get))
    assert read_targets(path) == TARGETS
    store = TargetStore(path)
    assert [store.picture(item.id) for item in TARGETS] == [None, b"\xff\xd8 a picture"]
    with pytest.raises(TargetError, match="another program has it open"):
        read_targets(path)
    store.close()


def test_located_pixels_are_targets_with_the_pixels_names(tmp_path):
    path = written(tmp_path, exported_answers([*reversed(ANSWERS), ANSWERS[0]], "gpkg"))
    read = read_targets(path)
    assert [item.name.replace("\x07", "") for item in read] == ["sheep <1> & Ü"] * 2
    assert len({item.id for item in read}) == len({item.number for item in read}) == 2
    # and so the page can begin with them
    store = TargetStore(written(tmp_path, exported(read, "gpkg"), "t.gpkg"))
    assert store.all() == read
    assert store.add(click(), now_ns=1).number > read[-1].number
    store.close()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a GeoPackage; give a file of targets from tirgeo"),
        (b"id,stamp_ns,u,v\n1,2,3,4\n", "not a GeoPackage"),
        (b"SQLite format 3\0" + bytes(5000), "not a GeoPackage|damaged"),
    ],
)
def test_a_file_of_another_program_is_named(content, words, tmp_path):
    path = written(tmp_path, content)
    with pytest.raises(TargetError, match=f"{re.escape(str(path))}: .*({words})"):
        read_targets(path)
    with pytest.raises(TargetError, match=r"absent\.gpkg: cannot be read"):
        read_targets(tmp_path / "absent.gpkg")
