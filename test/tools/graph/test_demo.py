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
"""The demonstration's parts that need no node."""

from __future__ import annotations

import argparse
import os
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest
from project import taken_port

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.errors import BagError, GraphError
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.files.dds_profiles import PROFILES, take_small_profile
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, NodeState, TopicState
from tirgeo_ros.io.messages.json_codec import state_text
from tirgeo_ros.tools.cli import demo
from tirgeo_ros.tools.cli._verb import UsageError, add_verb
from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.graph.demo import (
    against_truth,
    demo_setup,
    demonstrate,
    make_pictures,
    summary,
)
from tirgeo_ros.tools.graph.node_graph import GraphSetup, free_domain, graph_environment
from tirgeo_ros.tools.replay.graph_outputs import read_outputs

MS = 1_000_000
PLANE = TangentPlane(0.7, 2.0, 11.0)
MESSAGES = Messages()


def write(path: Path, topics: list[tuple[str, object, int]]) -> Path:
    with BagWriter(path) as writer:
        for topic, message, log_ns in topics:
            name = topic if topic.startswith("/") else f"/{topic}"
            writer.write(name, TOPIC_TYPES[topic], message, log_ns)
    return path


def pose(stamp_ns: int, east_m: float = 0.0) -> CameraPose:
    q = np.array([0.5, 0.5, 0.5, 0.5])
    return CameraPose(stamp_ns, np.array([0.0, east_m, -20.0]), q, np.zeros((6, 6)))


def status_at(stamp_ns: int, sigma_rad: float) -> tuple[str, object, int]:
    status = NavigationStatus(
        "ekf_heading", FilterState.RUNNING, "", FixStatus.FIXED, sigma_rad, {}, {}
    )
    state = NodeState("/ekf_node", stamp_ns, 1, navigation=status)
    return "tirgeo/state", MESSAGES.text(state_text(state)), stamp_ns


def test_the_summary_has_what_the_nodes_published(tmp_path):
    grey = np.full((8, 8, 3), 90, np.uint8)
    jpeg = cv2.imencode(".jpg", grey)[1].tobytes()
    pictures = [
        ("tirgeo/overlay/image/compressed", MESSAGES.compressed(t * 100 * MS, jpeg), t * 100 * MS)
        for t in range(1, 11)
    ]
    poses = [
        ("tirgeo/camera_pose", MESSAGES.camera_pose(pose(t * 20 * MS)), t * 20 * MS)
        for t in range(22, 50)
    ]
    statuses = [status_at(300 * MS, np.radians(0.2)), status_at(600 * MS, np.radians(0.1))]
    topics = {"tirgeo/overlay/image": TopicState(9.0, latency_ms=12.5)}
    overlay = NodeState("/overlay_node", 700 * MS, 1, topics, {"drawn": 7, "notices": 3})
    statuses.append(("tirgeo/state", MESSAGES.text(state_text(overlay)), 700 * MS))
    path = write(tmp_path / "run.mcap", pictures + poses + statuses)
    result = summary(read_outputs(path), begin_ns=0)
    assert result["method"] == "ekf_heading"
    assert result["overlay"] == {"drawn": 7, "notices": 3}
    assert result["frame_latency_ms"] == 12.5
    assert result["heading_sigma_deg"] == pytest.approx(0.15)
    assert result["first_map_after_s"] == pytest.approx(0.5)  # the first frame after 0.44 s
    made = make_pictures(path, tmp_path, 10)
    assert Path(str(made["video"])).stat().st_size > 0
    assert Path(str(made["still"])).stat().st_size > 0


def test_poses_are_judged_against_the_truth_after_settling(tmp_path):
    def bag(name: str, early_m: float, late_m: float) -> Path:
        origin = ("tirgeo/origin", MESSAGES.origin(PLANE, 0), 0)
        cameras = []
        for k in range(0, 20_000, 20):
            off_m = early_m if k < 10_000 else late_m
            message = MESSAGES.camera_pose(pose(k * MS, off_m))
            cameras.append(("tirgeo/camera_pose", message, k * MS))
        return write(tmp_path / name, [origin, *cameras])

    judged = against_truth(read_outputs(bag("run.mcap", 9.0, 0.03)), bag("truth.mcap", 0.0, 0.0))
    assert judged is not None
    assert judged["poses"] == 500
    # Latitude and longitude go through degrees in the origin: 1e-9 m.
    assert judged["position_rms_m"] == pytest.approx(0.03, abs=1e-6)
    assert judged["heading_rms_deg"] == pytest.approx(0.0, abs=1e-6)


def test_the_nodes_are_for_this_machine_alone_in_a_domain_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    first = free_domain()
    with taken_port(first):
        assert free_domain() != first
    wider = {"ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"}
    for name in wider:
        monkeypatch.setenv(name, "1")
    for name in PROFILES:
        monkeypatch.delenv(name, raising=False)
    environment = graph_environment(GraphSetup(tmp_path, tmp_path))
    assert not wider & set(environment)
    assert 1 <= int(environment["ROS_DOMAIN_ID"]) <= 100
    assert environment[PROFILES[0]].endswith("fastdds_localhost.xml")
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SYSTEM_DEFAULT"
    again = GraphSetup(tmp_path, tmp_path, environment=environment)
    assert graph_environment(again) == environment


@pytest.mark.parametrize(
    ("name", "value"),
    [*((name, "own.xml") for name in PROFILES), ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")],
)
def test_a_users_own_dds_is_kept_to_this_machine_by_ros(tmp_path, monkeypatch, name, value):
    for profile in PROFILES:
        monkeypatch.delenv(profile, raising=False)
    monkeypatch.setenv(name, value)
    environment = graph_environment(GraphSetup(tmp_path, tmp_path))
    assert environment[name] == value
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_the_profile_of_one_machine_is_the_other_with_less_reach():
    """Fast DDS's XML has no way to include one file in another."""
    wide, narrow = (
        ET.parse(find_resource(f"config/{name}.xml")).getroot()
        for name in ("fastdds", "fastdds_localhost")
    )
    reach = {}
    for parent in list(narrow.iter()):
        for child in list(parent):
            name = child.tag.rpartition("}")[2]
            if name in {"interfaceWhiteList", "builtin"}:
                reach[name] = "".join(child.itertext()).split()
                parent.remove(child)
    assert reach == {"interfaceWhiteList": ["127.0.0.1"], "builtin": ["127.0.0.1"] * 2}
    for narrowed, item in zip(narrow.iter(), wide.iter(), strict=True):
        texts = (narrowed.text or "", item.text or "")
        assert (narrowed.tag, texts[0].strip()) == (item.tag, texts[1].strip())


@pytest.mark.parametrize("name", ["fastdds", "fastdds_localhost"])
def test_a_node_without_pictures_takes_the_profile_with_a_small_segment(monkeypatch, name):
    whole, small = (find_resource(f"config/{each}.xml") for each in (name, f"{name}_small"))
    changed = [
        (there.tag.rpartition("}")[2], there.text, here.text)
        for there, here in zip(ET.parse(whole).iter(), ET.parse(small).iter(), strict=True)
        if (there.tag, there.text, there.attrib) != (here.tag, here.text, here.attrib)
    ]
    assert changed == [
        ("segment_size", "16777216", "1048576"),
        ("maxMessageSize", "16777216", "1048576"),
    ]
    for variable, value, taken in (
        (PROFILES[0], str(whole), str(small)),
        (PROFILES[1], "own.xml", "own.xml"),  # a profile of the user's own stays
    ):
        monkeypatch.setenv(variable, value)
        take_small_profile()
        assert os.environ[variable] == taken


def test_impossible_demonstrations_are_refused(tmp_path):
    with pytest.raises(GraphError, match=r"has no tirgeo/overlay/image"):
        make_pictures(tmp_path / "run.mcap", tmp_path, 0)
    path = write(tmp_path / "a.mcap", [("/clock", MESSAGES.clock(5), 5)])
    with pytest.raises(BagError, match=r"needed topic absent: /imu/data, /thermal/camera_info"):
        demonstrate(GraphSetup(path, tmp_path / "out"))
    parser = argparse.ArgumentParser()
    add_verb(parser.add_subparsers(), demo)
    words = ["demo", "--serial", "--rate", "2", "-o", str(tmp_path)]
    with pytest.raises(UsageError, match=r"--serial runs in real time: leave --rate out"):
        demo.run(parser.parse_args(words))
    nowhere = tmp_path / "nowhere.geojson"  # before the flight: the node would go on without it
    with pytest.raises(GraphError, match=rf"^{nowhere}: there is no such map"):
        demo_setup(path, tmp_path, None, nowhere, None, 1.0, serial=False)
