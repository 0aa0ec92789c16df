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
"""Cloud-Optimised GeoTIFFs are valid, whole or absent."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.pictures.geotiff import RasterForm, RasterPart, write_cog

rasterio = pytest.importorskip("rasterio")
UTM = Plane("EPSG:32650", np.zeros((1, 2))).system.to_wkt()
WIDTH, HEIGHT = 832, 576


def form_of(dtype, bands=1, unit=""):
    place = (0.25, 474_000.0, 4_411_000.0, WIDTH, HEIGHT)
    return RasterForm(UTM, *place, bands, dtype, unit, {"PICTURE": "7"})


def parts_of(values):
    """Two parts, and nothing between columns 400 and 500."""
    for first, last in ((0, 400), (500, WIDTH)):
        part = values[:, first:last]
        yield RasterPart(first, 0, part, np.ones(part.shape[:2], bool))


def values_of(dtype, bands):
    rng, shape = np.random.default_rng(3), (64, 64, bands)
    if dtype == "float32":
        some = rng.normal(20.0, 5.0, shape).astype(dtype)
    else:
        some = rng.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
    return np.tile(some, (HEIGHT // 64, WIDTH // 64, 1))


@pytest.mark.parametrize(
    ("dtype", "bands"), [("uint8", 1), ("uint8", 3), ("uint16", 1), ("float32", 1)]
)
def test_a_file_is_valid_with_its_values_place_and_type(tmp_path, dtype, bands):
    values, path = values_of(dtype, bands), tmp_path / "a.tif"
    write_cog(path, form_of(dtype, bands, "degC" if dtype == "float32" else ""), parts_of(values))
    assert [each.name for each in tmp_path.iterdir()] == ["a.tif"]
    judge = pytest.importorskip("rio_cogeo.cogeo")
    assert judge.cog_validate(path, strict=True) == (True, [], [])
    with rasterio.open(path) as raster:
        assert raster.crs.to_epsg() == 32650
        assert tuple(raster.transform)[:6] == (0.25, 0.0, 474_000.0, 0.0, -0.25, 4_411_000.0)
        assert (raster.width, raster.height) == (WIDTH, HEIGHT)
        assert set(raster.dtypes) == {dtype}
        assert raster.tags()["PICTURE"] == "7"
        assert raster.overviews(1) == [2, 4][: len(raster.overviews(1))] != []
        valid = raster.dataset_mask() > 0
        assert valid[:, :400].all()
        assert valid[:, 500:].all()
        assert not valid[:, 400:500].any()
        result = np.moveaxis(raster.read(list(range(1, bands + 1))), 0, 2)
        np.testing.assert_array_equal(result[valid], values[valid])  # nothing is lost
        names = [item.name for item in raster.colorinterp]
        if dtype == "float32":
            assert names == ["gray"]
            assert np.isnan(raster.nodata)
            assert np.isnan(result[~valid]).all()
            assert raster.units == ("degC",)
        else:
            assert raster.nodata is None
            assert names == [*(["red", "green", "blue"] if bands == 3 else ["gray"]), "alpha"]
            assert (raster.read(bands + 1)[~valid] == 0).all()


def test_overviews_are_means_of_known_pixels(tmp_path):
    values = np.full((HEIGHT, WIDTH, 1), 1000, np.uint16)
    write_cog(tmp_path / "a.tif", form_of("uint16"), parts_of(values))
    with rasterio.open(tmp_path / "a.tif", overview_level=0) as half:
        grey, alpha = half.read()
    assert alpha.max() == 65535
    assert (grey[alpha == 65535] == 1000).all()  # not darkened at the rim


def test_whole_or_absent(tmp_path, monkeypatch):
    def broken():
        yield from parts_of(values_of("uint8", 1))
        raise MapError("the bag is cut")

    with pytest.raises(MapError, match="the bag is cut"):
        write_cog(tmp_path / "a.tif", form_of("uint8"), broken())
    with pytest.raises(MapError, match=r"absent/a\.tif: cannot be written"):
        write_cog(tmp_path / "absent" / "a.tif", form_of("uint8"), [])
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(MapError, match=r'a\.tif needs rasterio: pip install "tirgeo\[dem\]"'):
        write_cog(tmp_path / "a.tif", form_of("uint8"), [])
