"""The launch file, run with stand-ins for ROS's launch, which no wheel holds."""

from __future__ import annotations

import os
import runpy
import sys
import xml.etree.ElementTree as ET
from types import ModuleType, SimpleNamespace

import pytest
from project import NODES, PROJECT

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


class Recorded(SimpleNamespace):
    def __init__(self, *positional, **named):
        super().__init__(positional=positional, **named)


class Argument(Recorded):
    def perform(self, context):
        return context[self.positional[0]]


@pytest.fixture
def launch_file(monkeypatch):
    names = {
        "launch": "LaunchContext LaunchDescription",
        "launch.action": "Action",
        "launch.actions": "DeclareLaunchArgument OpaqueFunction SetEnvironmentVariable Shutdown "
        "UnsetEnvironmentVariable",
        "launch_ros": "",
        "launch_ros.actions": "Node",
        "launch_ros.parameter_descriptions": "ParameterValue",
        "launch.substitutions": "",
    }
    for module_name, classes in names.items():
        module = ModuleType(module_name)
        for name in classes.split():
            setattr(module, name, type(name, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, module_name, module)
    sys.modules["launch.substitutions"].LaunchConfiguration = Argument
    for name in [name for name in os.environ if name.startswith(("ROS_", "RMW_", "FAST"))]:
        monkeypatch.delenv(name)
    return runpy.run_path(str(PROJECT / "launch" / "tirgeo.launch.py"))


def actions_of(launch_file, **given):
    actions = launch_file["generate_launch_description"]().positional[0]
    declared = {
        action.positional[0]: action.default_value
        for action in actions
        if type(action).__name__ == "DeclareLaunchArgument"
    }
    assert given.keys() <= declared.keys()
    return actions[-1].function(declared | given)


def launched(launch_file, **given):
    actions = actions_of(launch_file, **given)
    return {node.name: node for node in actions if type(node).__name__ == "Node"}


def environment_of(launch_file, **given):
    """What the launch file sets, and None for what it takes away."""
    return {
        action.positional[0]: dict(enumerate(action.positional)).get(1)
        for action in actions_of(launch_file, **given)
        if type(action).__name__.endswith("EnvironmentVariable")
    }


def test_launch_without_arguments_starts_the_live_graph(launch_file):
    nodes = launched(launch_file)
    assert set(nodes) == NODES - {"bag_player"}
    for name, node in nodes.items():
        assert (node.package, node.executable, node.namespace) == ("tirgeo", name, "")
        assert node.parameters == [str(PROJECT / "config" / "m600_xt2.yaml")]


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


@pytest.mark.parametrize("given", [{}, {"bag": "flight.mcap"}])
def test_each_node_has_the_enclave_of_the_policy(launch_file, given):
    policy = ET.parse(PROJECT / "config" / "sros2_policy.xml").getroot()
    enclaves = {item.get("path") for item in policy.iter("enclave")}
    for name, node in launched(launch_file, **given).items():
        assert node.ros_arguments == ["--enclave", f"/tirgeo/{name}"]
        assert node.ros_arguments[1] in enclaves


def test_launch_on_a_bag_is_for_this_machine_alone(launch_file, monkeypatch):
    monkeypatch.setenv("ROS_STATIC_PEERS", "192.0.2.7")
    assert environment_of(launch_file, bag="flight.mcap") == {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        "ROS_STATIC_PEERS": None,
        PROFILE: str(PROJECT / "config" / "fastdds_localhost.xml"),
        "SKIP_DEFAULT_XML_FILE": "1",
    }


@pytest.mark.parametrize("given", [{"bag": "flight.mcap", "localhost_only": "false"}, {}])
def test_launch_leaves_the_reach_to_the_user(launch_file, monkeypatch, given):
    """Where the launch file is told to, and on an aircraft, whose ground station looks on."""
    monkeypatch.setenv("ROS_STATIC_PEERS", "192.0.2.7")
    expected = {PROFILE: str(PROJECT / "config" / "fastdds.xml")}
    assert environment_of(launch_file, **given) == expected
    assert (PROJECT / "config" / "fastdds.xml").is_file()


def test_launch_leaves_a_users_dds_profile_alone(launch_file, monkeypatch):
    monkeypatch.setenv(PROFILE, "/home/user/own.xml")
    assert environment_of(launch_file) == {}
    on_bag = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    assert environment_of(launch_file, bag="flight.mcap") == on_bag
