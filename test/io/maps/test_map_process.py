"""A map read and laid by another process: what comes of it, and of one that fails or dies."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from project import reader_of

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.overlay.map_renderer import drape_layers
from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.io.maps import load_layers
from tirgeo_ros.io.maps.map_process import MapProcess

PLANE = TangentPlane(math.radians(30.5), math.radians(114.3), 25.0)
LINE = [[114.3, 30.5], [114.301, 30.5005], [114.302, 30.501]]


@pytest.fixture
def config(tmp_path) -> OverlayConfig:
    path = tmp_path / "map.geojson"
    path.write_text(feature(LINE))
    return OverlayConfig(map=str(path), ground_height_m=30.0)


def feature(line) -> str:
    geometry = {"type": "LineString", "coordinates": line}
    return json.dumps({"type": "Feature", "properties": {}, "geometry": geometry})


@pytest.fixture
def child():
    made = MapProcess()
    yield made
    made.stop()


def test_the_map_is_the_one_that_this_process_would_lay(child, config):
    contents = child.read(config)
    assert (contents.features, contents.left_out) == (1, ())
    found, own = child.lay(PLANE), drape_layers(load_layers(config.map), PLANE, 30.0)
    np.testing.assert_array_equal(found.map.lines.points, own.map.lines.points)
    assert (found.plane, found.features) == (PLANE, contents.features)
    # Half and a whole thousandth of a degree to the north, at 110.85 km a degree there (WGS84).
    np.testing.assert_allclose(found.map.lines.points[0][-1], 110.85, rtol=1e-3)
    assert math.isnan(found.level_m)


def test_the_middle_of_own_heights_comes_with_the_map(child, config):
    high = [[*place, height] for place, height in zip(LINE, (10.0, 20.0, 60.0), strict=True)]
    Path(config.map).write_text(feature(high))
    child.read(OverlayConfig(map=config.map))
    assert child.lay(PLANE).level_m == 20.0


def test_a_map_is_read_anew_for_each_laying(child, config):
    child.read(config)
    child.read(config)  # the first is given up
    child.lay(PLANE)
    with pytest.raises(MapError, match=r"map\.geojson: nothing was read"):
        child.lay(PLANE)
    child.read(config)
    assert child.lay(PLANE).features == 1


def test_what_the_reading_raises_is_raised_here(child, config):
    with pytest.raises(ConfigError, match="1 of 1 features have no height; set ground_height_m"):
        child.read(OverlayConfig(map=config.map))
    Path(config.map).write_text("{")
    with pytest.raises(MapError, match=r"map\.geojson: not a readable map"):
        child.read(config)
    with pytest.raises(MapError, match=r"nowhere\.geojson"):
        child.read(OverlayConfig(map=str(Path(config.map).with_name("nowhere.geojson"))))


def test_a_reader_that_dies_is_an_error_that_names_the_map(child, config):
    child.read(config)
    os.kill(reader_of(os.getpid()), signal.SIGKILL)
    with pytest.raises(
        MapError, match=r"map\.geojson: the process that reads it ended \(exit code -9\)"
    ):
        child.lay(PLANE)
    assert child.read(config).features == 1  # the next one is none the worse


def test_a_reader_that_cannot_begin_is_an_error_that_names_the_map(child, config, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(
        MapError, match=r"map\.geojson: the process that reads it ended \(exit code 1\)"
    ):
        child.read(config)


def test_a_reading_is_stopped_from_another_thread(child, config, tmp_path):
    """The reader waits at a pipe that nobody writes to."""
    pipe = tmp_path / "slow.geojson"
    os.mkfifo(pipe)
    raised: list[MapError] = []

    def read() -> None:
        try:
            child.read(OverlayConfig(map=str(pipe), ground_height_m=30.0))
        except MapError as error:
            raised.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    time.sleep(0.2)
    child.stop()
    thread.join(10.0)
    assert not thread.is_alive()
    assert "slow.geojson: the process that reads it ended (exit code -9)" in str(raised[0])
    with pytest.raises(MapError, match=r"map\.geojson: not read: stopped"):
        child.read(config)
