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
"""The launch file, run with stand-ins for ROS's launch, which no wheel holds."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from types import SimpleNamespace

import pytest
from launch_stand_ins import actions_of, environment_of, launched, loaded, plain
from project import NODES, PROJECT

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


@pytest.fixture
def launch_file(monkeypatch):
    return loaded(monkeypatch)


@pytest.fixture
def flight(tmp_path):
    path = tmp_path / "flight.mcap"
    path.touch()
    return str(path)


def test_launch_without_arguments_starts_the_live_graph(launch_file):
    nodes = launched(launch_file)
    assert set(nodes) == NODES - {"bag_player", "viewer_node"}
    for name, node in nodes.items():
        assert (node.package, node.executable, node.namespace) == ("tirgeo", name, "")
        assert node.parameters == [str(PROJECT / "config" / "m600_xt2.yaml")]


def test_launch_on_a_bag_runs_in_sim_time_and_in_its_namespace(launch_file, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for name in ("7", "my map.geojson", "b.gpkg"):
        (tmp_path / name).touch()
    options = {"map": "my map.geojson,b.gpkg", "params_file": "", "namespace": "uav1"}
    nodes = launched(launch_file, bag="7", **options)
    assert set(nodes) == NODES - {"dji_node", "viewer_node"}
    for node in nodes.values():
        assert (node.namespace, node.remappings) == ("uav1", [("/clock", "clock")])
    assert nodes["ekf_node"].parameters == [{"use_sim_time": True}]
    files = [str(tmp_path / name) for name in ("b.gpkg", "7")]
    assert launched(launch_file, params_file=",".join(files))["ekf_node"].parameters == files
    (drawn,) = nodes["overlay_node"].parameters
    assert drawn["use_sim_time"] is True
    assert drawn["map"].positional == (f"{tmp_path / 'my map.geojson'},{tmp_path / 'b.gpkg'}",)
    (played,) = nodes["bag_player"].parameters
    assert (played["bag"].positional, played["bag"].value_type) == ((str(tmp_path / "7"),), str)
    assert "use_sim_time" not in played
    for node in launched(launch_file, params_file="", use_sim_time="true").values():
        assert node.parameters == [{"use_sim_time": True}]
        assert node.remappings == []  # a simulator's /clock is the whole domain's
    live = launched(launch_file, params_file="", bag="7", use_sim_time="False")
    assert live["ekf_node"].parameters == [{"use_sim_time": False}]


def ended(node, code, *, shuts_down=False):
    return node.on_exit(SimpleNamespace(returncode=code), SimpleNamespace(is_shutdown=shuts_down))


def test_launch_ends_with_the_bag_and_in_error_with_any_other_node(launch_file, flight):
    nodes = launched(launch_file, bag=flight)
    (end,) = ended(nodes["bag_player"], 0)
    assert (type(end).__name__, end.reason) == ("Shutdown", "the bag has ended")
    for name, node in nodes.items():
        # Launch has exit code 1 for an exception, and for nothing else.
        with pytest.raises(RuntimeError, match=rf"^{name} has ended \(exit code -9\)"):
            ended(node, -9)
        assert ended(node, -2, shuts_down=True) is None
    with pytest.raises(RuntimeError, match="overlay_node has ended"):
        ended(nodes["overlay_node"], 0)
    assert {node.on_exit for node in launched(launch_file).values()} == {None}


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("bagg", "x", "did you mean bag:="),
        ("param_file", "x", "did you mean params_file:="),
        ("sim_time", "x", "did you mean use_sim_time:="),
        ("page", "8080", ".*write true or false"),
        ("page", "a:b", ".*HOST:PORT"),
        ("dji", "maybe", "write true or false"),
    ],
)
def test_launch_refuses_a_name_or_a_value_that_resembles_its_own(launch_file, name, value, reason):
    with pytest.raises(ValueError, match=f"^argument {name}:={value}: {reason}"):
        launched(launch_file, {name: value})
    # The arguments of a file that includes it pass; it may pass its own on, under our name.
    names = "image_topic use_rviz map_file bag_path camera_info_url use_namespace robot_namespace "
    names += "use_respawn rviz_config frame_rate serial_port dem robot autostart ros_params slam"
    assert launched(launch_file, dict.fromkeys(names.split(), "x"))
    assert launched(launch_file, {"sim_time": "true"}, use_sim_time="true")


@pytest.mark.parametrize("name", ["params_file", "map", "bag", "remap"])
def test_launch_refuses_a_file_that_is_not_there(launch_file, name, flight, tmp_path):
    for value in ("nowhere", f"{flight},nowhere"):
        with pytest.raises(ValueError, match=rf"^argument {name}:=.*: there is no file /.*/nowhe"):
            launched(launch_file, **{name: value})
    if name in {"params_file", "remap"}:
        with pytest.raises(ValueError, match="there is no file"):
            launched(launch_file, **{name: str(tmp_path)})
    else:
        launched(launch_file, **{name: str(tmp_path)})  # a recorded folder, a File Geodatabase


def test_launch_takes_params_for_params_file(launch_file, flight, tmp_path):
    with pytest.raises(ValueError, match=r"^argument params:=/nope.yaml: there is no file"):
        launched(launch_file, params="/nope.yaml")
    with pytest.raises(ValueError, match=r"^arguments params:=.* params_file:=.*: give one"):
        launched(launch_file, params=flight, params_file="other.yaml")
    for also in ({}, {"params_file": flight}):
        nodes = launched(launch_file, params=flight, **also)
        assert {tuple(node.parameters) for node in nodes.values()} == {(flight,)}


def test_every_argument_is_described_and_has_a_default(launch_file):
    (*declared, _) = launch_file["generate_launch_description"]().positional[0]
    for item in declared:
        assert type(item).__name__ == "DeclareLaunchArgument"
        assert isinstance(item.default_value, str)
        assert len(item.description) > 10
        assert item.choices is None or item.default_value in item.choices
    contract = "params_file map bag namespace dji use_sim_time log_level respawn rviz page"
    assert set(contract.split()) <= {item.positional[0] for item in declared}


def test_launch_takes_the_camera_by_its_own_name(launch_file):
    topics = ("image_raw", "image_raw/compressed", "camera_info")
    at_flir = [(f"thermal/{name}", f"/flir/{name}") for name in topics]
    for image in ("/flir/image_raw", "/flir/image_raw/compressed"):
        nodes = launched(launch_file, image=image)
        assert nodes["overlay_node"].remappings == at_flir
        assert nodes["ekf_node"].remappings == []
    other = launched(launch_file, image="video", camera_info="info")["overlay_node"]
    assert dict(other.remappings)["thermal/camera_info"] == "info"
    beside = launched(launch_file, image="video")["overlay_node"]
    assert dict(beside.remappings)["thermal/camera_info"] == "camera_info"


def test_launch_gives_every_node_the_inputs_other_names(launch_file, flight, tmp_path):
    mavros = str(PROJECT / "config" / "mavros.yaml")
    renamed = [
        ("imu/data", "mavros/imu/data"),
        ("gps/fix", "mavros/global_position/raw/fix"),
        ("baro/pressure", "mavros/imu/static_pressure"),
    ]
    nodes = launched(launch_file, remap=mavros, dji="false", image="video")
    assert nodes["ekf_node"].remappings == renamed
    # Of several rules for a topic, ROS takes the first.
    assert nodes["overlay_node"].remappings[-3:] == renamed
    assert nodes["overlay_node"].remappings[0] == ("thermal/image_raw", "video")
    on_bag = launched(launch_file, remap=mavros, bag=flight)
    assert on_bag["bag_player"].remappings == [("/clock", "clock"), *renamed]
    path = tmp_path / "remap.yaml"
    path.write_text("imu: mavros/imu/data\n")
    with pytest.raises(ValueError, match=r"^argument remap:=.*remap.yaml: imu: not an input of t"):
        launched(launch_file, remap=str(path))


def test_launch_prefixes_the_frames_and_sets_the_level_of_our_loggers(launch_file):
    options = {"params_file": "", "frames": "uav1/", "namespace": "/a/b/", "log_level": "debug"}
    for name, node in launched(launch_file, **options).items():
        (values,) = node.parameters
        assert plain(values["frame_prefix"]) == "uav1/"
        assert node.ros_arguments[-2:] == ["--log-level", f"a.b.{name}:=debug"]
    graph, declared = launch_file["graph"], launch_file["ARGUMENTS"]
    context = {name: default for name, (default, _) in declared.items()}
    context |= {"ros_namespace": "/fleet", "namespace": "uav1"}
    pushed = graph(SimpleNamespace(launch_configurations=context))
    (ekf_node,) = (each for each in pushed if getattr(each, "name", "") == "ekf_node")
    assert ekf_node.ros_arguments[-1] == "fleet.uav1.ekf_node:=info"


def test_launch_starts_live_nodes_again_and_with_a_bag_the_page_alone(launch_file, flight):
    for options, respawns in (({}, True), ({"respawn": "false"}, False)):
        nodes = launched(launch_file, page="true", **options)
        result = {(node.respawn, node.respawn_delay, node.on_exit) for node in nodes.values()}
        assert result == {(respawns, 2.0, None)}
        on_bag = launched(launch_file, bag=flight, page="true", **options)
        assert on_bag["viewer_node"].on_exit is None
        assert on_bag.pop("viewer_node").respawn is respawns
        assert {node.respawn for node in on_bag.values()} == {False}
    with pytest.raises(ValueError, match="argument respawn:=true: not with bag:="):
        launched(launch_file, respawn="true", bag=flight)


def test_launch_shows_rviz_in_the_namespace_and_the_frames(launch_file, flight, monkeypatch):
    with pytest.raises(RuntimeError, match="sudo apt install ros-jazzy-rviz2"):
        launched(launch_file, rviz="true")
    monkeypatch.setitem(launch_file["rviz"].__globals__, "get_package_prefix", lambda _: "/opt")
    options = {"rviz": "true", "namespace": "uav1", "frames": "uav1/", "bag": flight}
    actions = actions_of(launch_file, **options)
    (shown,) = (each for each in actions if getattr(each, "executable", "") == "rviz2")
    assert shown.arguments == ["-d", str(PROJECT / "config" / "tirgeo.rviz"), "-f", "uav1/map"]
    assert (shown.package, shown.namespace) == ("rviz2", "uav1")
    assert shown.parameters == [{"use_sim_time": True}]
    assert shown.remappings == [("/clock", "clock")]
    assert not hasattr(shown, "on_exit")  # closing the window does not end the flight


@pytest.mark.parametrize("page", ["true", "0.0.0.0:8081"])
def test_launch_serves_the_page_where_it_is_told_to(launch_file, page, tmp_path):
    (tmp_path / "park.geojson").touch()
    options = {"params_file": "", "map": str(tmp_path / "park.geojson"), "frames": "uav1/"}
    nodes = launched(launch_file, page=page, **options)
    assert set(nodes) == NODES - {"bag_player"}
    (values,) = nodes["viewer_node"].parameters
    assert values["map"].positional == (str(tmp_path / "park.geojson"),)
    listens = [values["listen"].positional] if "listen" in values else []
    assert listens == ([] if page == "true" else [("0.0.0.0:8081",)])


@pytest.mark.parametrize("options", [{"page": "true"}, {"bag": str(PROJECT)}])
def test_each_node_has_the_enclave_of_the_policy(launch_file, options):
    policy = ET.parse(PROJECT / "config" / "sros2_policy.xml").getroot()
    enclaves = {item.get("path") for item in policy.iter("enclave")}
    for name, node in launched(launch_file, **options).items():
        assert node.ros_arguments[:2] == ["--enclave", f"/tirgeo/{name}"]
        assert node.ros_arguments[1] in enclaves


def test_launch_on_a_bag_is_for_this_machine_alone(launch_file, monkeypatch, flight):
    monkeypatch.setenv("ROS_STATIC_PEERS", "192.0.2.7")
    assert environment_of(launch_file, bag=flight) == {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        "ROS_STATIC_PEERS": None,
        PROFILE: str(PROJECT / "config" / "fastdds_localhost.xml"),
        "SKIP_DEFAULT_XML_FILE": "1",
    }


@pytest.mark.parametrize("options", [{"bag": str(PROJECT), "localhost_only": "false"}, {}])
def test_launch_leaves_the_reach_to_the_user(launch_file, monkeypatch, options):
    """Where the launch file is told to, and on an aircraft, whose ground station looks on."""
    monkeypatch.setenv("ROS_STATIC_PEERS", "192.0.2.7")
    expected = {PROFILE: str(PROJECT / "config" / "fastdds.xml")}
    assert environment_of(launch_file, **options) == expected
    assert (PROJECT / "config" / "fastdds.xml").is_file()
    monkeypatch.setenv(PROFILE, "/home/user/own.xml")
    assert environment_of(launch_file, **options) == {}
