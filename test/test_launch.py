"""The launch file, run with stand-ins for ROS's launch, which no wheel holds."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[1]
NODES = {"dji_node", "ekf_node", "gimbal_node", "overlay_node", "bag_player"}


class Recorded(SimpleNamespace):
    def __init__(self, *positional, **named):
        super().__init__(positional=positional, **named)


class Argument(Recorded):
    def perform(self, context):
        return context[self.positional[0]]


@pytest.fixture
def launch_file(monkeypatch):
    names = {
        "launch": ("LaunchContext", "LaunchDescription"),
        "launch.actions": (
            "DeclareLaunchArgument",
            "OpaqueFunction",
            "SetEnvironmentVariable",
            "Shutdown",
        ),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
        "launch_ros.parameter_descriptions": ("ParameterValue",),
        "launch.substitutions": (),
    }
    for module_name, classes in names.items():
        module = ModuleType(module_name)
        for name in classes:
            setattr(module, name, type(name, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, module_name, module)
    sys.modules["launch.substitutions"].LaunchConfiguration = Argument
    for name in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"):
        monkeypatch.delenv(name, raising=False)
    return runpy.run_path(str(ROOT / "launch" / "tirgeo.launch.py"))


def launched(launch_file, **given):
    actions = launch_file["generate_launch_description"]().positional[0]
    declared = {
        action.positional[0]: action.default_value
        for action in actions
        if type(action).__name__ == "DeclareLaunchArgument"
    }
    assert given.keys() <= declared.keys()
    return {node.name: node for node in actions[-1].function(declared | given)}


def test_launch_without_arguments_starts_the_live_graph(launch_file):
    nodes = launched(launch_file)
    assert set(nodes) == NODES - {"bag_player"}
    for name, node in nodes.items():
        assert (node.package, node.executable, node.namespace) == ("tirgeo", name, "")
        assert node.parameters == [str(ROOT / "config" / "m600_xt2.yaml")]


def test_launch_on_a_bag_runs_in_sim_time_and_ends_with_it(launch_file, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    nodes = launched(launch_file, bag="7", map="my map.geojson", params_file="", namespace="uav1")
    assert set(nodes) == NODES - {"dji_node"}
    assert {node.namespace for node in nodes.values()} == {"uav1"}
    assert nodes["ekf_node"].parameters == [{"use_sim_time": True}]
    (sim_time, drawn) = nodes["overlay_node"].parameters
    assert sim_time == {"use_sim_time": True}
    assert drawn["map"].positional == (str(tmp_path / "my map.geojson"),)
    (played,) = nodes["bag_player"].parameters
    assert (played["bag"].positional, played["bag"].value_type) == ((str(tmp_path / "7"),), str)
    assert type(nodes["bag_player"].on_exit).__name__ == "Shutdown"


@pytest.mark.parametrize("word", ["false", "False", "0"])
def test_launch_leaves_dji_node_out_for_other_drivers(launch_file, word):
    assert set(launched(launch_file, dji=word)) == NODES - {"bag_player", "dji_node"}


def test_launch_asks_for_true_or_false(launch_file):
    with pytest.raises(ValueError, match="argument dji:=maybe: say true or false"):
        launched(launch_file, dji="maybe")


def test_launch_leaves_a_users_dds_profile_alone(launch_file, monkeypatch):
    (action,) = launch_file["video_profile"]()
    assert Path(action.positional[1]) == ROOT / "config" / "fastdds.xml"
    assert Path(action.positional[1]).is_file()
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", "/home/user/own.xml")
    assert launch_file["video_profile"]() == []
