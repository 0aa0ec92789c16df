"""A GeoPackage of layers as GDAL, SQLite and the project's own map reader find it."""

from __future__ import annotations

import re
import resource
import signal
import sqlite3
from contextlib import closing
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from layers_by_gdal import layers_in, rows_of

from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.io.geopackage.layers import Layer, LayerFile
from tirgeo_ros.io.maps import load_layers
from tirgeo_ros.tools.export.vectors import area, by_value, line, marker, single

COLUMNS = {"n": "INTEGER", "x": "REAL", "text": "TEXT", "when": "DATETIME", "yes": "BOOLEAN"}
POINTS = Layer(
    "points", "Point Z", COLUMNS, "some points", single(marker("circle", "0,0,0,255", 2))
)
LINES = Layer("lines", "LineString Z", {"name": "TEXT"}, "a line", single(line("0,0,0,255", 0.5)))
AREAS = Layer("areas", "Polygon", {"kind": "TEXT"}, "areas", single(area("1,1,1,9", "2,2,2,9", 1)))
ANGLE = "layer/data_defined_properties//Option[@name='angle']"
NS = 1_634_731_235_605_999_999
SQUARE = [(16.0, 48.0), (16.1, 48.0), (16.1, 48.1), (16.0, 48.1)]


def row(number: int) -> dict[str, object]:
    text = "'é;\n<b>" if number % 2 else None
    return {"n": number, "x": number / 2, "text": text, "when": NS, "yes": bool(number % 3)}


def add_points(file: LayerFile, count: int) -> None:
    for number in range(count):
        file.add("points", [(16.0, 48.0, 1.0)], row(number))


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    file = LayerFile(tmp_path_factory.mktemp("layers") / "out.gpkg", [POINTS, LINES, AREAS])
    for number in range(7):
        file.add("points", [(16 + number / 100, 48.0, 100.0 + number)], row(number))
    file.add("points", [(16.0, 48.0, 0.0)], row(7) | {"x": None})
    file.add("points", [(16.0, 48.0, 0.0)], row(8) | {"x": np.nan})
    file.add("lines", [(16.0, 48.0, 1.0), (16.1, 48.1, 2.0)], {"name": ""})
    file.add("areas", SQUARE, {"kind": "field"})
    assert not file.path.exists()  # before it is complete
    file.finish()
    assert file.counts == {"points": 9, "lines": 1, "areas": 1}
    return file.path


def test_gdal_reads_every_row_as_it_was(path):
    shapes = {"points": "Point Z", "lines": "LineString Z", "areas": "Polygon"}
    assert layers_in(path) == shapes | {"layer_styles": None}
    found = rows_of(path, "points")
    assert [one["n"] for one in found] == list(range(9))
    assert found[3]["text"] == "'é;\n<b>"
    assert found[4]["text"] is None
    assert found[3]["when"] == "2021-10-20T12:00:35.605Z"  # rounded down
    assert [bool(one["yes"]) for one in found[:4]] == [False, True, True, False]
    assert [one["x"] for one in found[:7]] == [n / 2 for n in range(7)]
    assert np.isnan([one["x"] for one in found[7:]]).all()
    assert found[2]["positions"].tolist() == [[16.02, 48.0, 102.0]]
    assert rows_of(path, "lines")[0]["name"] == ""
    assert rows_of(path, "lines")[0]["positions"].tolist() == [[16, 48, 1], [16.1, 48.1, 2]]
    assert rows_of(path, "areas")[0]["positions"].tolist() == [*map(list, SQUARE), [16, 48]]
    assert [one.name for one in path.parent.iterdir()] == ["out.gpkg"]


def test_it_is_what_the_standard_asks_for(path):
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
        assert db.execute("PRAGMA user_version").fetchone()[0] >= 10300
        assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert db.execute("PRAGMA foreign_key_check").fetchall() == []
        kinds = dict(db.execute("SELECT table_name, data_type FROM gpkg_contents"))
        layers = dict.fromkeys(("points", "lines", "areas"), "features")
        assert kinds == layers | {"layer_styles": "attributes"}
        about = db.execute("SELECT description FROM gpkg_contents WHERE table_name = 'points'")
        assert about.fetchone() == ("some points",)
        indexed = db.execute("SELECT table_name, extension_name FROM gpkg_extensions").fetchall()
        assert set(indexed) == {(name, "gpkg_rtree_index") for name in layers}
        assert db.execute("SELECT count(*) FROM rtree_points_geom").fetchone() == (9,)
        systems = db.execute(
            "SELECT srs_id, z, m FROM gpkg_geometry_columns ORDER BY 2"
        ).fetchall()
        assert systems == [(4326, 0, 0), (4326, 1, 0), (4326, 1, 0)]


def test_the_index_finds_what_is_near(path):
    near = rows_of(path, "points", bbox=(16.015, 47.9, 16.035, 48.1))
    assert [one["n"] for one in near] == [2, 3]


def test_a_layer_without_rows_is_there(tmp_path):
    file = LayerFile(tmp_path / "out.gpkg", [POINTS])
    file.finish()
    assert rows_of(file.path, "points") == []


def test_a_map_reader_takes_it(path):
    found = {layer.name: len(layer.features) for layer in load_layers(str(path))}
    assert found == {"points": 9, "lines": 1, "areas": 1}


def test_what_was_not_finished_leaves_nothing(tmp_path):
    file = LayerFile(tmp_path / "out.gpkg", [POINTS])
    assert list(tmp_path.iterdir())
    file.close()
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(ExportError, match=r"absent/out.gpkg: cannot be written: .*\S$"):
        LayerFile(tmp_path / "absent" / "out.gpkg", [POINTS])
    (tmp_path / "out.gpkg").mkdir()
    with pytest.raises(ExportError, match=r"out.gpkg: not a file; give the output another name"):
        LayerFile(tmp_path / "out.gpkg", [POINTS])


def test_a_full_disk_leaves_no_half_file(tmp_path):
    file = LayerFile(tmp_path / "out.gpkg", [POINTS])
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, hard))
    try:
        with pytest.raises(ExportError, match=r"out.gpkg: cannot be written: .*is there room"):
            add_points(file, 5000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    file.close()
    assert not list(tmp_path.iterdir())


def test_qgis_finds_the_style_of_each_layer(path):
    """By the question that QGIS asks, through GDAL as QGIS does."""
    for layer in (POINTS, LINES, AREAS):
        asked = (
            f"f_table_schema='' AND f_table_name='{layer.name}' AND f_geometry_column='geom' "
            "ORDER BY CASE WHEN useAsDefault THEN 1 ELSE 2 END, update_time DESC LIMIT 1"
        )
        sql = f"SELECT styleQML, useAsDefault FROM layer_styles WHERE {asked}"
        (found,) = rows_of(path, None, sql=sql)
        assert found["styleQML"] == layer.style
        assert found["useAsDefault"]


def test_a_style_holds_symbols_and_label():
    kinds = {
        "fire": marker("circle", "255,0,0,255", 3),
        "a<b": marker("star", "0,0,0,255", 3, "t"),
    }
    text = by_value("kind", kinds, label='"name" || 1')
    assert text.startswith("<!DOCTYPE qgis PUBLIC")
    root = ET.fromstring(text)
    assert (root.tag, root.get("labelsEnabled")) == ("qgis", "1")
    renderer = root.find("renderer-v2")
    assert renderer.get("attr") == "kind"
    categories = {one.get("value"): one.get("symbol") for one in renderer.iter("category")}
    symbols = {one.get("name"): one for one in renderer.iter("symbol")}
    assert categories == {"fire": "0", "a<b": "1"}
    assert set(symbols) == set(categories.values())
    colour = symbols["0"].find("layer/prop[@k='color']").get("v")
    assert symbols["0"].find("layer/Option/Option[@name='color']").get("value") == colour
    assert re.fullmatch(r"(\d+,){3}\d+", colour)
    turned = symbols["1"].find(ANGLE)
    assert {one.get("name"): one.get("value") for one in turned} == {
        "active": "true",
        "field": "t",
        "type": "2",
    }
    assert symbols["0"].find(ANGLE) is None
    assert root.find("labeling/settings/text-style").get("fieldName") == '"name" || 1'
