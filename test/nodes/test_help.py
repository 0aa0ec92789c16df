"""``NODE --help``: printed without ROS, and true to what the node has."""

from __future__ import annotations

import ast
import os
import subprocess
import sys

import pytest
from project import PROJECT

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.io.messages import DJI_TOPICS, NAVIGATION_INPUTS, TOPIC_TYPES
from tirgeo_ros.nodes.__main__ import NAMES
from tirgeo_ros.nodes.help import TOPICS, help_text

BLOCKED = """
import sys
sys.modules["rclpy"] = None
from tirgeo_ros.nodes.start import start
sys.exit(start(sys.argv.pop(1), sys.argv.pop(1)))
"""
#: Modules in which a node's topics stand, and those that stand there by another name.
WRITTEN = {
    "dji_node": (("dji_node", "diagnostics"), set(DJI_TOPICS)),
    "ekf_node": (("ekf_node", "diagnostics"), {one for one, _ in NAVIGATION_INPUTS.values()}),
    "gimbal_node": (("gimbal_node", "diagnostics"), set()),
    "overlay_node": (("overlay_node", "diagnostics"), set()),
}


@pytest.mark.parametrize(
    ("name", "package"),
    [
        *((name, "tirgeo_ros.nodes") for name in ("ekf_node", "dji_node", "recorder")),
        ("soak_mute", "dev.nodes"),
    ],
)
@pytest.mark.parametrize("option", ["-h", "--help"])
def test_help_needs_no_ros_and_ends_well(name, package, option):
    run = subprocess.run(
        [sys.executable, "-c", BLOCKED, name, package, option],
        env=os.environ | {"PYTHONPATH": str(PROJECT)},
        check=False,
        capture_output=True,
        text=True,
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout == help_text(name, package=package)


@pytest.mark.parametrize("name", NAMES)
def test_every_node_says_what_it_does_in_lines_that_fit(name):
    text = help_text(name, ["--help-all"])
    assert text.startswith(f"{name}: ")
    assert len(text.splitlines()[0]) > len(name) + 20
    assert max(map(len, text.splitlines())) < 115  # a module's first line, led by its name


@pytest.mark.parametrize("name", NODE_CONFIGS)
def test_every_parameter_is_there_by_name_and_wholly_on_request(name):
    short, whole = help_text(name), help_text(name, ["--help-all"])
    for one in parameters_of(NODE_CONFIGS[name]):
        assert one.name.rpartition(".")[2] in short
        lines = whole.splitlines()
        told = next(line for line in lines if line.startswith(f"  {one.name}  "))
        assert told.endswith((f" {one.unit}", "unset", "empty")) or not one.unit
        assert " ".join(one.description.split()[:3]) in whole


def test_defaults_are_written_as_in_a_parameter_file():
    text = help_text("overlay_node", ["--help-all"])
    assert "  video_latency_s  0.05 s\n      delay of the video: " in text
    assert "  ground_height_m  unset\n" in text
    assert "  picture.stretch_percent  [1.0, 99.0] %\n" in text
    assert "  rectify  false\n" in text
    assert "(white_hot, black_hot, iron, rainbow, arctic, lava)" in text


@pytest.mark.parametrize("name", WRITTEN)
def test_topics_are_those_that_the_node_has(name):
    modules, elsewhere = WRITTEN[name]
    found = set(elsewhere)
    for module in modules:
        tree = ast.parse((PROJECT / "tirgeo_ros" / "nodes" / f"{module}.py").read_text())
        found |= {n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)} & set(
            TOPIC_TYPES
        )
    inputs, outputs = TOPICS[name]
    assert {*inputs, *outputs} == found
    for topic in found:
        assert f"  {topic} " in help_text(name)
