"""The ground overlay for Google Earth: a PNG in degrees that shows what the raster shows."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.pictures.geotiff import RasterForm, RasterPart, write_cog
from tirgeo_ros.tools.export import orthophotos
from tirgeo_ros.tools.export.orthophotos import write_ground_overlay

pytest.importorskip("rasterio")

UTM = Plane("EPSG:32650", np.zeros((1, 2)))
WEST, NORTH, PIXEL_M, SIZE = 474_000.0, 4_411_000.0, 0.5, 300
KML = "{http://www.opengis.net/kml/2.2}"


def raster_of(path, values, known=None):
    known = np.ones(values.shape[:2], bool) if known is None else known
    size = values.shape[1], values.shape[0]
    form = RasterForm(
        UTM.system.to_wkt(), PIXEL_M, WEST, NORTH, *size, values.shape[2], values.dtype.name
    )
    write_cog(path, form, [RasterPart(0, 0, values, known)])


def overlay(folder, values, known=None):
    """The picture (h, w, 4) and its box, as written for a raster."""
    raster_of(folder / "m.tif", values, known)
    write_ground_overlay(folder / "m.tif", folder / "m.png", folder / "m.kml")
    root = ET.fromstring((folder / "m.kml").read_text())
    assert root.tag == f"{KML}kml"
    assert root.find(f".//{KML}href").text == "m.png"
    box = {one.tag.removeprefix(KML): float(one.text) for one in root.find(f".//{KML}LatLonBox")}
    return cv2.imread(str(folder / "m.png"), cv2.IMREAD_UNCHANGED), box


def test_a_place_has_the_same_value(tmp_path):
    columns, rows = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    values = np.dstack([columns * 0.8, rows * 0.8, 0 * rows]).astype(np.uint8)  # red, green, blue
    picture, box = overlay(tmp_path, values)
    x, y = np.random.default_rng(1).uniform(20, SIZE - 20, (2, 50))
    degrees = UTM.degrees(np.stack([WEST + x * PIXEL_M, NORTH - y * PIXEL_M], 1))
    height, width = picture.shape[:2]
    u = (degrees[:, 0] - box["west"]) / (box["east"] - box["west"]) * width
    v = (box["north"] - degrees[:, 1]) / (box["north"] - box["south"]) * height
    blue, green, red, alpha = picture[v.astype(int), u.astype(int)].astype(float).T
    # A pixel of the picture is about one of the raster: half a pixel each way is 0.8, rounding 1.
    assert np.abs(red - x * 0.8).max() < 2
    assert np.abs(green - y * 0.8).max() < 2
    assert (blue == 0).all()
    assert (alpha == 255).all()
    assert (picture[..., 3] == 0).any()  # the corners: a square of UTM is turned in degrees


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_more_than_8_bits_are_stretched_and_the_unknown_is_clear(tmp_path, dtype):
    values = np.linspace(20_000, 21_000, SIZE * SIZE).reshape(SIZE, SIZE, 1).astype(dtype)
    known = np.ones((SIZE, SIZE), bool)
    known[:, :100] = False
    picture, _ = overlay(tmp_path, values, known)
    seen = picture[..., 3] > 0
    assert 0.6 < seen.mean() < 0.7
    assert picture[seen].min(axis=0)[0] == 0
    assert picture[seen].max(axis=0)[0] == 255
    assert (picture[~seen] == 0).all()


def test_a_large_raster_is_shrunk(tmp_path, monkeypatch):
    monkeypatch.setattr(orthophotos, "MOST_PX", 64)
    picture, _ = overlay(tmp_path, np.full((SIZE, SIZE, 1), 9, np.uint8))
    assert 60 <= max(picture.shape[:2]) <= 64


def test_no_raster(tmp_path):
    with pytest.raises(MapError, match=r"absent\.tif: cannot be read"):
        write_ground_overlay(tmp_path / "absent.tif", tmp_path / "a.png", tmp_path / "a.kml")
    assert list(tmp_path.iterdir()) == []
