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
"""Who reaches the nodes: this machine alone, or by SROS 2 each what it does and no more."""

from __future__ import annotations

import time
from importlib.util import find_spec
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import await_words, sockets
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sros2_policy import Permissions, allowed

from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.messages import SENSED_TOPICS, TOPIC_TYPES
from tirgeo_ros.nodes.dji_node import _LOST, PSDK_TOPICS, _is_installed
from tirgeo_ros.nodes.graph_node import message_class
from tirgeo_ros.nodes.recordings import TOPICS
from tirgeo_ros.tools.graph import find_resource

pytestmark = pytest.mark.graph


def test_a_profile_in_the_working_directory_opens_nothing(spawn, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wide = find_resource("config/fastdds.xml").read_text()
    Path("DEFAULT_FASTRTPS_PROFILES.xml").write_text(wide.replace('"tirgeo"', '"another"'))
    node = spawn("ekf_node")
    await_words(node, "ready")
    assert all(item.is_loopback for item in sockets(node.pid))


PICTURES = ("thermal/image_raw", "thermal/image_raw/compressed", "thermal/camera_info")
#: Those that others play.
OTHERS = {"camera", "operator"}
#: Where tf2_msgs is installed: no wheel has it.
TF = ("/tf", "/tf_static") if find_spec("tf2_msgs") else ()
RECORDED = [*TOPICS, *PICTURES[:2], *TF]


@pytest.fixture
def every_input(tmp_path) -> Path:
    """A bag with a message of each topic that a bag can bring."""
    path = tmp_path / "inputs.mcap"
    with BagWriter(path) as writer:
        for topic in (*SENSED_TOPICS, *PICTURES, "thermal/temperature/compressed"):
            data = serialize_message(message_class(TOPIC_TYPES[topic])())
            for second in (1, 100):
                writer.write(f"/{topic}", TOPIC_TYPES[topic], data, second * 1_000_000_000)
    return path


@pytest.mark.slow
def test_each_node_may_do_what_it_does_and_no_more(spawn, meet, every_input, tmp_path):
    """In a namespace, which tells relative names from absolute ones."""
    here = ("-r", "__ns:=/uav1", "-p", "use_sim_time:=true")
    for name in ("ekf_node", "gimbal_node", "overlay_node"):
        spawn(name, *here)
    port = ("-p", f"port:={tmp_path / 'aircraft'}")
    spawn("dji_node", *here, "-r", "__node:=dji_serial", *port)
    spawn("dji_node", *here, "-p", "source:=psdk")
    spawn("bag_player", *here[:2], "-p", f"bag:={every_input}")
    page = ("-p", "listen:=127.0.0.1:0", "-p", f"targets:={tmp_path / 'targets.gpkg'}")
    spawn("viewer_node", *here, *page)
    spawn("video_writer", *here, "-p", f"output:={tmp_path / 'out.ts'}")
    recorded = ("-p", f"output:={tmp_path / 'out.mcap'}", "-p", f"topics:={','.join(RECORDED)}")
    spawn("recorder", *here, *recorded)
    may = expected()
    looker = meet().node
    end_s = time.monotonic() + 30.0
    while (does := {name: of_node(looker, name) for name in may}) != may:
        if time.monotonic() > end_s:
            break
        time.sleep(0.2)
    assert does == may
    serial = of_node(looker, "dji_serial")
    assert serial["publish"] == may["dji_node"]["publish"]
    assert serial["subscribe"] <= may["dji_node"]["subscribe"]


def expected() -> dict[str, Permissions]:
    """What the policy allows our nodes, without the types that are not installed here."""
    policy = find_resource("config/sros2_policy.xml")
    result = {n: dict(may) for n, may in allowed(policy, "/uav1").items() if n not in OTHERS}
    absent = {topic for topic in _LOST if not _is_installed(PSDK_TOPICS[topic][0])}
    result["dji_node"]["subscribe"] -= {f"/uav1/psdk_ros2/{topic}" for topic in absent}
    if not TF:
        for may in result.values():
            for names in may.values():
                names -= {"/tf", "/tf_static"}
    return result


def of_node(looker: Node, name: str) -> Permissions:
    """What a node of the running graph does."""
    ask = {
        "publish": looker.get_publisher_names_and_types_by_node,
        "subscribe": looker.get_subscriber_names_and_types_by_node,
        "reply": looker.get_service_names_and_types_by_node,
        "request": looker.get_client_names_and_types_by_node,
    }
    if (name, "/uav1") not in looker.get_node_names_and_namespaces():
        return {}
    result = {key: {topic for topic, _ in answer(name, "/uav1")} for key, answer in ask.items()}
    return {key: names for key, names in result.items() if names}
