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
"""The map of a node that starts, is stopped or killed meanwhile, and meets a fault of ours."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import time
from pathlib import Path

import pytest
from project import reader_of, wait_until

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import KeptLog, await_words

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.nodes.map_watch import MapWatch

PLANE = TangentPlane(math.radians(30.5), math.radians(114.3), 25.0)
#: Two seconds are what is asked for; the machine may do other work.
SOON_S = 6.0


def write_line(path: Path, length_deg: float = 0.001) -> None:
    line = [[114.3, 30.5], [114.3 + length_deg, 30.5]]
    path.write_text(json.dumps({"type": "LineString", "coordinates": line}))


def has_reader(pid: int) -> bool:
    try:
        return reader_of(pid) > 0
    except AssertionError:
        return False


def ended_soon(node) -> None:
    ended = node.wait(SOON_S)
    assert ended is not None, f"runs on: {node.text()}"
    assert ended.exit_code == 0
    assert "Traceback" not in node.text()


@pytest.fixture
def waiting(spawn, tmp_path):
    """A node whose map comes from a pipe to which nobody writes."""
    pipe = tmp_path / "slow.geojson"
    os.mkfifo(pipe)
    node = spawn("overlay_node", "-p", f"map:={pipe}", "-p", "ground_height_m:=20.0")
    wait_until(lambda: has_reader(node.pid))
    time.sleep(0.5)
    assert not node.said("ready")
    return node


@pytest.mark.graph
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_node_that_waits_for_its_map(waiting, number):
    reader = reader_of(waiting.pid)
    waiting.signal(number)
    ended_soon(waiting)
    assert waiting.said(f"stopped by {number.name}")
    assert not Path(f"/proc/{reader}").exists()


@pytest.mark.graph
def test_the_reader_ends_with_a_node_that_is_killed(waiting):
    reader = reader_of(waiting.pid)
    waiting.signal(signal.SIGKILL)
    assert waiting.wait(SOON_S) is not None
    wait_until(lambda: not Path(f"/proc/{reader}").exists(), SOON_S)


@pytest.mark.graph
def test_a_signal_ends_a_node_that_waits_for_its_elevation_model(spawn, tmp_path):
    pytest.importorskip("rasterio", reason="rasterio is not installed")
    os.mkfifo(tmp_path / "slow.tif")
    node = spawn("overlay_node", "-p", f"dem:={tmp_path / 'slow.tif'}")
    await_words(node, "no map")
    time.sleep(1.0)
    node.signal(signal.SIGTERM)
    ended_soon(node)


@pytest.fixture
def config(tmp_path) -> OverlayConfig:
    write_line(tmp_path / "map.geojson")
    return OverlayConfig(map=str(tmp_path / "map.geojson"), ground_height_m=30.0, reload_s=0.05)


def test_a_map_that_comes_later_is_read_then(config):
    """And the node starts without it: the video does not wait for a file."""
    reports, path = KeptLog(), Path(config.map)
    path.rename(path.with_suffix(".kept"))
    with MapWatch(reports, config, lambda: PLANE) as watch:
        wait_until(lambda: watch.changed() or watch.error)
        assert watch.failure == "map.geojson not found"
        path.with_suffix(".kept").rename(path)
        result = []
        wait_until(lambda: (laid := watch.changed()) and (result.append(laid) or True))
    assert result[0].features == 1
    assert watch.error == ""
    (line,) = reports.texts("warning")
    assert line == f"there is no map: {path}: there is no such map; check its name"


def test_after_a_fault_in_its_thread_the_map_is_still_watched(config):
    reports, asked = KeptLog(), []

    def plane() -> TangentPlane:
        asked.append(1)
        if len(asked) == 1:
            raise ZeroDivisionError("a fault of ours")
        return PLANE

    result = []
    with MapWatch(reports, config, plane) as watch:
        wait_until(lambda: (laid := watch.changed()) and (result.append(laid) or True))
    assert result[0].features == 1
    assert any("Traceback" in line and "a fault of ours" in line for line in reports.texts())
    assert any("there is no map" in line for line in reports.texts())


def test_of_a_failed_readers_output_one_page_is_logged(config, tmp_path, monkeypatch):
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\nhead -c 3000000 /dev/zero | tr '\\0' x >&2\n")
    broken.write_text(broken.read_text() + "echo; echo 'KeyError: a fault of ours' >&2; exit 1\n")
    broken.chmod(0o755)
    reports, whole = KeptLog(), sys.executable
    with MapWatch(reports, config, lambda: PLANE) as watch:
        wait_until(watch.changed)
        monkeypatch.setattr(sys, "executable", str(broken))
        write_line(Path(config.map), 0.002)
        wait_until(lambda: watch.changed() or watch.error)
        assert "the process that reads it ended (exit code 1)" in watch.error
        assert len(watch.error) < 4500
        message_text = [line for line in reports.texts() if "KeyError: a fault of ours" in line]
        assert message_text
        assert max(map(len, message_text)) < 4500
        monkeypatch.setattr(sys, "executable", whole)
        write_line(Path(config.map), 0.003)
        wait_until(lambda: watch.changed() is not None)
        assert watch.counts == {"reloads": 1, "reload_errors": 1}
