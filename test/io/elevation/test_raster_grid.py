"""Elevation models of tiles, and large ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from elevation_files import (
    BILINEAR_M,
    NORTH,
    SIZE,
    WEST,
    at,
    grid_of_metres,
    some_places,
    wave,
    written,
)
from measured import run_measured

from tirgeo_ros.core.types.errors import ElevationError
from tirgeo_ros.io.elevation import elevation_model
from tirgeo_ros.io.elevation.elevation_model import load_terrain


def test_a_large_model_is_read_by_strips(rasterio, tmp_path, monkeypatch):
    x, y, transform = grid_of_metres(rasterio)
    path = written(rasterio, tmp_path / "large.tif", wave(x, y).astype(np.float32), transform)
    whole = load_terrain(path)
    monkeypatch.setattr(elevation_model, "_AT_ONCE", 7 * SIZE)
    np.testing.assert_array_equal(load_terrain(path).heights_m, whole.heights_m)


@pytest.fixture
def rasterio():
    return pytest.importorskip("rasterio", reason="elevation models need rasterio")


def tiles_of(rasterio, folder, cuts, **profile):
    """Tiles (left, top, right, bottom) of the wave, in pixels."""
    x, y, _ = grid_of_metres(rasterio)
    paths = []
    for k, (left, top, right, bottom) in enumerate(cuts):
        corner = rasterio.transform.from_origin(WEST + left, NORTH - top, 1.0, 1.0)
        values = wave(x, y)[top:bottom, left:right].astype(np.float32)
        paths.append(written(rasterio, folder / f"tile{k}.tif", values, corner, **profile))
    return paths


def test_tiles_side_by_side_are_one_surface(rasterio, tmp_path):
    # one over another, one apart, the second before the first in both directions
    cuts = [(60, 50, 150, 150), (0, 0, 60, 50), (60, 0, 150, 50), (0, 45, 62, 150)]
    paths = tiles_of(rasterio, tmp_path, cuts)
    terrain = load_terrain(", ".join(map(str, paths)))
    assert terrain.heights_m.shape == (SIZE, SIZE)
    places = some_places(np.random.default_rng(4))
    np.testing.assert_allclose(at(terrain, *places), wave(*places), atol=BILINEAR_M)


def test_between_tiles_is_a_gap_and_the_first_tile_stands_above_the_next(rasterio, tmp_path):
    first, second = tiles_of(rasterio, tmp_path, [(0, 0, 40, 150), (50, 0, 150, 150)])
    low = rasterio.transform.from_origin(WEST, NORTH, 1.0, 1.0)
    holed = np.full((150, 20), 7.0, np.float32)
    holed[:60] = -9999
    above = written(rasterio, tmp_path / "above.tif", holed, low, units="m")
    terrain = load_terrain(f"{above},{first},{second}")
    assert np.isnan(at(terrain, WEST + 45, NORTH - 75))
    assert at(terrain, WEST + 10, NORTH - 75) == pytest.approx(7)
    for x, y in ((WEST + 10, NORTH - 30), (WEST + 30, NORTH - 75), (WEST + 80, NORTH - 75)):
        assert at(terrain, x, y) == pytest.approx(wave(x, y), abs=BILINEAR_M)


def test_tiles_that_do_not_fit_are_named(rasterio, tmp_path):
    first, second = tiles_of(rasterio, tmp_path, [(0, 0, 40, 150), (40, 0, 150, 150)])
    flat = np.full((9, 9), 7.0, np.float32)
    halved = rasterio.transform.from_origin(WEST + 40.5, NORTH, 1.0, 1.0)
    finer = rasterio.transform.from_origin(WEST + 40, NORTH, 0.5, 0.5)
    for name, transform in (("halved", halved), ("finer", finer)):
        odd = written(rasterio, tmp_path / f"{name}.tif", flat, transform)
        with pytest.raises(
            ElevationError, match=rf"{name}\.tif: its pixels are not on the grid of"
        ):
            load_terrain(f"{first},{odd}")
    other = written(rasterio, tmp_path / "other.tif", flat, halved, "EPSG:32649")
    with pytest.raises(
        ElevationError, match=r"other\.tif: a different coordinate system from that of"
    ):
        load_terrain(f"{first},{other}")
    second.write_bytes(second.read_bytes()[:20_000])
    with pytest.raises(ElevationError, match=r"tile1\.tif: cannot be read as a raster"):
        load_terrain(f"{first},{second}")
    with pytest.raises(ElevationError, match=r"' , ': does not name an elevation model"):
        load_terrain(" , ")


@pytest.mark.parametrize("turned", [False, True])
def test_tiles_that_meet_at_the_antimeridian(rasterio, tmp_path, turned):
    step = 1e-3
    paths = []
    for west, low in ((180 - 20 * step, 0.0), (-180.0, 20.0)):
        transform = rasterio.transform.from_origin(west, 40.0, step, step)
        values = np.add.outer(np.zeros(9), low + np.arange(20.0)).astype(np.float32)
        paths.append(written(rasterio, tmp_path / f"{low}.tif", values, transform, "EPSG:4326"))
    terrain = load_terrain(",".join(map(str, paths[::-1] if turned else paths)))
    assert terrain.heights_m.shape == (9, 40)
    latitude = math.radians(40 - 4 * step)
    for longitude in (180.0, -180.0):
        found = terrain.height_m(latitude, math.radians(longitude))
        assert found == pytest.approx(19.5, abs=1e-4)


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


def test_a_small_file_of_many_pixels_is_refused(rasterio, tmp_path):
    _, _, transform = grid_of_metres(rasterio)
    written(rasterio, tmp_path / "one.tif", np.ones((9, 9), np.float32), transform)
    (tmp_path / "many.vrt").write_text(MANY_PIXELS)
    done = run_measured(LOAD, str(tmp_path / "many.vrt"))
    assert "30000 x 30000 pixels, more than the 64 million allowed; cut out" in done.said, done
    done.check_modest()


@pytest.mark.slow
def test_the_most_pixels_that_are_taken_fit(rasterio, tmp_path):
    _, _, transform = grid_of_metres(rasterio)
    written(rasterio, tmp_path / "one.tif", np.ones((9, 9), np.float32), transform)
    (tmp_path / "many.vrt").write_text(MANY_PIXELS.replace("30000", "8000"))
    done = run_measured(LOAD, str(tmp_path / "many.vrt"))
    assert "(8000, 8000)" in done.said, done
    done.check_modest()
