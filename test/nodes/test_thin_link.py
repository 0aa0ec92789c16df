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
"""What leaves an aircraft: fewer compressed pictures, and who finds whom by a discovery server."""

from __future__ import annotations

import socket
import subprocess

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import await_words
from overlay_flight import Flight, write_map
from overlays import SQUARE_N
from project import free_port
from sensor_msgs.msg import CompressedImage, Image

from tirgeo_ros.io.files.child_process import python_command
from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.tools.graph import find_resource

pytestmark = pytest.mark.graph

_SERVER = """
import signal, rclpy
rclpy.init()
node = rclpy.create_node("discovery_server")
print("ready", flush=True)
signal.sigwait({signal.SIGTERM, signal.SIGINT})
"""


@pytest.mark.slow
def test_compressed_pictures_come_at_their_own_rate(spawn, meet, tmp_path):
    write_map(tmp_path / "map.geojson", SQUARE_N)
    given = {"map": tmp_path / "map.geojson", "ground_height_m": 25.0, "compressed_rate_hz": 5.0}
    words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    await_words(spawn("overlay_node", *words), "ready")
    flown = Flight(
        meet(tirgeo__overlay__image__compressed=CompressedImage, tirgeo__overlay__image=Image)
    )
    jpegs = flown.stranger.received["tirgeo/overlay/image/compressed"]
    pictures = flown.stranger.received["tirgeo/overlay/image"]
    flown.until(lambda: len(jpegs) >= 8 and len(pictures) >= 12)
    stamps = [stamp_ns(jpeg) for jpeg in jpegs]
    # Eight in 7 periods of 0.2 s; the first and the last may be off by a quarter of one.
    assert stamps[7] - stamps[0] >= 7 * 200_000_000 - 2 * 50_000_000
    assert set(stamps[1:-1]) <= {stamp_ns(item) for item in pictures}


@pytest.fixture
def remote(environment, tmp_path) -> dict[str, str]:
    """The environment of a launch that others may reach, as a client of a server on this host."""
    theirs = {k: v for k, v in environment.items() if not k.startswith(("ROS_AUTO", "SKIP"))}
    port = free_port(socket.SOCK_DGRAM)
    profile = find_resource("config/fastdds_server.xml").read_text()
    (tmp_path / "server.xml").write_text(profile.replace("<port>11811<", f"<port>{port}<"))
    return theirs | {
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(find_resource("config/fastdds.xml")),
        "ROS_DISCOVERY_SERVER": f"127.0.0.1:{port}",
    }


@pytest.mark.slow
def test_nodes_meet_through_a_discovery_server_alone(spawn_in, remote, flight_bag, tmp_path):
    start = spawn_in(remote)
    ekf = start("ekf_node")
    await_words(ekf, "ready")
    play = ["-p", f"bag:={flight_bag}", "-p", "live:=true", "-p", "wait_for:=imu/data", "-p"]
    alone = start("bag_player", *play, "wait_timeout_s:=3.0")
    await_words(alone, "playing without a subscriber of")
    server = remote | {"FASTRTPS_DEFAULT_PROFILES_FILE": str(tmp_path / "server.xml")}
    del server["ROS_DISCOVERY_SERVER"]
    log = tmp_path / "server.log"
    with (
        log.open("w") as out,
        subprocess.Popen(python_command(_SERVER), env=server, stdout=out, stderr=out) as process,
    ):
        player = start("bag_player", *play, "wait_timeout_s:=60.0")
        await_words(player, "playing")
        assert "playing without" not in player.text()
        await_words(ekf, "aligning")
        process.terminate()
    # A profile that Fast DDS cannot read is told on stderr, and then not used.
    assert log.read_text() == "ready\n"
    assert "XMLPARSER" not in ekf.text() + player.text()
