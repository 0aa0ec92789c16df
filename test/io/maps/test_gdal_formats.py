"""Other formats through pyogrio, and what is said without it."""

import sys

import numpy as np
import pytest
from map_files import RING, wkb

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps import load_layers

GPX = """<?xml version="1.0" encoding="utf-8"?>
<gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1">
<wpt lat="48.0" lon="16.0"><ele>3</ele><name>Stütze</name></wpt>
</gpx>"""


def test_flatgeobuf_in_a_projected_system(tmp_path):
    pyogrio = pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    path = tmp_path / "a.fgb"
    line = np.array([wkb("LineString", [(500000.0, 0.0), (500000.0, 1000.0)])], object)
    pyogrio.raw.write(
        path,
        line,
        [np.array(["Straße"], object)],
        ["name"],
        crs="EPSG:32633",
        geometry_type="LineString",
        driver="FlatGeobuf",
    )
    (layer,) = load_layers(str(path))
    (feature,) = layer.features
    assert (feature.label, feature.group) == ("Straße", 0)
    np.testing.assert_allclose(np.degrees(feature.points[0, :2]), [0.0, 15.0], atol=1e-9)


def test_a_geodatabase_is_a_folder(tmp_path):
    pyogrio = pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    path = tmp_path / "a.gdb"
    ring = np.array([wkb("MultiPolygon", [[RING]]), None], object)
    pyogrio.raw.write(
        path,
        ring,
        [np.array([7, 8], np.int32)],
        ["ref"],
        crs="EPSG:4326",
        geometry_type="MultiPolygon",
        driver="OpenFileGDB",
        layer="site",
    )
    (layer,) = load_layers(str(path), "", "REF")
    assert [(f.label, f.closed, f.group) for f in layer.features] == [("7", True, 0)]
    assert layer.name == "site"


def test_gpx(tmp_path):
    pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    path = tmp_path / "a.gpx"
    path.write_text(GPX, "utf-8")
    (layer,) = load_layers(str(path))
    assert (layer.name, layer.features[0].label) == ("waypoints", "Stütze")
    np.testing.assert_allclose(np.degrees(layer.features[0].points[0, 1::-1]), RING[0], atol=1e-12)


def test_what_pyogrio_cannot_read(tmp_path):
    pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    path = tmp_path / "a.xyz"
    path.write_bytes(b"\0\1\2 no map at all")
    with pytest.raises(MapError, match=r"a.xyz: no map that can be read") as caught:
        load_layers(str(path))
    assert "\n" not in str(caught.value)


def test_without_pyogrio_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    path = tmp_path / "a.fgb"
    path.write_bytes(b"fgb\3fgb\0")
    with pytest.raises(MapError, match=r"GeoPackage, .* KMZ; .* pip install 'tirgeo\[maps\]'"):
        load_layers(str(path))
