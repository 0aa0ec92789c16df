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
"""Elevation models from real GeoTIFF files, single, of tiles and large, against their surface."""

from __future__ import annotations

import math
import sys

import numpy as np
import pyproj
import pytest
from measured import run_measured

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.types.errors import ElevationError
from tirgeo_ros.io.elevation import elevation_model
from tirgeo_ros.io.elevation.elevation_model import ground_of, load_terrain

UTM = "EPSG:32650"
WEST, NORTH, SIZE = 500_100.0, 4_411_600.0, 150
#: A metre of grid: 3 / 50^2 and 2 / 40^2 of curvature, an eighth of their sum: 0.3 mm. Half a
#: pixel of shift would be 3 / 50 / 2 = 30 mm.
BILINEAR_M = 5e-4


def wave(x, y):
    return 40.0 + 3.0 * np.sin(np.asarray(x) / 50.0) + 2.0 * np.cos(np.asarray(y) / 40.0)


def wave_of_metres():
    """The wave at the middles of SIZE by SIZE pixels of a metre from WEST and NORTH."""
    x, y = np.meshgrid(WEST + np.arange(SIZE) + 0.5, NORTH - np.arange(SIZE) - 0.5)
    return wave(x, y).astype(np.float32)


def at(terrain, x, y, crs=UTM):
    lon, lat = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(x, y)
    return terrain.height_m(np.radians(lat), np.radians(lon))


def some_places(rng, margin=2.0):
    x = rng.uniform(WEST + margin, WEST + SIZE - margin, 200)
    return x, rng.uniform(NORTH - SIZE + margin, NORTH - margin, 200)


FLAT = np.full((9, 9), 7.0, np.float32)


@pytest.fixture
def rasterio():
    return pytest.importorskip("rasterio", reason="elevation models need rasterio")


@pytest.fixture
def write(rasterio, tmp_path):
    """Write a raster, without a transform of metres from WEST and NORTH."""

    def write(name, values, transform=None, crs=UTM, tags=None, units=None, nodata=-9999.0):
        bands = values if values.ndim == 3 else values[None]
        count, height, width = bands.shape
        shape = {"count": count, "height": height, "width": width, "dtype": bands.dtype}
        transform = transform or rasterio.transform.from_origin(WEST, NORTH, 1.0, 1.0)
        place = {"crs": crs, "transform": transform, "nodata": nodata}
        with rasterio.open(tmp_path / name, "w", driver="GTiff", **shape, **place) as out:
            out.write(bands)
            out.update_tags(**(tags or {}))
            if units:
                out.units = (units,) * count
        return tmp_path / name

    return write


def place(transform, column, row):
    """x and y of a column and row counted from the first pixel's corner."""
    a, b, c, d, e, f = tuple(transform)[:6]
    return a * column + b * row + c, d * column + e * row + f


@pytest.mark.parametrize("kind", ["Area", "Point"])
def test_heights_are_those_of_the_pixels_middles(rasterio, write, kind):
    path = write("dem.tif", wave_of_metres(), tags={"AREA_OR_POINT": kind})
    with rasterio.open(path) as back:
        assert back.tags()["AREA_OR_POINT"] == kind
    terrain = load_terrain(path)
    places = some_places(np.random.default_rng(1))
    np.testing.assert_allclose(at(terrain, *places), wave(*places), atol=BILINEAR_M)
    assert terrain.notes == ()


def test_a_rotated_grid_and_one_from_the_south(rasterio, write):
    cos, sin = math.cos(0.4), math.sin(0.4)
    column, row = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
    for down in (1.0, -1.0):
        transform = rasterio.Affine(cos, -down * sin, WEST, sin, down * cos, NORTH - 75)
        values = wave(*place(transform, column, row)).astype(np.float32)
        terrain = load_terrain(write(f"{down}.tif", values, transform))
        x, y = place(transform, *np.random.default_rng(3).uniform(2, SIZE - 2, (2, 100)))
        np.testing.assert_allclose(at(terrain, x, y), wave(x, y), atol=BILINEAR_M)


@pytest.mark.parametrize("middle_deg", [116.7, 180.0, 200.0])
def test_degrees_also_over_the_antimeridian(rasterio, write, middle_deg):
    step = 1e-5
    corner = middle_deg - 50 * step, 40.0 + 50 * step
    values = np.add.outer(np.zeros(100), np.arange(100.0)).astype(np.float32)
    transform = rasterio.transform.from_origin(*corner, step, step)
    terrain = load_terrain(write("d.tif", values, transform, "EPSG:4326"))
    for longitude in (middle_deg, middle_deg - 360):
        height_m = terrain.height_m(math.radians(40.0), math.radians(longitude))
        assert height_m == pytest.approx(49.5, abs=1e-4)


def test_no_data_and_masks_are_gaps(write):
    values = wave_of_metres()
    values[70:80, 70:80] = -9999.0
    values[20, 20] = np.nan
    terrain = load_terrain(write("gap.tif", values))
    assert np.isnan(at(terrain, WEST + 75, NORTH - 75))
    assert np.isnan(at(terrain, WEST + 20.5, NORTH - 20.5))
    assert np.isfinite(at(terrain, WEST + 90, NORTH - 75))
    assert np.isnan(at(terrain, WEST - 3, NORTH - 75))


def test_integers_with_a_scale_and_an_undulation(rasterio, write):
    path = write("i.tif", np.full((9, 9), 1234, np.int16), nodata=-1)
    with rasterio.open(path, "r+") as out:
        out.scales, out.offsets = (0.1,), (5.0,)
    terrain = load_terrain(path, -9.5)
    assert at(terrain, WEST + 4, NORTH - 4) == pytest.approx(123.4 + 5.0 - 9.5, abs=1e-4)


def test_notes_for_a_person(write):
    bands = np.stack([np.full((9, 9), 100.0), np.zeros((9, 9))]).astype(np.float32)
    path = write("n.tif", bands, crs="EPSG:32650+5773", units="ft")
    terrain = load_terrain(path)
    assert at(terrain, WEST + 4, NORTH - 4) == pytest.approx(30.48, abs=1e-4)
    bands_note, unit_note, datum_note = terrain.notes
    assert "2 bands; the first is used" in bands_note
    assert "heights in ft" in unit_note
    assert "EGM96" in datum_note
    assert "set dem_undulation_m" in datum_note
    assert all(note.startswith(str(path)) for note in terrain.notes)
    assert len(load_terrain(path, -9.0).notes) == 2  # corrected: nothing to say of the datum


MOON = (
    'GEOGCRS["Moon",DATUM["D_Moon",ELLIPSOID["Moon",1737400,0,LENGTHUNIT["metre",1]]],'
    'PRIMEM["Reference_Meridian",0],CS[ellipsoidal,2],AXIS["lat",north],AXIS["lon",east],'
    'ANGLEUNIT["degree",0.0174532925199433]]'
)
ODD_CRS = "odd.tif: .* CRS, and a map needs .*; give it one"
NO_GROUND = "odd.tif: its pixels cover no ground"


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"crs": None}, "odd.tif: no coordinate system"),
        ({"values": np.full_like(FLAT, -9999)}, "odd.tif: .*all its values are no-data"),
        ({"values": np.full_like(FLAT, -32768)}, "odd.tif: .*is its no-data value declared"),
        ({"crs": "EPSG:4978"}, ODD_CRS),
        ({"crs": 'LOCAL_CS["site",UNIT["metre",1]]'}, ODD_CRS),
        ({"numbers": (1, 1, 500000, 1, 1, 3300000)}, NO_GROUND),
        ({"numbers": (1e-300, 0, 500000, 0, -1e-300, 3300000)}, NO_GROUND),
        ({"numbers": (math.nan, 0, 500000, 0, -1, 3300000)}, NO_GROUND),
        ({"numbers": (math.inf, 0, 500000, 0, -1, 3300000)}, NO_GROUND),
        ({"numbers": (1e300, 0, 500000, 0, -1e300, 3300000)}, NO_GROUND),
        (
            {"numbers": (0.1, 0, 10.0, 0, -0.1, 10.0), "crs": MOON},
            "odd.tif: cannot be transformed .* 'Moon': is it of",
        ),
    ],
)
def test_files_that_are_refused(rasterio, write, options, reason):
    options = {"values": FLAT} | options
    if numbers := options.pop("numbers", None):
        options["transform"] = rasterio.Affine(*numbers)
    with pytest.raises(ElevationError, match=reason):
        load_terrain(write("odd.tif", **options))


@pytest.mark.usefixtures("rasterio")
def test_a_file_that_is_no_raster_is_refused(tmp_path, monkeypatch):
    (tmp_path / "text.tif").write_text("no picture")
    for name in ("text.tif", "absent.tif"):
        with pytest.raises(ElevationError, match=rf"{name}: cannot be read as a raster"):
            load_terrain(tmp_path / name)
    monkeypatch.setitem(sys.modules, "rasterio", None)
    install = r'd\.tif needs rasterio: pip install "tirgeo\[dem\]"'
    with pytest.raises(ElevationError, match=install):
        load_terrain(tmp_path / "d.tif")


def test_the_ground_of_the_parameters(write):
    path = str(write("g.tif", FLAT))
    assert ground_of(OverlayConfig()) is None
    assert ground_of(OverlayConfig(ground_height_m=3.0, dem=path)) == 3.0
    assert ground_of(OverlayConfig(dem=path, dem_undulation_m=2.0)).highest_m == 9.0


def test_a_large_model_is_read_by_strips(write, monkeypatch):
    path = write("large.tif", wave_of_metres())
    whole = load_terrain(path)
    monkeypatch.setattr(elevation_model, "_AT_ONCE", 7 * SIZE)
    np.testing.assert_array_equal(load_terrain(path).heights_m, whole.heights_m)


@pytest.fixture
def tiles_of(rasterio, write):
    """Write tiles (left, top, right, bottom) of the wave, in pixels."""

    def tiles(cuts):
        for k, (left, top, right, bottom) in enumerate(cuts):
            corner = rasterio.transform.from_origin(WEST + left, NORTH - top, 1.0, 1.0)
            yield write(f"tile{k}.tif", wave_of_metres()[top:bottom, left:right], corner)

    return tiles


def test_tiles_side_by_side_are_one_surface(tiles_of):
    # one over another, one apart, the second before the first in both directions
    cuts = [(60, 50, 150, 150), (0, 0, 60, 50), (60, 0, 150, 50), (0, 45, 62, 150)]
    terrain = load_terrain(", ".join(map(str, tiles_of(cuts))))
    assert terrain.heights_m.shape == (SIZE, SIZE)
    places = some_places(np.random.default_rng(4))
    np.testing.assert_allclose(at(terrain, *places), wave(*places), atol=BILINEAR_M)


def test_between_tiles_is_a_gap_and_the_first_tile_has_precedence(write, tiles_of):
    first, second = tiles_of([(0, 0, 40, 150), (50, 0, 150, 150)])
    holed = np.full((150, 20), 7.0, np.float32)
    holed[:60] = -9999
    above = write("above.tif", holed, units="m")
    terrain = load_terrain(f"{above},{first},{second}")
    assert np.isnan(at(terrain, WEST + 45, NORTH - 75))
    assert at(terrain, WEST + 10, NORTH - 75) == pytest.approx(7)
    for x, y in ((WEST + 10, NORTH - 30), (WEST + 30, NORTH - 75), (WEST + 80, NORTH - 75)):
        assert at(terrain, x, y) == pytest.approx(wave(x, y), abs=BILINEAR_M)


def test_tiles_that_do_not_fit_are_named(rasterio, write, tiles_of):
    first, second = tiles_of([(0, 0, 40, 150), (40, 0, 150, 150)])
    for west, step, crs, reason in (
        (40.5, 1.0, UTM, "its pixels are not on the grid of"),
        (40, 0.5, UTM, "its pixels are not on the grid of"),
        (40.5, 1.0, "EPSG:32649", "a different coordinate system from that of"),
    ):
        corner = rasterio.transform.from_origin(WEST + west, NORTH, step, step)
        odd = write("odd.tif", FLAT, corner, crs)
        with pytest.raises(ElevationError, match=rf"odd\.tif: {reason}"):
            load_terrain(f"{first},{odd}")
    second.write_bytes(second.read_bytes()[:20_000])
    with pytest.raises(ElevationError, match=r"tile1\.tif: cannot be read as a raster"):
        load_terrain(f"{first},{second}")
    with pytest.raises(ElevationError, match=r"' , ': does not name an elevation model"):
        load_terrain(" , ")


MANY_PIXELS = """<VRTDataset rasterXSize="30000" rasterYSize="30000"><SRS>EPSG:32650</SRS>
<GeoTransform>500000,1,0,3300000,0,-1</GeoTransform><VRTRasterBand dataType="Float32" band="1">
<SimpleSource><SourceFilename relativeToVRT="1">one.tif</SourceFilename><SourceBand>1</SourceBand>
<SrcRect xOff="0" yOff="0" xSize="9" ySize="9"/><DstRect xOff="0" yOff="0" xSize="30000"
ySize="30000"/></SimpleSource></VRTRasterBand></VRTDataset>"""
LOAD = """
import sys
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.elevation.elevation_model import load_terrain
try:
    print(load_terrain(sys.argv[1]).heights_m.shape)
except TirgeoError as error:
    print(error)
"""


def test_a_small_file_of_many_pixels_is_refused(write, tmp_path):
    write("one.tif", FLAT)
    (tmp_path / "many.vrt").write_text(MANY_PIXELS)
    done = run_measured(LOAD, str(tmp_path / "many.vrt"))
    assert "30000 x 30000 pixels, more than the 64 million allowed; cut out" in done.said, done
    done.check_modest()
