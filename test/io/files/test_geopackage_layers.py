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
"""A GeoPackage of layers as GDAL, SQLite and the project's own map reader find it."""

from __future__ import annotations

import resource
import signal
import sqlite3
from contextlib import closing

import numpy as np
import pytest
from layers_by_gdal import layers_in, rows_of

from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.io.files.geopackage_layers import Layer, write_layers
from tirgeo_ros.io.maps import load_layers

COLUMNS = {"n": "INTEGER", "x": "REAL", "text": "TEXT", "when": "DATETIME", "yes": "BOOLEAN"}
POINTS = Layer("points", "Point Z", COLUMNS, "some points")
LINES = Layer("lines", "LineString Z", {"name": "TEXT"}, "a line")
AREAS = Layer("areas", "Polygon", {"kind": "TEXT"}, "areas")
NS = 1_634_731_235_605_999_999
SQUARE = [(16.0, 48.0), (16.1, 48.0), (16.1, 48.1), (16.0, 48.1)]


def row(number: int) -> dict[str, object]:
    text = "'é;\n<b>" if number % 2 else None
    return {"n": number, "x": number / 2, "text": text, "when": NS, "yes": bool(number % 3)}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    points = [([(16 + n / 100, 48.0, 100.0 + n)], row(n)) for n in range(7)]
    points += [([(16.0, 48.0, 0.0)], row(n) | {"x": x}) for n, x in ((7, None), (8, np.nan))]
    line = [(16.0, 48.0, 1.0), (16.1, 48.1, 2.0)]
    out = tmp_path_factory.mktemp("layers") / "out.gpkg"
    areas = AREAS, [(SQUARE, {"kind": "field"})]
    write_layers(out, [(POINTS, points), (LINES, [(line, {"name": ""})]), areas])
    return out


def test_gdal_and_a_map_reader_read_every_row_as_it_was(path):
    shapes = {"points": "Point Z", "lines": "LineString Z", "areas": "Polygon"}
    assert layers_in(path) == shapes
    rows = rows_of(path, "points")
    assert [row["n"] for row in rows] == list(range(9))
    assert rows[3]["text"] == "'é;\n<b>"
    assert rows[4]["text"] is None
    assert rows[3]["when"] == "2021-10-20T12:00:35.605Z"  # rounded down
    assert [bool(row["yes"]) for row in rows[:4]] == [False, True, True, False]
    assert [row["x"] for row in rows[:7]] == [n / 2 for n in range(7)]
    assert np.isnan([row["x"] for row in rows[7:]]).all()
    assert rows[2]["positions"].tolist() == [[16.02, 48.0, 102.0]]
    assert rows_of(path, "lines")[0]["name"] == ""
    assert rows_of(path, "lines")[0]["positions"].tolist() == [[16, 48, 1], [16.1, 48.1, 2]]
    assert rows_of(path, "areas")[0]["positions"].tolist() == [*map(list, SQUARE), [16, 48]]
    assert [each.name for each in path.parent.iterdir()] == ["out.gpkg"]
    counts = {layer.name: len(layer.features) for layer in load_layers(str(path))}
    assert counts == {"points": 9, "lines": 1, "areas": 1}


def test_it_is_what_the_standard_asks_for(path):
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
        assert db.execute("PRAGMA user_version").fetchone()[0] >= 10300
        assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert db.execute("PRAGMA foreign_key_check").fetchall() == []
        about = "SELECT table_name, data_type, description FROM gpkg_contents"
        wanted = {("points", "some points"), ("lines", "a line"), ("areas", "areas")}
        assert set(db.execute(about)) == {(name, "features", text) for name, text in wanted}
        systems = db.execute(
            "SELECT srs_id, z, m FROM gpkg_geometry_columns ORDER BY 2"
        ).fetchall()
        assert systems == [(4326, 0, 0), (4326, 1, 0), (4326, 1, 0)]


def test_a_layer_without_rows_is_there_and_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(ExportError, match=r"absent/out.gpkg: cannot be written: .*\S$"):
        write_layers(tmp_path / "absent" / "out.gpkg", [(POINTS, [])])
    write_layers(tmp_path / "empty.gpkg", [(POINTS, [])])
    assert rows_of(tmp_path / "empty.gpkg", "points") == []
    (tmp_path / "out.gpkg").mkdir()
    with pytest.raises(ExportError, match=r"out.gpkg: not a file; give the output another name"):
        write_layers(tmp_path / "out.gpkg", [(POINTS, [])])


def test_a_full_disk_leaves_no_half_file(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, hard))
    try:
        with pytest.raises(ExportError, match=r"out.gpkg: cannot be written: .*is there room"):
            write_layers(
                tmp_path / "out.gpkg",
                [(POINTS, ([[(16.0, 48.0, 1.0)], row(n)] for n in range(5000)))],
            )
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert not list(tmp_path.iterdir())
