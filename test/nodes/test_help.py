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
"""``NODE --help``, printed without ROS, and docs/parameters.md: true to what the node has."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import yaml
from project import PROJECT

from dev.parameters_page import parameters_page
from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.nodes.help import as_yaml, help_text

BLOCKED = """
import sys
sys.modules["rclpy"] = None
from tirgeo_ros.nodes.start import start
sys.exit(start(sys.argv.pop(1), sys.argv.pop(1)))
"""


@pytest.mark.parametrize(
    ("name", "package"), [("ekf_node", "tirgeo_ros.nodes"), ("soak_mute", "dev.nodes")]
)
def test_help_needs_no_ros_and_ends_well(name, package):
    run = subprocess.run(
        [sys.executable, "-c", BLOCKED, name, package, "--help"],
        env=os.environ | {"PYTHONPATH": str(PROJECT)},
        check=False,
        capture_output=True,
        text=True,
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout == help_text(name, package)


LIVE = "  [in flight]"


@pytest.mark.parametrize("name", NODE_CONFIGS)
def test_every_parameter_is_there_with_default_and_unit(name):
    lines = help_text(name).splitlines()
    assert lines[0].startswith(f"{name}: ")
    assert max(map(len, lines)) < 115  # a module's first line, led by its name
    for item in parameters_of(NODE_CONFIGS[name]):
        reports = next(line for line in lines if line.startswith(f"  {item.name}  "))
        value = reports.removesuffix(LIVE)
        assert (value != reports) is item.live
        assert value.endswith((f" {item.unit}", "unset", "empty")) or not item.unit


def test_defaults_are_written_as_in_a_parameter_file():
    text = help_text("overlay_node")
    assert f"  video_latency_s  0.05 s{LIVE}\n      delay of the video: " in text
    assert "  ground_height_m  unset\n" in text
    assert f"  picture.stretch_percent  [1.0, 99.0] %{LIVE}\n" in text
    assert f"  rectify  false{LIVE}\n" in text
    assert "(white_hot, black_hot, iron, rainbow, arctic, lava)" in text


def test_the_page_is_current_and_has_every_parameter():
    page = (PROJECT / "docs" / "parameters.md").read_text()
    assert parameters_page() == page, (
        "docs/parameters.md is not what the code says: make parameters"
    )
    for kind in NODE_CONFIGS.values():
        for item in parameters_of(kind):
            assert f"| `{item.name}` |" in page
            assert item.description in page


def test_defaults_are_read_as_they_are_written():
    for kind in NODE_CONFIGS.values():
        for item in parameters_of(kind):
            if as_yaml(item.default) not in ("unset", "empty"):
                read = yaml.safe_load(as_yaml(item.default))
                assert repr(tuple(read) if isinstance(read, list) else read) == repr(item.default)
