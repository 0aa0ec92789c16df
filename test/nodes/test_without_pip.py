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
"""Every node on the sample flight, with nothing that rosdep has no apt key for.

As on Ubuntu 24.04 with ROS from its packages, where pip has installed nothing. Only rosbag2_py is
a stand-in (test/support/blocked_imports.py).
"""

from __future__ import annotations

import asyncio
import re
import subprocess
from collections import Counter

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from blocked_imports import allowed_modules, blocked
from graph_helpers import await_words
from page_clients import Page, next_picture

from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files import child_process
from tirgeo_ros.tools.graph.node_graph import parameter_words, run_graph

pytestmark = pytest.mark.graph

#: What has no key, or one for pip alone.
NO_KEY = ("mcap", "rosbags", "lz4", "zstandard", "av", "pyogrio", "mgrs", "pytak", "pyulog")
KEYED = ("numpy", "cv2", "PIL", "pyproj", "yaml", "aiohttp", "segno", "rclpy", "rosbag2_py")
FINDS = """
from importlib.util import find_spec
print(*filter(find_spec, sys.argv[1:]))
import cv2, rclpy.node, rosbag2_py, aiohttp, pyproj
"""


@pytest.fixture
def without_pip(monkeypatch):
    command = blocked(child_process.python_command, allowed_modules())
    monkeypatch.setattr(child_process, "python_command", command)


def test_the_block_holds(without_pip):
    command = child_process.python_command(FINDS, *NO_KEY, *KEYED, "pytest", "tirgeo_ros")
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.stdout.split(), run.stderr) == ([*KEYED, "tirgeo_ros"], "")


async def recorded(url, setup):
    """Run the graph while the page records and shows pictures; return both answers."""
    async with Page(url) as page:
        async with page.state() as states:
            words = (await states.ask("record", aircraft="", on=True))["text"]
        flight = asyncio.create_task(asyncio.to_thread(run_graph, setup, 30.0))
        async with page.video() as video:
            await next_picture(video)
        run = await flight
        async with page.state() as states:
            await states.ask("record", aircraft="", on=False)
        return run, words


def test_every_node_runs(without_pip, sample_graph, spawn, tmp_path):
    setup = sample_graph(tmp_path, serial=True)  # whole: a busy machine is seconds late
    page = {"listen": "127.0.0.1:0", "targets": tmp_path / "targets.gpkg", "map": setup.map}
    page |= {"cot": "tcp://127.0.0.1:1", "stream": "udp://127.0.0.1:5004"}
    page |= {"record_to": tmp_path / "bags"}
    viewer = spawn("viewer_node", *parameter_words(page))
    await_words(viewer, "the page is at")
    url = re.search(r"the page is at (http://\S+)/", viewer.text())[1]
    run, words = asyncio.run(recorded(url, setup))
    assert run.error is None
    counts = Counter(item.topic for item in BagReader(run.recording).messages())
    for topic in ("odometry", "camera_pose", "overlay/image/compressed"):
        assert counts[f"/tirgeo/{topic}"] > 20, counts
    assert re.search(r"map\.geojson: \d+ features", (tmp_path / "overlay_node.log").read_text())
    (bag,) = (tmp_path / "bags").glob("*.mcap")
    assert {"/imu/data", "/tirgeo/odometry"} <= BagReader(bag).topics().keys()
    # What has no key is left out, and said.
    assert re.search(r"no video: .*\bav\b", words), words
    for line in ("no MGRS.* mgrs", "nothing is sent to the team.* pytak", "stream: no video.* av"):
        assert re.search(line, viewer.text()), viewer.text()
