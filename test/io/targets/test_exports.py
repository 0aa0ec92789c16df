"""Targets and located pixels in the formats of others: what their readers find."""

from __future__ import annotations

import csv
import io
import json
import math
from xml.etree import ElementTree as ET

import numpy as np
import pyogrio
import pytest
from target_samples import ANSWERS, COVARIANCE, FOUND, HOSTILE, STAMP_NS, TARGETS, click, target

from tirgeo_ros.io.surveys.survey import Answered
from tirgeo_ros.io.targets.formats import FORMATS, cot, exported, exported_answers, form_of

KML = "{http://www.opengis.net/kml/2.2}"
GPX = "{http://www.topografix.com/GPX/1/1}"
SCALE_95 = math.sqrt(5.991464547)  # chi-square, two degrees of freedom


def features(answers):
    return json.loads(exported_answers(answers, "geojson"))["features"]


def test_geojson_points_in_order_and_then_ellipses():
    found = features(ANSWERS)
    assert [(f["properties"]["kind"], f["properties"]["id"]) for f in found] == [
        ("point", ANSWERS[0].id),
        ("point", "cloud"),
        ("ellipse", ANSWERS[0].id),
    ]
    point = found[0]
    assert point["geometry"] == {"type": "Point", "coordinates": [116.7, 39.85, 11.5]}
    said = point["properties"]
    assert (said["stamp_ns"], said["u"], said["v"], said["reason"]) == (
        STAMP_NS,
        320.5,
        256.25,
        None,
    )
    assert said["ellipse_major_m"] == pytest.approx(2 * SCALE_95, abs=1e-4)
    assert said["ellipse_minor_m"] == pytest.approx(0.5 * SCALE_95, abs=1e-4)
    assert said["ellipse_azimuth_deg"] == pytest.approx(30, abs=1e-3)
    assert said["sigma_height_m"] == pytest.approx(0.1)
    assert said["sigma_north_m"] == pytest.approx(math.sqrt(COVARIANCE[1, 1]), abs=1e-4)
    ring = found[2]["geometry"]["coordinates"][0]
    assert [list(reversed(corner)) for corner in ring] == [list(c) for c in click().outline()]


def test_a_refused_pixel_has_no_geometry_but_a_reason():
    located, refused, _ = features(ANSWERS)
    assert refused["geometry"] is None
    assert refused["properties"]["reason"] == "the pixel is above the horizon"
    assert refused["properties"]["stamp_ns"] == STAMP_NS + 5
    assert refused["properties"]["height_m"] is None
    assert list(refused["properties"]) == list(located["properties"])


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
    of_pixels = set(features(ANSWERS)[0]["properties"]) - {"u", "v", "reason"}
    assert of_pixels <= set(point["properties"])
    assert [one["properties"]["kind"] for one in ellipses] == ["ellipse"] * 2


def test_csv_is_one_line_a_target_that_excel_knows_as_utf_8():
    content = exported(TARGETS, "csv")
    assert content.startswith(b"\xef\xbb\xbfid,number,name,")
    rows = list(csv.DictReader(io.StringIO(content.decode("utf-8-sig"), newline="")))
    assert [(row["number"], row["name"], row["target_kind"]) for row in rows] == [
        ("1", "Huber", "fire"),
        ("3", "", "person"),
    ]
    assert (rows[0]["latitude_deg"], rows[0]["mgrs"]) == ("39.85", "50S MK 74336 11151")
    assert rows[0]["utm"].startswith("50S 474336.")
    assert exported([], "csv").decode("utf-8-sig").split(",")[:2] == ["id", "number"]


def test_gpx_waypoints_are_as_the_schema_orders_them():
    root = ET.fromstring(exported(TARGETS, "gpx"))
    assert (root.tag, root.get("version"), root.get("creator")) == (f"{GPX}gpx", "1.1", "tirgeo")
    first, second = root.findall(f"{GPX}wpt")
    assert first.attrib == {"lat": "39.850000000", "lon": "116.700000000"}
    assert [child.tag.removeprefix(GPX) for child in first] == [
        "time",
        "name",
        "cmt",
        "desc",
        "type",
    ]
    assert first.find(f"{GPX}name").text == "Huber"
    assert first.find(f"{GPX}desc").text.startswith("roof west; 95 % within 4.90 x 1.22 m")
    assert second.find(f"{GPX}name").text == "3 person"


def test_the_date_line_is_west_in_gpx():
    """The schema wants longitudes below 180."""
    point = ET.fromstring(exported([target(1, at(0.0, 180.0))], "gpx"))[0]
    assert point.get("lon") == "-180.000000000"


@pytest.mark.parametrize("form", ["geojson", "kml", "gpx", "gpkg"])
def test_gdal_reads_each_format(form, tmp_path):
    path = tmp_path / f"targets.{form}"
    path.write_bytes(exported(TARGETS, form))
    layer = {"gpx": "waypoints", "gpkg": "targets"}.get(form)
    meta, _, shapes, columns = pyogrio.raw.read(path, layer=layer)
    said = dict(zip(meta["fields"], columns, strict=True))
    names = said["Name" if form == "kml" and "Name" in said else "name"].tolist()
    assert names[0] == "Huber"
    assert len(shapes) == (4 if form == "geojson" else 2)
    assert meta["crs"] == "EPSG:4326"


@pytest.mark.parametrize("text", HOSTILE)
@pytest.mark.parametrize("form", FORMATS)
def test_texts_from_outside_do_no_harm(form, text, tmp_path):
    """Formulae, markup, control characters; ``repr`` where a format has no place for them."""
    written = exported([target(1, name=text, note=text), target(2, name="next")], form)
    if form == "csv":
        rows = list(csv.reader(io.StringIO(written.decode("utf-8-sig"), newline="")))
        assert len(rows) == 3
        assert not rows[1][2].startswith(("=", "+", "-", "@", "\t", "\r"))
    elif form == "geojson":
        first, second = json.loads(written)["features"][:2]
        assert first["properties"]["name"] == text.replace("\ud800", "\\ud800")
        assert second["properties"]["name"] == "next"
    elif form in {"kml", "gpx"}:
        tag = KML if form == "kml" else GPX
        marks = list(
            ET.fromstring(written).iter(f"{tag}{'Placemark' if form == 'kml' else 'wpt'}")
        )
        assert [mark.find(f"{tag}name").text for mark in marks][1] == "next"
        shown = marks[0].find(f"{tag}{'description' if form == 'kml' else 'desc'}").text
        assert "<" not in shown.replace("<br>", "")
    elif "\ud800" not in text:  # which the store keeps from a name
        path = tmp_path / "targets.gpkg"
        path.write_bytes(written)
        assert pyogrio.raw.read(path, layer="targets", columns=["name"])[3][0][0] == text


@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
@pytest.mark.parametrize(
    "end", ["=HYPERLINK(1)", "+1", "-1", "@SUM(1)", ' "=1', "'=1", ";=1", "\t=1", '""=1']
)
def test_no_cell_is_a_formula_whatever_separates_the_cells(separator, end):
    """A spreadsheet splits at what its country has, and takes no quotes within a cell then."""
    texts = [f"x{before}{end}" for before in ";\t|\n"]
    rows = [target(n, name=text, note=text) for n, text in enumerate(texts, 1)]
    content = exported(rows, "csv").decode("utf-8-sig")
    lines = csv.reader(io.StringIO(content, newline=""), delimiter=separator)
    cells = [cell.lstrip(' "') for line in lines for cell in line]
    assert not [cell for cell in cells if cell.startswith(("=", "+", "-", "@", "\t"))]


def test_a_hostile_pixel_id_does_no_harm_in_a_geopackage():
    for text in HOSTILE:
        assert exported_answers([Answered(text, FOUND)], "gpkg").startswith(b"SQLite format 3\0")


@pytest.mark.parametrize("form", FORMATS)
def test_nothing_is_a_file_too(form):
    assert exported([], form)
    assert exported_answers([], form)


def test_the_ending_names_the_format():
    assert [form_of(name) for name in ("a.GPX", "b.gpkg", "c.json", "points")] == [
        "gpx",
        "gpkg",
        "geojson",
        "geojson",
    ]


def at(latitude_deg, longitude_deg):
    one = click()
    return type(one)(one.stamp_ns, latitude_deg, longitude_deg, 0.0, one.covariance_enu)


def test_cursor_on_target_events_are_those_of_targets_with_ce90_and_le90():
    events = list(ET.fromstring(cot(ANSWERS)).iter("event"))
    assert len(events) == 1
    event = events[0].attrib
    assert event["uid"].startswith("tirgeo-")
    assert (event["version"], event["type"], event["how"]) == ("2.0", "b-m-p-s-m", "m-i")
    assert event["time"] == event["start"] == "2021-10-20T12:00:35.605Z"
    assert event["stale"] == "2021-10-21T12:00:35.605Z"
    assert events[0].find("detail/contact").get("callsign") == "1 sheep <1> & Ü"
    assert "CE90" in events[0].find("detail/remarks").text
    point = {key: float(value) for key, value in events[0].find("point").attrib.items()}
    ce90_m, le90_m = point.pop("ce"), point.pop("le")
    assert point == {"lat": 39.85, "lon": 116.7, "hae": 11.5}
    # 90 % of a normal distribution with these sigmas lie in the circle: drawn, to 4 sigma of 4e5
    drawn = np.random.default_rng(1).normal(size=(400_000, 2)) * [2.0, 0.5]
    share = np.mean(np.hypot(*drawn.T) <= ce90_m)
    assert abs(share - 0.9) < 4 * math.sqrt(0.09 / 400_000)
    assert le90_m == pytest.approx(0.1 * 1.644854, abs=1e-3)
