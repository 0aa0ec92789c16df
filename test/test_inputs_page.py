"""docs/inputs.md says of each input what the code has."""

from __future__ import annotations

import re

from project import PROJECT

from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, TOPIC_TYPES

PAGE = (PROJECT / "docs" / "inputs.md").read_text()
OTHERS = {
    "gimbal/joint_states",
    "gimbal/attitude",
    "thermal/image_raw",
    "thermal/image_raw/compressed",
    "thermal/camera_info",
    "tirgeo/locate/pixel",
}


def test_every_input_is_there_with_its_type():
    rows = dict(re.findall(r"^\| `([a-z_/]+)` \| ([a-z_]+/[A-Za-z]+) \|", PAGE, re.MULTILINE))
    inputs = {topic for topic, _ in NAVIGATION_INPUTS.values()} | OTHERS
    assert rows == {topic: TOPIC_TYPES[topic].replace("/msg/", "/") for topic in inputs}


def test_every_parameter_on_the_page_is_one():
    known = {
        parameter.name
        for config in (EkfConfig, GimbalConfig, OverlayConfig)
        for parameter in parameters_of(config)
    }
    named = re.findall(r"`((?:[a-z]+\.)?[a-z_]+_(?:s|m|m_s|deg))`", PAGE)
    assert named
    assert set(named) <= known
