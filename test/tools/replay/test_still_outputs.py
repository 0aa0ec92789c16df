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
"""Stills as outputs: their pixels, EXIF and XMP, the contact page, folders that are refused."""

from __future__ import annotations

import csv
import io
import math
import re

import cv2
import numpy as np
import pytest
from PIL import Image
from stills import GROUND_M, RAW, name_of, still_jpeg, strip, write_folder, write_ground

from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.pictures.jpeg_segments import metadata_of, segments, with_metadata
from tirgeo_ros.tools.cli.main import main

STILLS = strip()[:3]
GROUND = ["--ground-height", str(GROUND_M)]


@pytest.fixture
def folder(tmp_path):
    write_ground(tmp_path, STILLS)
    return write_folder(tmp_path / "D&I", STILLS)


def drawn(folder, output, *words):
    given = ["--map", str(folder.parent / "map.geojson"), *GROUND, *words]
    return main(["process", str(folder), "-o", str(output), *given])


def items_of(output):
    return re.findall(r"<li>.*?</li>", (output / "index.html").read_text(), re.DOTALL)


def test_each_still_is_drawn_full_size_with_its_metadata(folder, tmp_path, capsys):
    output = tmp_path / "out"
    assert drawn(folder, f"{output}/") == 0
    assert "3 of 3 stills drawn" in capsys.readouterr().out
    rows = csv.DictReader((tmp_path / "observations.csv").read_text().splitlines())
    marks = {name_of(n): [] for n in range(3)}
    for row in rows:
        marks[row["picture"]].append((round(float(row["u"])), round(float(row["v"]))))
    for number, still in enumerate(STILLS):
        data = (output / name_of(number)).read_bytes()
        assert RAW not in data
        assert metadata_of(data) == metadata_of(still.jpeg())
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).astype(int)
        assert pixels.shape == (512, 640, 3)
        colour = pixels.max(axis=2) - pixels.min(axis=2)
        assert len(marks[name_of(number)]) > 1
        for u, v in marks[name_of(number)]:  # where the map's line has its corners
            assert colour[v - 2 : v + 3, u - 2 : u + 3].max() > 60
    assert "/tirgeo/camera_pose" in BagReader(output / "D&I.mcap").topics()


def test_the_page_has_each_still_and_says_what_is_missing(folder, tmp_path):
    (folder / "<script>.txt").write_text("of the flight")
    (folder / name_of(1)).write_bytes(STILLS[1].jpeg()[:-300])
    drawn(folder, tmp_path / "out")
    page, items = (tmp_path / "out" / "index.html").read_text(), items_of(tmp_path / "out")
    assert "<h1>D&amp;I</h1>" in page
    assert "2 of 4 stills with a trusted pose" in page
    assert "<script" not in page
    assert not re.search(r"(src|href)=.(https?:)?//", page)
    for item, still in zip(items[:2], STILLS[::2], strict=True):
        *angles, height_m = still.geodetic
        latitude, longitude = map(math.degrees, angles)
        assert "<span>drawn</span>" in item
        assert f"{latitude:.6f}, {longitude:.6f}, {height_m:.1f} m" in item
    assert f'<a href="{name_of(0)}">' in items[0]
    assert "not drawn: it is no JPEG" in items[2]
    assert re.search(rf"{name_of(1)}</strong><span class=.notice.>not drawn: it is cut", items[3])


def test_a_still_without_a_pose_is_written_with_its_notice(folder, tmp_path, capsys):
    assert drawn(folder, tmp_path / "out", "--method", "ekf") == 1
    assert "neither rates nor forces: use method raw or rtk" in capsys.readouterr().err
    for number, item in enumerate(items_of(tmp_path / "out")):
        assert "NO MAP" in item
        assert (tmp_path / "out" / name_of(number)).is_file()


@pytest.mark.parametrize("place", ["D&I", "D&I/out"])
def test_the_stills_themselves_are_never_overwritten(folder, tmp_path, capsys, place):
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert drawn(folder, tmp_path / place) == 1
    assert "the stills themselves are there: give another folder" in capsys.readouterr().err
    assert main(["process", str(folder / name_of(0)), "-o", str(folder), *GROUND]) == 1
    assert f"{name_of(0)}: would overwrite the input" in capsys.readouterr().err
    files = [file for file in folder.iterdir() if file.is_file()]
    assert {file.name: file.read_bytes() for file in files} == before


def test_the_quality_is_that_of_the_parameters(folder, tmp_path):
    params = tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {jpeg_quality: 5}}")
    sizes = []
    for words in ([], ["--params", str(params)]):
        assert drawn(folder, tmp_path / f"out{len(words)}", *words) == 0
        sizes.append((tmp_path / f"out{len(words)}" / name_of(0)).stat().st_size)
    assert sizes[1] < sizes[0]


@pytest.mark.parametrize("damage", [0, 2, 3, 9, 20])
def test_a_cut_file_gives_the_whole_segments(damage):
    cut = still_jpeg(1)[:damage]
    assert len([*segments(cut)]) == (damage == 20)
    assert metadata_of(cut) == b""


def test_metadata_stand_after_jfif():
    plain = io.BytesIO()
    Image.new("L", (8, 8)).save(plain, "JPEG")
    joined = with_metadata(plain.getvalue(), metadata_of(still_jpeg(7)))
    assert [marker for marker, _ in segments(joined)][:3] == [0xE0, 0xE1, 0xE1]
    assert with_metadata(b"\xff\xd8\xff\xd9", b"M") == b"\xff\xd8M\xff\xd9"
