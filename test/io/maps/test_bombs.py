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
"""Small maps that would fill the memory or take for ever: refused, in a child that is measured."""

from __future__ import annotations

import random
import sqlite3
import zipfile
from contextlib import closing

import pytest
from map_files import RING, gpb, wkb, write_geopackage
from measured import run_measured

LOAD = """
import sys
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.maps import load_layers
try:
    print(len(load_layers(*sys.argv[1:])), "layers")
except TirgeoError as error:
    print(error)
"""
COUNTING = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) "
VIEWS = {
    "counts for ever": (
        COUNTING + "SELECT count(*) AS fid, geom, name FROM c, b",
        "reading it takes more than 7 s of computing, perhaps for a view (stored query) that",
    ),
    "rows for ever": (
        COUNTING + "SELECT x AS fid, (SELECT geom FROM b) AS geom, '' AS name FROM c",
        "reading it takes more than 7 s|more than 500000 features",
    ),
    "long labels": (
        COUNTING
        + "SELECT x AS fid, (SELECT geom FROM b) AS geom, hex(randomblob(5000)) AS name FROM c",
        "reading it takes more than 7 s|does not fit into memory",
    ),
    "a geometry of a gigabyte": (
        "SELECT fid, zeroblob(1000000000) AS geom, name FROM b",
        (
            "does not fit into memory|the process that reads it ended (exit code -11); is the "
            "file damaged?"
        ),
    ),
    "a label of nearly a gigabyte": (
        "SELECT fid, geom, hex(zeroblob(490000000)) AS name FROM b",
        "does not fit into memory",
    ),
}


def check_refused(message: str, *arguments: str) -> None:
    done = run_measured(LOAD, *arguments)
    assert done.exit_code == 0, done
    assert any(each in done.said for each in message.split("|")), done
    assert done.said.startswith(arguments[-1]), done
    done.check_modest()


@pytest.mark.slow
@pytest.mark.parametrize("name", VIEWS)
def test_a_view(tmp_path, name):
    query, message = VIEWS[name]
    path = tmp_path / "map.gpkg"
    write_geopackage(path, {"a": (4326, [(gpb(wkb("LineString", RING[:2])), "a", 1)])})
    with closing(sqlite3.connect(path)) as database:
        database.executescript(f"ALTER TABLE a RENAME TO b; CREATE VIEW a AS {query}")
    check_refused(message, str(path))


@pytest.mark.slow
def test_a_view_in_another_database(tmp_path):
    path = tmp_path / "map.sqlite"
    with closing(sqlite3.connect(path)) as database:
        database.execute(
            f"CREATE VIEW v AS {COUNTING} SELECT count(*) AS n, 'POINT(1 2)' AS geometry FROM c"
        )
    check_refused("reading it takes more than 7 s of computing", str(path))


def packed(path, *pieces: str, rounds: int) -> None:
    """A KMZ of one .kml: the pieces again and again, each with a number that keeps it large."""
    dice = random.Random(5)
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("doc.kml", "w") as file,
    ):
        file.write(b'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>')
        for _ in range(rounds):
            numbers = (f"{dice.getrandbits(40):x}" for _ in range(200))
            file.write("".join(pieces[0] + number + pieces[1] for number in numbers).encode())
        file.write(b"</Document></kml>")


#: A slow processor comes to the bound of computing first.
TOO_LARGE = "does not fit into memory|reading it takes more than 7 s"
MARK = "<Placemark><Point><coordinates>1,2</coordinates></Point></Placemark>"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pieces", "rounds"),
    [(("<a/>" * 150, ""), 3000), ((MARK * 8 + "<n>", "</n>"), 1200)],
    ids=["elements", "placemarks"],
)
def test_a_kmz_that_unpacks_to_hundreds_of_megabytes(tmp_path, pieces, rounds):
    packed(tmp_path / "map.kmz", *pieces, rounds=rounds)
    check_refused(TOO_LARGE, str(tmp_path / "map.kmz"))


@pytest.mark.slow
def test_a_tag_of_a_million_attributes(tmp_path):
    attributes = " ".join(f'a{number:x}=""' for number in range(3_000_000))
    (tmp_path / "map.kml").write_text(f"<kml {attributes}></kml>")
    check_refused(TOO_LARGE, str(tmp_path / "map.kml"))


@pytest.mark.slow
def test_a_geojson_that_is_too_large(tmp_path):
    """Empty lists: three bytes of the file are sixty in memory."""
    empties = "[]," * 20_000_000
    (tmp_path / "map.geojson").write_text(
        f'{{"type":"MultiPoint","coordinates":[{empties}[16,48]]}}'
    )
    check_refused(TOO_LARGE, str(tmp_path / "map.geojson"))


def test_a_style_sheet_of_many_layers(tmp_path):
    (tmp_path / "a.geojson").write_text('{"type":"Point","coordinates":[16,48]}')
    for layers, message in (
        (20_000, "larger than 0.125 MB"),
        (2_000, "2000 layers, more than the 200 allowed"),
    ):
        sheet = tmp_path / f"{layers}.yaml"
        sheet.write_text("layers:\n" + "- {file: a.geojson, colour: red}\n" * layers)
        check_refused(message, "", str(sheet))


@pytest.mark.slow
def test_a_large_map_is_taken(tmp_path):
    """A hundred thousand houses: far smaller than the maps that are refused above."""
    ring = [(16.0 + x, 48.0 + y) for x, y in ((0, 0), (1e-4, 0), (1e-4, 1e-4), (0, 1e-4), (0, 0))]
    house = (gpb(wkb("Polygon", [ring])), "a house", 1)
    write_geopackage(tmp_path / "map.gpkg", {"a": (4326, [house] * 100_000)})
    done = run_measured(LOAD, str(tmp_path / "map.gpkg"))
    assert "1 layers" in done.said, done
    done.check_modest()
