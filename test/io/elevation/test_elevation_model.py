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


def written(rasterio, path, values, transform, crs=UTM, tags=None, units=None, **profile):
    bands = values if values.ndim == 3 else values[None]
    profile = {"nodata": -9999.0} | profile
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        count=len(bands),
        height=bands.shape[1],
        width=bands.shape[2],
        dtype=bands.dtype,
        crs=crs,
        transform=transform,
        **profile,
    ) as out:
        out.write(bands)
        out.update_tags(**(tags or {}))
        if units:
            out.units = (units,) * len(bands)
    return path


def grid_of_metres(rasterio, west=WEST, north=NORTH, size=SIZE, step=1.0):
    """Middles of pixels of ``step`` m, and the transform of their corners."""
    x = west + step * (np.arange(size) + 0.5)
    y = north - step * (np.arange(size) + 0.5)
    return *np.meshgrid(x, y), rasterio.transform.from_origin(west, north, step, step)


def at(terrain, x, y, crs=UTM):
    lon, lat = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(x, y)
    return terrain.height_m(np.radians(lat), np.radians(lon))


def some_places(rng, margin=2.0):
    x = rng.uniform(WEST + margin, WEST + SIZE - margin, 200)
    return x, rng.uniform(NORTH - SIZE + margin, NORTH - margin, 200)


@pytest.fixture
def rasterio():
    return pytest.importorskip("rasterio", reason="elevation models need rasterio")


def place(transform, column, row):
    """x and y of a column and row counted from the first pixel's corner."""
    a, b, c, d, e, f = tuple(transform)[:6]
    return a * column + b * row + c, d * column + e * row + f


@pytest.mark.parametrize("kind", ["Area", "Point"])
def test_heights_are_those_of_the_pixels_middles(rasterio, tmp_path, kind):
    x, y, transform = grid_of_metres(rasterio)
    path = tmp_path / "dem.tif"
    values = wave(x, y).astype(np.float32)
    written(rasterio, path, values, transform, tags={"AREA_OR_POINT": kind})
    with rasterio.open(path) as back:
        assert back.tags()["AREA_OR_POINT"] == kind
    terrain = load_terrain(path)
    places = some_places(np.random.default_rng(1))
    np.testing.assert_allclose(at(terrain, *places), wave(*places), atol=BILINEAR_M)
    assert terrain.notes == ()


def test_a_turned_grid_and_one_from_the_south(rasterio, tmp_path):
    cos, sin = math.cos(0.4), math.sin(0.4)
    column, row = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
    for k, down in enumerate((1.0, -1.0)):
        transform = rasterio.Affine(cos, -down * sin, WEST, sin, down * cos, NORTH - 75)
        values = wave(*place(transform, column, row)).astype(np.float32)
        path = written(rasterio, tmp_path / f"{k}.tif", values, transform)
        x, y = place(transform, *np.random.default_rng(3).uniform(2, SIZE - 2, (2, 100)))
        np.testing.assert_allclose(at(load_terrain(path), x, y), wave(x, y), atol=BILINEAR_M)


@pytest.mark.parametrize("middle_deg", [116.7, 180.0, 200.0])
def test_degrees_also_over_the_antimeridian(rasterio, tmp_path, middle_deg):
    step = 1e-5
    transform = rasterio.transform.from_origin(
        middle_deg - 50 * step, 40.0 + 50 * step, step, step
    )
    values = np.add.outer(np.zeros(100), np.arange(100.0)).astype(np.float32)
    terrain = load_terrain(written(rasterio, tmp_path / "d.tif", values, transform, "EPSG:4326"))
    for longitude in (middle_deg, middle_deg - 360):
        found = terrain.height_m(math.radians(40.0), math.radians(longitude))
        assert found == pytest.approx(49.5, abs=1e-4)


def test_no_data_and_masks_are_gaps(rasterio, tmp_path):
    x, y, transform = grid_of_metres(rasterio)
    values = wave(x, y).astype(np.float32)
    values[70:80, 70:80] = -9999.0
    values[20, 20] = np.nan
    terrain = load_terrain(written(rasterio, tmp_path / "gap.tif", values, transform))
    assert np.isnan(at(terrain, WEST + 75, NORTH - 75))
    assert np.isnan(at(terrain, WEST + 20.5, NORTH - 20.5))
    assert np.isfinite(at(terrain, WEST + 90, NORTH - 75))
    assert np.isnan(at(terrain, WEST - 3, NORTH - 75))


def test_integers_with_a_scale_and_an_undulation(rasterio, tmp_path):
    _, _, transform = grid_of_metres(rasterio)
    path = written(
        rasterio, tmp_path / "i.tif", np.full((9, 9), 1234, np.int16), transform, nodata=-1
    )
    with rasterio.open(path, "r+") as out:
        out.scales, out.offsets = (0.1,), (5.0,)
    terrain = load_terrain(path, -9.5)
    assert at(terrain, WEST + 4, NORTH - 4) == pytest.approx(123.4 + 5.0 - 9.5, abs=1e-4)


def test_what_a_person_should_know(rasterio, tmp_path):
    _, _, transform = grid_of_metres(rasterio)
    bands = np.stack([np.full((9, 9), 100.0), np.zeros((9, 9))]).astype(np.float32)
    path = written(rasterio, tmp_path / "n.tif", bands, transform, "EPSG:32650+5773", units="ft")
    terrain = load_terrain(path)
    assert at(terrain, WEST + 4, NORTH - 4) == pytest.approx(30.48, abs=1e-4)
    bands_note, unit_note, datum_note = terrain.notes
    assert "2 bands; the first is used" in bands_note
    assert "heights in ft" in unit_note
    assert "EGM96" in datum_note
    assert "set dem_undulation_m" in datum_note
    assert all(note.startswith(str(path)) for note in terrain.notes)
    assert len(load_terrain(path, -9.0).notes) == 2  # corrected: nothing to say of the datum


def test_what_is_refused(rasterio, tmp_path):
    _, _, transform = grid_of_metres(rasterio)
    flat = np.full((9, 9), 7.0, np.float32)
    nowhere = written(rasterio, tmp_path / "nowhere.tif", flat, transform, crs=None)
    with pytest.raises(ElevationError, match=r"nowhere\.tif: no coordinate system"):
        load_terrain(nowhere)
    empty = written(rasterio, tmp_path / "empty.tif", np.full_like(flat, -9999), transform)
    with pytest.raises(ElevationError, match=r"empty\.tif: .*all of it is no-data"):
        load_terrain(empty)
    marked = written(rasterio, tmp_path / "marked.tif", np.full_like(flat, -32768), transform)
    with pytest.raises(ElevationError, match=r"marked\.tif: .*is its no-data value declared"):
        load_terrain(marked)
    (tmp_path / "text.tif").write_text("no picture")
    with pytest.raises(ElevationError, match=r"text\.tif: cannot be read as a raster"):
        load_terrain(tmp_path / "text.tif")
    with pytest.raises(ElevationError, match=r"absent\.tif: cannot be read as a raster"):
        load_terrain(tmp_path / "absent.tif")


def test_without_rasterio_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(
        ElevationError, match=r"d\.tif: .*need rasterio: pip install 'tirgeo\[dem\]'"
    ):
        load_terrain(tmp_path / "d.tif")


def test_the_ground_of_the_parameters(rasterio, tmp_path):
    _, _, transform = grid_of_metres(rasterio)
    path = str(written(rasterio, tmp_path / "g.tif", np.full((9, 9), 7.0, np.float32), transform))
    assert ground_of(OverlayConfig()) is None
    assert ground_of(OverlayConfig(ground_height_m=3.0, dem=path)) == 3.0
    assert ground_of(OverlayConfig(dem=path, dem_undulation_m=2.0)).highest_m == 9.0


@pytest.mark.parametrize("crs", ["EPSG:4978", 'LOCAL_CS["site",UNIT["metre",1]]'])
def test_a_system_that_is_none_of_the_earths_surface(rasterio, tmp_path, crs):
    _, _, transform = grid_of_metres(rasterio)
    flat = np.full((9, 9), 7.0, np.float32)
    with pytest.raises(ElevationError, match=r"odd\.tif: .* CRS, and a map needs .*; give it one"):
        load_terrain(written(rasterio, tmp_path / "odd.tif", flat, transform, crs))


MOON = (
    'GEOGCRS["Moon",DATUM["D_Moon",ELLIPSOID["Moon",1737400,0,LENGTHUNIT["metre",1]]],'
    'PRIMEM["Reference_Meridian",0],CS[ellipsoidal,2],AXIS["lat",north],AXIS["lon",east],'
    'ANGLEUNIT["degree",0.0174532925199433]]'
)


@pytest.mark.parametrize(
    "numbers",
    [
        (1, 1, 500000, 1, 1, 3300000),
        (1e-300, 0, 500000, 0, -1e-300, 3300000),
        (math.nan, 0, 500000, 0, -1, 3300000),
        (math.inf, 0, 500000, 0, -1, 3300000),
        (1e300, 0, 500000, 0, -1e300, 3300000),
    ],
)
def test_pixels_that_cover_no_ground(rasterio, tmp_path, numbers):
    transform = rasterio.Affine(*numbers)
    path = written(rasterio, tmp_path / "flat.tif", np.ones((9, 9), np.float32), transform)
    with pytest.raises(ElevationError, match=r"flat\.tif: its pixels cover no ground"):
        load_terrain(path)


def test_another_planet(rasterio, tmp_path):
    transform = rasterio.transform.from_origin(10.0, 10.0, 0.1, 0.1)
    path = written(rasterio, tmp_path / "moon.tif", np.ones((9, 9), np.float32), transform, MOON)
    with pytest.raises(
        ElevationError, match=r"moon\.tif: cannot be transformed .* 'Moon': is it of"
    ):
        load_terrain(path)


def test_a_large_model_is_read_by_strips(rasterio, tmp_path, monkeypatch):
    x, y, transform = grid_of_metres(rasterio)
    path = written(rasterio, tmp_path / "large.tif", wave(x, y).astype(np.float32), transform)
    whole = load_terrain(path)
    monkeypatch.setattr(elevation_model, "_AT_ONCE", 7 * SIZE)
    np.testing.assert_array_equal(load_terrain(path).heights_m, whole.heights_m)


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
