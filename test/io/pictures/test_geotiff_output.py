"""An orthophoto as a GeoTIFF: every pixel of it shows what lies there."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.calibration.polynomial_transform import fit_polynomial
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.pictures.geotiff import write_warped

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
