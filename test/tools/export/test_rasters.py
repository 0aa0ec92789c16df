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
"""Orthophotos of frames and their mosaic: values, places, kinds, and tiles on disk."""

from __future__ import annotations

import numpy as np
import pytest
from coded_frames import (
    CAMERA,
    CODE_M,
    GROUND_M,
    NADIR,
    OBLIQUE,
    PIXEL_M,
    UTM,
    WHOLE,
    coded,
    frame_of,
    setup_of,
)
from scenes import PLANE, camera_pose

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.tools.export import rasters
from tirgeo_ros.tools.export.rasters import Mosaic, Orthophotos, RasterOptions, raster_setup

rasterio = pytest.importorskip("rasterio")

SHAPE = CAMERA.height, CAMERA.width
NOISE = np.random.default_rng(8).integers(0, 60_000, SHAPE).astype(np.uint16)
COLOURS = np.dstack([NOISE // 6000, NOISE // 3000, NOISE // 1000]).astype(np.uint8)


def mosaic_of(folder, frames, **options):
    folder.mkdir(exist_ok=True)
    mosaic = Mosaic(folder, setup_of(**options))
    for frame in frames:
        mosaic.take(frame)
    assert mosaic.finish()["width"] > 0
    return folder / "mosaic.tif"


def flown(pixels):
    """Frames on a way of 30 m, all with the same pixels."""
    poses = [camera_pose([3.0 * k, -2.0, -20.0], 0.0, -60.0, 5.0 * k) for k in range(6)]
    return [frame_of(pixels, pose, k) for k, pose in enumerate(poses)]


def test_a_pixel_shows_the_ground_at_its_coordinates(tmp_path):
    """The whole way, with the file's own transform: within half a pixel, as everywhere."""
    picture, corner = coded(OBLIQUE, GROUND_M)
    product = Orthophotos(tmp_path / "ortho", setup_of())
    product.take(frame_of(picture, OBLIQUE, 12))
    assert product.finish()["files"] == 1
    with rasterio.open(tmp_path / "ortho" / "000012.tif") as file:
        assert file.crs.to_epsg() == UTM.system.to_epsg()
        assert file.tags()["PICTURE"] == "12"
        red, green, blue, alpha = file.read().astype(float)
        rows, columns = np.nonzero((red == WHOLE) & (alpha > 0))
        x, y = (np.array(item) for item in file.transform * (columns + 0.5, rows + 0.5))
    assert len(rows) > 4000
    # Red is the third value of a BGR picture.
    shown = np.stack([blue[rows, columns], green[rows, columns]], 1) * CODE_M + corner
    assert np.abs(shown - np.stack([x, y], 1)).max() < 0.5 * PIXEL_M


def test_nearest_keeps_the_values_of_the_video(tmp_path):
    path = mosaic_of(tmp_path, [frame_of(NOISE)], nearest=True)
    with rasterio.open(path) as file:
        assert file.dtypes == ("uint16", "uint16")
        values, alpha = file.read()
    assert np.isin(values[alpha > 0], NOISE).all()
    assert np.isin(NOISE, values).mean() > 0.7  # the file's pixels are a little larger
    soft = mosaic_of(tmp_path / "soft", [frame_of(NOISE)])
    with rasterio.open(soft) as file:
        between = file.read(1)[file.read(2) > 0]
    assert np.isin(between, NOISE).mean() < 0.9  # means of neighbours


def test_degrees(tmp_path):
    scale, offset = 0.04, -273.15
    raw = mosaic_of(tmp_path / "raw", flown(NOISE), nearest=True)
    warm = mosaic_of(tmp_path / "warm", flown(NOISE), nearest=True, degrees=(scale, offset))
    with rasterio.open(raw) as counts, rasterio.open(warm) as celsius:
        assert celsius.units == ("degC",)
        result, valid = celsius.read(1), counts.read(2) > 0
        wanted = (counts.read(1) * scale + offset).astype(np.float32)
    np.testing.assert_array_equal(result[valid], wanted[valid])
    assert np.isnan(result[~valid]).all()
    bytes_ = frame_of(np.zeros(SHAPE, np.uint8))
    with pytest.raises(MapError, match="--degrees is for 16-bit video"):
        mosaic_of(tmp_path / "not", [bytes_], degrees=(scale, offset))


@pytest.mark.parametrize(
    "pixels",
    [
        pytest.param(NOISE // 6000, id="grey"),
        pytest.param(COLOURS, id="colour", marks=pytest.mark.slow),
    ],
)
def test_tiles_on_disk_give_the_same_bytes(tmp_path, monkeypatch, pixels):
    in_memory = mosaic_of(tmp_path / "memory", flown(pixels)[:3], pixel_m=0.06).read_bytes()
    monkeypatch.setattr(rasters, "_MOST_BYTES", 1)  # one tile at a time
    written, write = [], np.savez
    monkeypatch.setattr(np, "savez", lambda p, **of: written.append(p) or write(p, **of))
    folder = tmp_path / "stored"
    stored = mosaic_of(folder, flown(pixels)[:3], pixel_m=0.06).read_bytes()
    assert stored == in_memory
    assert len(written) > len(set(written)) > 1  # some came back from disk, and went again
    assert [item.name for item in folder.iterdir()] == ["mosaic.tif"]


def test_a_mosaic_is_valid_and_shows_no_edge_of_a_picture(tmp_path):
    """Views of even ground, every other one brighter by 8: steps half as large are rare."""
    judge = pytest.importorskip("rio_cogeo.cogeo")
    camera = Camera(320, 256, 401.6, 398.8, 174.8, 124.8)
    frames = [
        frame_of(np.full((256, 320), 100 + 8 * (k % 2), np.uint8), frame.pose, k, camera=camera)
        for k, frame in enumerate(flown(NOISE))
    ]
    edges = {}
    for nearest in (False, True):
        path = mosaic_of(tmp_path, frames, pixel_m=0.05, nearest=nearest)
        assert judge.cog_validate(path, strict=True) == (True, [], [])
        with rasterio.open(path) as file:
            grey, valid = file.read(1).astype(float), file.read(2) > 0
        both = valid[:, 1:] & valid[:, :-1]
        edges[nearest] = int((np.abs(np.diff(grey, axis=1)) >= 4)[both].sum())
    assert edges[True] > 100  # without feathering
    # What is left is at the mosaic's own border, where the rims of two pictures cross.
    assert edges[False] < 0.2 * edges[True]


def test_no_ground_in_view(tmp_path):
    sky = camera_pose([0.0, 0.0, -20.0], 0.0, 40.0, 0.0)
    for product in (Orthophotos(tmp_path / "ortho", setup_of()), Mosaic(tmp_path, setup_of())):
        product.take(frame_of(NOISE, sky))
        result = product.finish()
        assert result.get("without_ground", 1) == 1
        assert result.get("width", 0) == 0
    assert [item.name for item in tmp_path.rglob("*")] == ["ortho"]
    with pytest.raises(MapError, match="no picture sees the ground at 15 deg or steeper"):
        raster_setup(RasterOptions(), CAMERA, [sky], PLANE, GROUND_M)


@pytest.mark.parametrize(("height_m", "pixel_m"), [(20.0, 0.15), (60.0, 0.5), (1.2, 0.01)])
def test_the_size_of_a_pixel_is_a_round_one(height_m, pixel_m):
    """The median over the picture, a little above the height over 100 px, and rounded down."""
    pose = camera_pose([0.0, 0.0, -height_m])
    setup = raster_setup(RasterOptions(), CAMERA, [pose], PLANE, GROUND_M)
    assert setup.tiles.pixel_m == pixel_m
    assert setup.projected.system.to_epsg() == 32650
    named = RasterOptions(crs="EPSG:3857", gsd_m=0.3)
    setup = raster_setup(named, CAMERA, [NADIR], PLANE, GROUND_M)
    assert setup.tiles.pixel_m == 0.3
    with pytest.raises(MapError, match="--crs EPSG:4326: WGS 84 is not a projected system"):
        raster_setup(RasterOptions(crs="EPSG:4326"), CAMERA, [NADIR], PLANE, GROUND_M)
