"""Other formats through pyogrio, and what is said without it."""

import sys

import pytest

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps import load_layers

GPX = """<?xml version="1.0" encoding="utf-8"?>
<gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1">
<wpt lat="48.0" lon="16.0"><ele>3</ele><name>Stütze</name></wpt>
</gpx>"""


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
