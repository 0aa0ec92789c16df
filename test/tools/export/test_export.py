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
"""``tirgeo export`` on the sample flight: what it makes, what it counts, what it refuses."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import time

import pytest
from process_bags import IMAGES, rewritten

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.export import export as driver
from tirgeo_ros.tools.export.export import export
from tirgeo_ros.tools.export.rasters import RasterOptions
from tirgeo_ros.tools.replay.flight_pictures import FlightPictures, Window

rasterio = pytest.importorskip("rasterio")

COARSE = ["--gsd", "0.5", "--every", "4"]
MOSAIC = {
    "only": ["mosaic"],
    "window": Window(every_s=2.0),
    "rasters": RasterOptions(gsd_m=0.5),
}


@pytest.fixture(scope="module")
def products(params, nine_s, tmp_path_factory):
    """The folder of a run, and its summary."""
    folder = tmp_path_factory.mktemp("out") / "products"
    summary = export(
        nine_s,
        folder,
        params=params,
        window=Window(every_s=2.0),
        rasters=RasterOptions(gsd_m=0.25),
    )
    return folder, summary


def test_files_and_summary(products):
    folder, summary = products
    assert (summary["pictures"], summary["used"]) == (5, 4)
    assert summary["not_used"] == {"before the first pose": 1}
    assert summary["ortho"]["files"] == summary["stills"]["files"] == 4
    assert summary["vectors"]["footprints"] == summary["subtitles"]["cues"] == 4
    numbers = sorted(int(item.stem) for item in (folder / "ortho").iterdir())
    assert [b - a for a, b in itertools.pairwise(numbers)] == [18, 18, 18]  # at 9 Hz
    assert sorted(item.name for item in folder.iterdir()) == [
        *("flight.gpkg", "flight.srt"),
        *("mosaic.tif", "ortho", "stills", "summary.json"),
    ]
    assert json.loads((folder / "summary.json").read_text()) == summary
    assert summary["crs"] == "WGS 84 / UTM zone 50N (EPSG:32650)"
    assert summary["error"] is None


def test_the_rasters_are_at_their_coordinates(products):
    """All on one lattice, and an orthophoto within the mosaic."""
    folder, summary = products
    with rasterio.open(folder / "mosaic.tif") as mosaic:
        assert (mosaic.width, mosaic.height) == (
            summary["mosaic"]["width"],
            summary["mosaic"]["height"],
        )
        assert mosaic.tags()["EXPOSURES"].startswith("2021-10-20T12:00:")
        whole, transform = mosaic.bounds, mosaic.transform
    for path in (folder / "ortho").iterdir():
        with rasterio.open(path) as ortho:
            assert (ortho.res, ortho.crs.to_epsg()) == ((0.25, 0.25), 32650)
            column, row = ~transform * (ortho.bounds.left, ortho.bounds.top)
            assert abs(column - round(column)) + abs(row - round(row)) < 1e-6
            assert ortho.bounds.left >= whole.left
            assert ortho.bounds.top <= whole.top
            assert ortho.tags()["EXPOSURE"].startswith("2021-10-20T12:00:")


def test_choosing_pictures(sample):
    pictures = FlightPictures(driver.BagReader(sample / "flight.mcap"), "")
    every = pictures.chosen(Window())
    assert len(every) == 270
    assert [item.number for item in every] == list(range(270))
    some = pictures.chosen(Window(10.0, 20.0, 0.5))
    assert len(some) == 20
    assert some[0].stamp_ns - every[0].stamp_ns == pytest.approx(10e9, abs=0.12e9)
    assert set(some) <= set(every)


def refusal(capsys, *argv):
    assert main(["export", *map(str, argv)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def test_refusals(params, nine_s, tmp_path, capsys, monkeypatch):
    out, params = tmp_path / "out", ("--params", params)
    error = refusal(capsys, nine_s, "-o", out)
    assert "height of the ground not known: give --ground-height or --dem" in error
    assert "needed topic absent: /uav1/thermal" in refusal(
        capsys, nine_s, "-o", out, "--namespace", "uav1"
    )
    blind = tmp_path / "blind.mcap"
    rewritten(nine_s, blind, seconds=1.0, without=(IMAGES,))
    error = refusal(capsys, blind, "-o", out, *params)
    assert "needed topic absent: /thermal/image_raw or /thermal/image_raw/compressed" in error
    error = refusal(capsys, nine_s, "-o", out, *params, "--to", "1")
    assert "none of 1 pictures has a trusted pose: no pose near the exposure; the filter" in error
    error = refusal(capsys, nine_s, "-o", out, *params, *COARSE, "--degrees", "0.04", "-273.15")
    assert "--degrees is for 16-bit video" in error
    assert not [item for item in out.rglob("*") if item.is_file()]
    monkeypatch.setitem(sys.modules, "rasterio", None)
    error = refusal(capsys, nine_s, "-o", out, *params)
    assert 'mosaics needs rasterio: pip install "tirgeo[dem]"' in error


@pytest.mark.parametrize("wrong", [("--gsd", "0"), ("--grazing", "90"), ("--only", "tea")])
def test_wrong_use(sample, tmp_path, capsys, wrong):
    with pytest.raises(SystemExit) as ended:
        main(["export", str(sample / "flight.mcap"), "-o", str(tmp_path / "out"), *wrong])
    assert ended.value.code == 2
    assert wrong[0].strip("-") in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_pictures_that_do_not_fit_are_counted(params, nine_s, tmp_path, monkeypatch):
    """A damaged picture, and one of another size, as `read` gives them."""
    read = FlightPictures.read

    def some(self, numbers):
        for k, (number, pixels) in enumerate(read(self, numbers)):
            yield number, (MapError("cut"), pixels[:-2], pixels.astype("u2"), pixels)[(k + 3) % 4]

    monkeypatch.setattr(FlightPictures, "read", some)
    summary = export(nine_s, tmp_path, params=params, **MOSAIC)
    assert summary["not_used"] == {
        "before the first pose": 1,
        "damaged": 1,
        "of another size than the camera's calibration": 1,
        "of another kind than the first picture": 1,
    }
    assert (summary["used"], summary["error"]) == (1, None)
    monkeypatch.setattr(
        FlightPictures, "read", lambda _, numbers: ((n, MapError("")) for n in numbers)
    )
    summary = export(nine_s, tmp_path, params=params, **MOSAIC)
    assert summary["error"].endswith("none of its pictures could be used")
    assert summary["mosaic"]["width"] == 0


def test_damaged_pictures_are_counted(params, nine_s, tmp_path):
    """From 5 s on their messages end within the header; all that is before is used."""
    last_ns = driver.BagReader(nine_s).span_ns[0] + 5_000_000_000

    def cut_short(item):
        damaged = item.topic == IMAGES and item.log_time_ns > last_ns
        return item.topic, item.data[:6] if damaged else item.data

    bag = rewritten(nine_s, tmp_path / "damaged.mcap", cut_short)
    summary = export(bag, tmp_path / "out", params=params, **MOSAIC)
    assert sorted(each.name for each in (tmp_path / "out").iterdir()) == [
        *("mosaic.tif", "summary.json"),
    ]
    assert summary["not_used"] == {"before the first pose": 1, "damaged": 2}
    assert summary["used"] == 2


@pytest.mark.slow
def test_a_stopped_run_leaves_no_half_file(sample, tmp_path):
    """Stopped while it writes orthophotos: each file is whole, and no tile is left."""
    code = "from tirgeo_ros.tools.cli.main import console; console()"
    argv = [sys.executable, "-c", code, "export", str(sample / "flight.mcap"), "-o", str(tmp_path)]
    argv += ["--params", str(sample / "params.yaml"), "--every", "0"]
    run = subprocess.Popen(argv, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
    deadline_s = time.monotonic() + 60
    while len(list(tmp_path.glob("ortho/0*.tif"))) < 3 and time.monotonic() < deadline_s:
        time.sleep(0.05)
    run.terminate()
    assert run.wait(60) == 143
    files = [item for item in tmp_path.rglob("*") if item.is_file()]
    assert len(files) >= 3
    assert {item.parent.name for item in files} == {"ortho", "stills"}
    for path in tmp_path.glob("ortho/*"):
        with rasterio.open(path) as whole:
            assert whole.read(2).max() == 255
