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
"""Frames over DDS: transforms, the track, the picture's calibration and its footprint."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from geometry_msgs.msg import PolygonStamped
from graph_helpers import KeptLog, await_words
from message_samples import BODY, CAMERA_POSE
from overlay_flight import Flight, write_map
from overlays import SQUARE_N
from sensor_msgs.msg import CameraInfo, Image
from transform_chains import Chains, rigid

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.messages import Messages, stamp_ns
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.io.messages.pictures import camera
from tirgeo_ros.nodes import graph_node

PREFIX = ("-p", "frame_prefix:=uav1/")


class Topics:
    """Stands in for a node, and for its publishers: keeps what is published by topic."""

    def __init__(self):
        self.messages, self.now_ns, self.kept = Messages(), 5, {}

    def advertise(self, topic, _quality):
        kept = self.kept.setdefault(topic, [])
        return SimpleNamespace(publish=kept.append, is_wanted=True)


def test_through_tf_the_camera_is_at_its_pose(monkeypatch):
    monkeypatch.setattr(graph_node, "message_class", Cdr().types)
    node = Topics()
    made = graph_node.Transforms(node, EkfConfig())
    made.fixed(EkfConfig().aircraft)
    made.body(BODY)
    made.camera(CAMERA_POSE, lambda _: BODY)
    made.camera(CAMERA_POSE, lambda _: Miss.GAP)
    (fixed,) = node.kept["/tf_static"]
    assert {item.header.frame_id for item in fixed.transforms} == {"base_link"}
    assert "imu_link" in {item.child_frame_id for item in fixed.transforms}
    assert len(node.kept["/tf"]) == 2
    pose = node.messages.camera_pose(CAMERA_POSE).pose.pose
    result = Chains(node.kept["/tf"]).pose("tir_optical_frame", CAMERA_POSE.stamp_ns)
    wanted = rigid(pose.position, pose.orientation)
    np.testing.assert_allclose(result, wanted, rtol=0, atol=1e-10)  # roundings, at some 100 m


@pytest.mark.graph
@pytest.mark.slow
def test_a_rectified_picture_has_its_calibration_and_its_footprint(spawn, meet, tmp_path):
    write_map(tmp_path / "map.geojson", SQUARE_N)
    given = (f"map:={tmp_path}/map.geojson", "ground_height_m:=25.0", "rectify:=true")
    node = spawn("overlay_node", *PREFIX, *(word for each in given for word in ("-p", each)))
    await_words(node, "ready")
    topics = {
        "tirgeo/overlay/image": Image,
        "tirgeo/overlay/camera_info": CameraInfo,
        "tirgeo/footprint": PolygonStamped,
    }
    flown = Flight(meet(**topics))
    flown.shown()
    got = flown.stranger.received

    def all_came() -> bool:
        outlines = got["tirgeo/footprint"]
        return bool(outlines and outlines[-1].polygon.points and paired(got))

    flown.until(all_came)
    info, picture = paired(got)[-1]
    assert info.header == picture.header
    assert picture.header.frame_id == "uav1/tir_optical_frame"
    result = camera(info)
    assert (result.fx, result.fy, result.cx, result.cy) == (XT2.fx, XT2.fy, XT2.cx, XT2.cy)
    assert not any(info.d)
    outline = got["tirgeo/footprint"][-1]
    assert outline.header.frame_id == "uav1/map"
    node.check_running()


def paired(got) -> list[tuple[CameraInfo, Image]]:
    """The calibrations and pictures of one stamp."""
    infos = {stamp_ns(item): item for item in got["tirgeo/overlay/camera_info"]}
    pictures = got["tirgeo/overlay/image"]
    return [(infos[stamp_ns(item)], item) for item in pictures if stamp_ns(item) in infos]


def test_without_tf2_msgs_one_line_is_logged_and_nothing_is_published(monkeypatch):
    def absent(typename):
        raise ConfigError(f"message type {typename} is not installed")

    monkeypatch.setattr(graph_node, "message_class", absent)
    node = KeptLog()
    made = graph_node.Transforms(node, EkfConfig())
    made.fixed(EkfConfig().aircraft)
    made.body(None)
    made.camera(None, math.nan)
    assert node.lines == [("info", "no /tf: tf2_msgs is not installed (apt: ros-jazzy-tf2-msgs)")]
    quiet = KeptLog()
    graph_node.Transforms(quiet, EkfConfig(publish_tf=False))
    assert quiet.lines == []
