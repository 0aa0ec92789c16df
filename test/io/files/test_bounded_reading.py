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
"""Maps and elevation models that name other places: fetched where a parameter allows it."""

from __future__ import annotations

import http.server
import platform
import socket
import threading

import numpy as np
import pytest
from measured import run_measured
from pyproj.network import set_network_enabled

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.types.errors import ConfigError, ElevationError, MapError
from tirgeo_ros.io.elevation.elevation_model import ground_of, load_terrain
from tirgeo_ros.io.files import bounded_reading as offline
from tirgeo_ros.io.maps.layers import read_layers

RASTER = """<VRTDataset rasterXSize="9" rasterYSize="9"><SRS>EPSG:32650</SRS>
<GeoTransform>500000,1,0,3300000,0,-1</GeoTransform><VRTRasterBand dataType="Float32" band="1">
<SimpleSource><SourceFilename relativeToVRT="0">{}</SourceFilename><SourceBand>1</SourceBand>
</SimpleSource></VRTRasterBand></VRTDataset>"""
VECTOR = """<OGRVRTDataSource><OGRVRTLayer name="a"><SrcDataSource>{}</SrcDataSource>
<SrcLayer>a</SrcLayer></OGRVRTLayer></OGRVRTDataSource>"""
SERVICE = "<OGRWFSDataSource><URL>{}/wfs</URL></OGRWFSDataSource>"
PLACES = [
    "/vsicurl/{}/x.tif",
    "/vsicurl_streaming/{}/x.tif",
    "/vsizip//vsicurl/{}/x.zip/x.tif",
    "/vsiwebhdfs/{}/x.tif",
    "{}/x.tif",
    "WFS:{}/",
    "OAPIF:{}/",
    "WCS:{}/",
    "WMTS:{}/",
    'STACIT:"{}/a.json"',
]
LOAD = """
import sys
from tirgeo_ros.io.maps import load_layers
print(load_layers(sys.argv[1], network=len(sys.argv) > 2))
"""
needs_filter = pytest.mark.skipif(
    platform.system() != "Linux" or platform.machine() not in offline._MACHINES,
    reason="the filter of system calls is known for Linux on two machines",
)


@pytest.fixture(autouse=True)
def projs_network():
    """Leave PROJ without a network, as the other tests find it."""
    yield
    set_network_enabled(active=False)


@pytest.fixture
def server():
    """A server that has nothing, and what was asked of it: (its address, requests)."""
    observed: list[str] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            observed.append(self.path)
            self.send_error(404)

        do_HEAD = do_POST = do_GET  # noqa: N815  names of the library

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as made:
        threading.Thread(target=made.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{made.server_port}", observed
        made.shutdown()


@needs_filter
def test_elevation_models(server, tmp_path):
    pytest.importorskip("rasterio", reason="elevation models need rasterio")
    address, observed = server
    path = tmp_path / "far.vrt"
    for place in PLACES:
        path.write_text(RASTER.format(place.format(address)))
        for dem in (str(path), place.format(address)):
            with pytest.raises(ElevationError, match="over the network only with the parameter"):
                ground_of(OverlayConfig(dem=dem))
    assert observed == []
    with pytest.raises(ElevationError):
        ground_of(OverlayConfig(dem=f"/vsicurl/{address}/y.tif", network=True))
    assert "/y.tif" in observed


@needs_filter
def test_maps(server, tmp_path):
    address, observed = server
    path = tmp_path / "far.vrt"
    for text in (SERVICE, *(VECTOR.replace("{}", place) for place in PLACES)):
        path.write_text(text.format(address))
        with pytest.raises(MapError, match=r"far\.vrt: "):
            read_layers(str(path))
    assert observed == []
    path.write_text(VECTOR.format(f"{address}/a.geojson"))
    run_measured(LOAD, str(path), "network")  # in a child, for pyogrio holds the interpreter
    assert "/a.geojson" in observed


def test_grids_of_a_datum(server, tmp_path, monkeypatch):
    """Great Britain's datum has a grid, which PROJ would fetch where the environment says so."""
    address, observed = server
    monkeypatch.setenv("PROJ_NETWORK", "ON")
    monkeypatch.setenv("PROJ_NETWORK_ENDPOINT", address)
    monkeypatch.setenv("PROJ_USER_WRITABLE_DIRECTORY", str(tmp_path / "proj"))
    path = tmp_path / "map.geojson"
    path.write_text(
        '{"type": "Point", "coordinates": [450000, 300000], '
        '"crs": {"type": "name", "properties": {"name": "EPSG:27700"}}}'
    )
    done = run_measured(LOAD, str(path))
    assert "MapLayer" in done.said, done
    assert observed == []
    run_measured(LOAD, str(path), "network")
    assert observed


@needs_filter
def test_a_thread_has_no_network_and_this_one_keeps_it(server):
    def connect() -> None:
        socket.create_connection(server[0].removeprefix("http://").split(":")).close()

    with pytest.raises(PermissionError):
        offline.read_map(connect, network=False)
    connect()
    offline.read_map(connect, network=True)


def test_where_the_kernel_does_not_help_gdal_is_not_asked(tmp_path, monkeypatch):
    rasterio = pytest.importorskip("rasterio", reason="elevation models need rasterio")
    monkeypatch.setattr(platform, "machine", lambda: "abacus")
    path = tmp_path / "a.tif"
    profile = {"width": 9, "height": 9, "count": 1, "dtype": "float32", "crs": "EPSG:32650"}
    place = rasterio.transform.from_origin(500_000.0, 3_300_000.0, 1.0, 1.0)
    with rasterio.open(path, "w", driver="GTiff", transform=place, **profile) as file:
        file.write(np.ones((9, 9), np.float32), 1)
    with pytest.raises(ConfigError, match=r"on abacus.*; set network: true"):
        load_terrain(path)
    assert load_terrain(path, network=True).highest_m == 1.0
    (tmp_path / "a.geojson").write_text('{"type": "Point", "coordinates": [16, 48]}')
    with pytest.raises(ConfigError, match=r"on abacus.*; set network: true"):
        read_layers(str(tmp_path / "a.geojson"))
    assert len(read_layers(str(tmp_path / "a.geojson"), network=True)) == 1
