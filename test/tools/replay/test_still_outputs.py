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

import io
import re

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import Base
from stills import PLACE_DEG, RAW, XMP, StandIn, folder_of, still_jpeg

from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.pictures.jpeg_segments import metadata_of, segments, with_metadata
from tirgeo_ros.tools.cli.main import main

GROUND = ["--ground-height", "11.5"]


def drawn(folder, output, *words):
    return main(["process", str(folder), "-o", str(output), *GROUND, *words])


@pytest.fixture
def stand_in(monkeypatch):
    return StandIn({"method": "raw"}).put(monkeypatch)


def test_each_still_is_drawn_full_size_with_its_metadata(stand_in, sample, tmp_path, capsys):
    folder, output = folder_of(tmp_path / "DCIM"), tmp_path / "out"
    assert drawn(folder, f"{output}/", "--map", str(sample / "map.geojson")) == 0
    assert "3 of 4 stills drawn" in capsys.readouterr().out
    for number in range(3):
        data = (output / f"DJI_{number:04}_T.JPG").read_bytes()
        with Image.open(io.BytesIO(data)) as picture:
            assert picture.size == (640, 512)
            assert picture.getexif()[Base.Model] == f"still {number}"
        assert RAW not in data
        assert XMP % number in data
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).astype(int)
        assert np.median(pixels) == pytest.approx(40 + number, abs=2)  # its own pixels
        colour = pixels.max(axis=2) - pixels.min(axis=2)
        assert (colour > 60).sum() > 200  # and the map's lines
    assert "/tirgeo/camera_pose" in BagReader(output / "DCIM.mcap").topics()


def test_the_page_says_why_a_still_has_no_map(stand_in, sample, tmp_path):
    stand_in.lost = (0,)
    folder, output = folder_of(tmp_path / "D&I"), tmp_path / "out"
    drawn(folder, output, "--map", str(sample / "map.geojson"))
    page = (output / "index.html").read_text()
    items = re.findall(r"<li>.*?</li>", page, re.DOTALL)
    assert len(items) == 4
    assert "<h1>D&amp;I</h1>" in page
    assert "2 of 4 stills with a trusted pose" in page
    assert "NO MAP" in items[0]
    assert '<a href="DJI_0000_T.JPG">' in items[0]
    for item in items[1:3]:
        assert "<span>drawn</span>" in item
        assert re.search(rf"39\.8493\d+, {PLACE_DEG[1]:.6f}", item)
        assert "71.5 m" in item  # 60 m above ground of 11.5 m
    assert "not drawn: it is no JPEG &lt;script&gt;" in items[3]
    assert "<script" not in page
    assert not re.search(r"(src|href)=.(https?:)?//", page)


def test_a_picture_that_cannot_be_read_is_named(stand_in, sample, tmp_path):
    folder, output = folder_of(tmp_path / "DCIM"), tmp_path / "out"
    (folder / "DJI_0001_T.JPG").write_bytes(still_jpeg(1)[:300])
    drawn(folder, output, "--map", str(sample / "map.geojson"))
    page = (output / "index.html").read_text()
    assert re.search(r"DJI_0001_T.JPG</strong><span class=.notice.>not drawn: compressed", page)
    assert (output / "DJI_0002_T.JPG").is_file()


@pytest.mark.parametrize("place", ["DCIM", "DCIM/out"])
def test_the_stills_themselves_are_never_overwritten(stand_in, tmp_path, capsys, place):
    folder = folder_of(tmp_path / "DCIM")
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert drawn(folder, tmp_path / place) == 1
    assert "the stills themselves are there: give another folder" in capsys.readouterr().err
    files = [file for file in folder.iterdir() if file.is_file()]
    assert {file.name: file.read_bytes() for file in files} == before


def test_the_quality_is_that_of_the_parameters(stand_in, tmp_path):
    folder, params = folder_of(tmp_path / "DCIM", 1), tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {jpeg_quality: 5}}")
    sizes = []
    for words in ([], ["--params", str(params)]):
        assert drawn(folder, tmp_path / f"out{len(words)}", *words) == 0
        sizes.append((tmp_path / f"out{len(words)}" / "DJI_0000_T.JPG").stat().st_size)
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
