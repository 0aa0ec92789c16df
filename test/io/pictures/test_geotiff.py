"""GeoTIFFs: an orthophoto's pixels show what lies there, and COGs are valid, whole or absent."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.calibration.polynomial_transform import fit_polynomial
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.pictures.geotiff import RasterForm, RasterPart, write_cog, write_warped

SIZE_PX = np.array([1500, 1100])
PIXEL_M = 0.05


def plane_of(pixels):
    """Turned by a right angle or so, and bent by 15 px."""
    u, v = (pixels / SIZE_PX - 0.5).T * 2
    x, y = (pixels * PIXEL_M).T
    return np.stack([5e5 + 0.1 * x - y + 0.7 * u**3, 4.4e6 - x - 0.1 * y + 0.5 * u * v], 1)


@pytest.fixture
def found():
    marks = np.random.default_rng(1).uniform(0.1, 0.9, (25, 2)) * SIZE_PX
    marks[:4] = [[60, 60], [1440, 60], [1440, 1040], [60, 1040]]
    return fit_polynomial(marks, plane_of(marks), 3)[0]


def pixels_of(found, plane):
    """The pixels of places, by Newton's method from the middle of the picture."""
    pixels = np.tile(SIZE_PX / 2.0, (len(plane), 1))
    for _ in range(8):
        pixels += np.linalg.solve(found.jacobian(pixels), (plane - found(pixels))[..., None])[
            ..., 0
        ]
    return pixels


@pytest.mark.parametrize("bands", [1, 3])
def test_every_place_shows_its_pixel(tmp_path, found, bands):
    rasterio = pytest.importorskip("rasterio")
    rows, columns = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
    # Brightness by place: 40 px a wave, so that half a pixel of error shows.
    wave = 128 + 50 * np.sin((columns + 0.5) / 6.4) + 50 * np.cos((rows + 0.5) / 6.4)
    picture = np.repeat(wave.round().astype(np.uint8)[..., None], bands, axis=2)
    cv2.imwrite(str(tmp_path / "ortho.png"), picture)
    plane = Plane("EPSG:32650", np.zeros((1, 2)))
    write_warped(tmp_path / "ortho.png", tmp_path / "o.tif", found, plane, PIXEL_M)
    with rasterio.open(tmp_path / "o.tif") as made:
        assert made.crs.to_epsg() == 32650
        assert made.count == bands + 1
        data, affine = made.read(), made.transform
    asked = np.random.default_rng(3).uniform(0.08, 0.92, (4000, 2)) * SIZE_PX
    to_west, to_north = affine.c, affine.f
    across, down = plane_of(asked).T - [[to_west], [to_north]]
    column, row = (np.floor(part / PIXEL_M).astype(int) for part in (across, -down))
    # The true place of the middle of each pixel that was hit.
    middles = np.stack([to_west + (column + 0.5) * PIXEL_M, to_north - (row + 0.5) * PIXEL_M], 1)
    u, v = pixels_of(found, middles).T
    wanted = 128 + 50 * np.sin(u / 6.4) + 50 * np.cos(v / 6.4)
    error = data[0, row, column] - wanted
    # Linear interpolation: 50 / 8 / 6.4^2 = 0.15 each way; two roundings; half a pixel were 5.
    assert np.abs(error).max() < 2
    assert (data[bands, row, column] == 255).all()
    assert (data[bands] == 0).mean() > 0.02  # outside the hull


def test_no_picture_and_no_rasterio(tmp_path, found, monkeypatch):
    pytest.importorskip("rasterio")
    plane = Plane("EPSG:32650", np.zeros((1, 2)))
    with pytest.raises(MapError, match=r"absent\.png to .*o\.tif: .*absent\.png"):
        write_warped(tmp_path / "absent.png", tmp_path / "o.tif", found, plane, PIXEL_M)
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(MapError, match=r"a GeoTIFF needs rasterio: pip install 'tirgeo\[dem\]'"):
        write_warped(tmp_path / "a.png", tmp_path / "o.tif", found, plane, PIXEL_M)


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
def test_values_place_and_kind(tmp_path, dtype, bands):
    values, path = values_of(dtype, bands), tmp_path / "a.tif"
    write_cog(path, form_of(dtype, bands, "degC" if dtype == "float32" else ""), parts_of(values))
    assert [one.name for one in tmp_path.iterdir()] == ["a.tif"]
    with rasterio.open(path) as made:
        assert made.crs.to_epsg() == 32650
        assert tuple(made.transform)[:6] == (0.25, 0.0, 474_000.0, 0.0, -0.25, 4_411_000.0)
        assert (made.width, made.height) == (WIDTH, HEIGHT)
        assert set(made.dtypes) == {dtype}
        assert made.tags()["PICTURE"] == "7"
        assert made.overviews(1) == [2, 4][: len(made.overviews(1))] != []
        known = made.dataset_mask() > 0
        assert known[:, :400].all()
        assert known[:, 500:].all()
        assert not known[:, 400:500].any()
        found = np.moveaxis(made.read(list(range(1, bands + 1))), 0, 2)
        np.testing.assert_array_equal(found[known], values[known])  # nothing is lost
        names = [one.name for one in made.colorinterp]
        if dtype == "float32":
            assert names == ["gray"]
            assert np.isnan(made.nodata)
            assert np.isnan(found[~known]).all()
            assert made.units == ("degC",)
        else:
            assert made.nodata is None
            assert names == [*(["red", "green", "blue"] if bands == 3 else ["gray"]), "alpha"]
            assert (made.read(bands + 1)[~known] == 0).all()


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_an_independent_judge_calls_it_valid(tmp_path, dtype):
    judge = pytest.importorskip("rio_cogeo.cogeo")
    write_cog(tmp_path / "a.tif", form_of(dtype), parts_of(values_of(dtype, 1)))
    assert judge.cog_validate(tmp_path / "a.tif", strict=True) == (True, [], [])


def test_overviews_are_means_of_what_is_known(tmp_path):
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
    with pytest.raises(MapError, match=r"a GeoTIFF needs rasterio: pip install 'tirgeo\[dem\]'"):
        write_cog(tmp_path / "a.tif", form_of("uint8"), [])
