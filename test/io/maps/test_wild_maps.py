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
"""Maps as people have them, and damaged ones: read as they were written, or refused by name."""

from __future__ import annotations

import json
import random
import re
import tracemalloc
import warnings

import numpy as np
import pytest
from map_files import HOLE, RING
from wild_map_files import (
    ELSEWHERE,
    LINE,
    READ,
    REFUSED,
    collection,
    feature,
    geopackage,
    kml,
    kmz,
    mark,
    named,
    shapefile,
    text,
)

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps import load_layers
from tirgeo_ros.io.maps.layers import read_layers

CLOSE_DEG = 1e-8  # a millimetre
WHERE = {case: (name, write, RING, notes) for case, (name, write, notes) in READ.items()}


def written(folder, name, write):
    path = folder / name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of GDAL on what a format cannot keep
        write(path)
    return path


def drawn(path):
    """Longitudes and latitudes (N, 2) deg of all features."""
    features = [f for layer in read_layers(str(path)) for f in layer.features]
    return np.degrees(np.concatenate([f.points for f in features])[:, 1::-1])


def check_same(got, wanted):
    """Each position is in the other set, and the reverse; 180 is -180."""
    got, wanted = np.asarray(got), np.asarray(wanted)
    apart = np.abs(got[:, None] - wanted[None])
    apart[..., 0] = np.minimum(apart[..., 0], np.abs(360 - apart[..., 0]))
    apart = apart.max(axis=2)
    assert apart.min(axis=1).max() < CLOSE_DEG
    assert apart.min(axis=0).max() < CLOSE_DEG


@pytest.mark.parametrize("case", [*WHERE, *ELSEWHERE])
def test_a_map_is_read_where_it_lies(tmp_path, case):
    name, write, places, notes = {**WHERE, **ELSEWHERE}[case]
    path = written(tmp_path, name, write)
    before = sorted(tmp_path.iterdir())
    check_same(drawn(path), places)
    reports = [note for layer in read_layers(str(path)) for note in layer.left_out]
    assert len(reports) == len(notes), reports
    for note, pattern in zip(reports, notes, strict=True):
        assert note.startswith(f"{path}: ")
        assert re.search(pattern, note), note
    assert sorted(tmp_path.iterdir()) == before  # nothing is left beside the map


def test_the_encoding_that_a_shapefile_names(tmp_path):
    name, write, _ = READ["shapefile, letters by .cpg"]
    path = written(tmp_path, name, write)
    assert read_layers(str(path))[0].features[0].label == "消防栓"


@pytest.mark.parametrize("case", REFUSED)
def test_a_map_is_refused_by_name_with_what_to_do(tmp_path, case):
    name, write, message = REFUSED[case]
    path = written(tmp_path, name, write)
    with pytest.raises(MapError, match=message) as caught:
        read_layers(str(path))
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


ROUNDS = 150
ROUNDS_OF = {".prj": 20}  # an unknown name of a system is looked for far and wide by PROJ
#: A reader may hold its file some times over, never what a damaged count tells of.
MOST_BYTES = 32 << 20


MAKERS = {
    "a.geojson": text(collection(*[feature("MultiPolygon", [[RING, HOLE]])] * 3)),
    "a.gpkg": geopackage(),
    "a.kml": text(kml(f"<Folder>{mark('Grün', LINE) * 3}</Folder>")),
    "a.kmz": kmz,
    "a.shp": shapefile("EPSG:4326", name="Grün"),
}


def damaged(content, rng):
    """The bytes cut somewhere, or with some of them or a run of them changed."""
    content = bytearray(content)
    way = rng.randrange(4)
    if way == 0:
        return content[: rng.randrange(len(content))]
    at = rng.randrange(len(content))
    if way == 1:
        content[at : at + 4] = rng.choice([b"\xff" * 4, b"\0" * 4, b"\x7f\xff\xff\xff"])
    for _ in range(rng.choice([1, 1, 3, 20]) if way > 1 else 0):
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    return content


def check(path):
    """Load; the result is a map of finite coordinates, or a message of one line."""
    try:
        layers = read_layers(str(path))
    except MapError as error:
        text = str(error)
    else:
        text = ""
    if text:
        assert text.startswith(str(path))
        assert "\n" not in text
        return False
    points = np.concatenate([f.points for layer in layers for f in layer.features])
    assert np.isfinite(points[:, :2]).all()
    assert not np.isinf(points[:, 2]).any()
    return True


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "suffix"),
    [*((name, "") for name in MAKERS), ("a.shp", ".dbf"), ("a.shp", ".prj"), ("a.shp", ".cpg")],
)
def test_damaged_files(tmp_path, name, suffix):
    path = tmp_path / name
    MAKERS[name](path)
    spoilt = path.with_suffix(suffix) if suffix else path
    if not spoilt.exists():
        spoilt.write_text("UTF-8")
    content = spoilt.read_bytes()
    assert check(path)
    rng = random.Random(5)
    results = []
    rounds = ROUNDS_OF.get(suffix, ROUNDS)
    tracemalloc.start()
    try:
        for _ in range(rounds):
            spoilt.write_bytes(damaged(content, rng))
            results.append(check(path))
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < MOST_BYTES
    assert results.count(False) > (rounds // 20 if suffix != ".cpg" else -1)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.kml", kml(mark("a", LINE.replace(",", ",x", 1))), "is not lon,lat"),
        ("a.kml", kml(mark("a", LINE.replace(".", ",", 2))), "is not lon,lat"),
        ("a.kml", kml(mark("a", LINE.replace(",", ",,", 1))), "is not lon,lat"),
        ("a.kml", kml("<coordinates>" + "1" * 1_000_000 + "</coordinates>"), "is not lon,lat"),
        ("a.kml", kml("<gx:coord>x16 48 0</gx:coord>"), "'x16,48,0' is not lon,lat"),
        (
            "a.geojson",
            collection(feature(), **named("EPSG:99999")),
            "unknown coordinate reference system 'EPSG:99999'",
        ),
    ],
    ids=["letter", "decimal comma", "empty", "long", "track", "crs"],
)
def test_what_gdal_would_draw_in_a_wrong_place_is_refused(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(MapError, match=message):
        load_layers(str(path))


def test_a_map_cannot_read_stdin_of_its_reader(tmp_path):
    """A description that names stdin would wait for the next task for ever."""
    path = tmp_path / "a.vrt"
    path.write_text(
        "<OGRVRTDataSource><OGRVRTLayer name='a'><SrcDataSource>/vsistdin/</SrcDataSource>"
        "</OGRVRTLayer></OGRVRTDataSource>"
    )
    with pytest.raises(MapError, match=r"a\.vrt: not a readable map"):
        load_layers(str(path))


def test_a_line_of_geojson_that_is_damaged_is_counted(tmp_path):
    lines = [json.dumps(feature("Point", place)) for place in RING[:3]]
    (tmp_path / "a.geojsonl").write_text("\n".join([lines[0], lines[1][:40], lines[2]]))
    (layer,) = read_layers(str(tmp_path / "a.geojsonl"))
    assert len(layer.features) == 2
    assert layer.left_out[0].endswith("1 damaged lines left out")
