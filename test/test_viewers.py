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
"""The viewers' files show topics of the contract, and a click goes where it is listened to."""

from __future__ import annotations

import json
import re

import yaml
from project import PROJECT

from tirgeo_ros.io.messages import TOPIC_TYPES

CONFIG = PROJECT / "config"
TOPICS = {f"/{topic.lstrip('/')}" for topic in TOPIC_TYPES}


def named(text):
    return set(re.findall(r"/(?:tirgeo|thermal|diagnostics)[a-z_/]*", text))


def test_foxglove_shows_the_overlay_and_publishes_clicks_to_locate():
    layout = json.loads((CONFIG / "foxglove_layout.json").read_text())
    panels = layout["configById"]
    overlay = panels["Image!overlay"]
    assert overlay["imageMode"]["imageTopic"] == "/tirgeo/overlay/image/compressed"
    assert overlay["publish"]["type"] == "point"
    assert overlay["publish"]["pointTopic"] == "/tirgeo/locate/pixel"
    assert set(leaves(layout["layout"])) == set(panels)
    assert named(json.dumps(layout)) <= TOPICS


def leaves(tree):
    if isinstance(tree, str):
        return [tree]
    return [*leaves(tree["first"]), *leaves(tree["second"])]


def test_rviz_shows_the_overlay_and_what_was_located():
    text = (CONFIG / "tirgeo.rviz").read_text()
    displays = yaml.safe_load(text)["Visualization Manager"]["Displays"]
    topics = {item["Topic"]["Value"]: item["Class"] for item in displays if "Topic" in item}
    assert topics["tirgeo/overlay/image"] == "rviz_default_plugins/Image"
    assert topics["tirgeo/locate/point"] == "rviz_default_plugins/PoseWithCovariance"
    assert set(topics) <= TOPIC_TYPES.keys()  # relative, for a namespace
    assert "Frame: map" not in text.replace("Fixed Frame: map", "")  # rviz2 -f changes that one


def test_the_router_of_an_aircraft_limits_topics_that_exist():
    text = (PROJECT / "config" / "zenoh_aircraft.json5").read_text()
    limited = re.findall(r'key_expr: "\*/\*\*/(.+?)/\*\*"', text)
    assert len(limited) >= 5
    types = {name.replace("/msg/", "::msg::dds_::") + "_" for name in TOPIC_TYPES.values()}
    assert set(limited) <= set(TOPIC_TYPES) | types
