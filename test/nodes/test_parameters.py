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

# ruff: noqa: E402 what follows imports ROS, which may be absent
"""Parameters: declared, read from files, dumped, set in flight; secrets that nobody reads back."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

import yaml
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParametersAtomically,
)
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock

from tirgeo_ros.core.config import (
    NODE_CONFIGS,
    AircraftConfig,
    EkfConfig,
    OverlayConfig,
    ViewerConfig,
)
from tirgeo_ros.core.config.schema import config_from, parameters_of
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.parameters.parameter_file import ParameterFile, overridden_topic
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.parameters import (
    check_arguments,
    declare,
    given_names,
    idle_overrides,
    parameter_files,
)
from tirgeo_ros.nodes.viewer_node import with_secrets
from tirgeo_ros.tools.graph.node_graph import parameter_words


@pytest.fixture
def make_node():
    context = Context()
    rclpy.init(context=context, args=[], domain_id=99)
    nodes = []

    def make(called="ekf_node", files=(), kind=Node, **overrides) -> Node:
        given = [Parameter(name.replace("__", "."), value=v) for name, v in overrides.items()]
        line = ["--ros-args", *(word for path in files for word in ("--params-file", str(path)))]
        nodes.append(
            kind(
                called,
                context=context,
                cli_args=line if files else None,
                parameter_overrides=given,
                enable_rosout=False,
            )
        )
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    context.try_shutdown()


def test_every_parameter_is_declared_with_what_a_person_needs(make_node):
    node = make_node()
    declare(node, EkfConfig)
    for parameter in parameters_of(EkfConfig):
        descriptor = node.describe_parameter(parameter.name)
        assert descriptor.read_only is not parameter.live
        assert parameter.description in descriptor.description
        assert parameter.unit in descriptor.description
    rate = node.describe_parameter("publish_rate_hz").floating_point_range[0]
    assert (rate.from_value, rate.to_value) == (0.1, 1000)
    window = node.describe_parameter("rtk.median_window").integer_range[0]
    assert (window.from_value, window.to_value) == (1, 99)
    assert "ekf_heading" in node.describe_parameter("method").additional_constraints


def test_options_of_a_command_count_over_what_a_file_says_of_the_node(make_node, tmp_path):
    path = tmp_path / "aircraft.yaml"
    path.write_text("/**/overlay_node:\n  ros__parameters: {map: a.kml, style: s.yaml}\n")
    words = parameter_words({"map": "7"}, [path])
    assert parameter_files(words) == [str(path)]
    config = declare(make_node("overlay_node", words[1::2]), OverlayConfig)
    assert (config.map, config.style) == ("7", "s.yaml")


def test_parameters_of_other_nodes_and_of_ros_are_passed_over(make_node):
    overrides = {
        "composition": "paper",  # of gimbal_node
        "use_sim_time": True,
        "start_type_description_service": False,
        "qos_overrides./imu/data.subscription.depth": 5,
    }
    assert declare(make_node(**overrides), EkfConfig) == EkfConfig()


def test_an_override_that_no_topic_has_is_named(make_node):
    """Those of this node's topics, also remapped, and of another node's set something."""
    topics = ("/rig/imu", "/uav2/rtk/fix", "/ekf_node/set_heading", "/imu/dta")
    names = [f"qos_overrides.{topic}.subscription.depth" for topic in topics]
    node = make_node(**dict.fromkeys(names, 5), method="rtk")
    options = QoSOverridingOptions.with_default_policies()
    node.create_subscription(Clock, "/rig/imu", print, 1, qos_overriding_options=options)
    assert idle_overrides(node) == names[-1:]
    policies = [name for name in node._parameters if name.startswith("qos_overrides./rig")]
    assert [overridden_topic(name) for name in policies] == ["/rig/imu"] * 3  # none refused


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"rtk__delay_ms": 80.0}, r"unknown parameter rtk.delay_ms .*rtk.delay_s"),
        ({"lever_arm_m": [0.0, 0.0, 0.0]}, r"lever_arm_m is now aircraft.gimbal_pivot_m"),
        ({"publish_rate_hz": 0.0}, r"publish_rate_hz: 0 Hz is outside 0.1 to 1000"),
        ({"publish_rate_hz": "fast"}, r"publish_rate_hz: 'fast' is not of type double"),
    ],
)
def test_a_wrong_parameter_is_refused_by_name(make_node, overrides, message):
    with pytest.raises(ConfigError, match=message):
        declare(make_node(**overrides), EkfConfig)


def write(folder: Path, text: str) -> str:
    path = folder / "params.yaml"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [", "params.yaml: .*not YAML"),
        ("3", "params.yaml: not a parameter file"),
        ("ekf_node: {ros__parameters: {methd: raw}}", "params.yaml: unknown parameter methd"),
        (
            "/**: {ros__parameters: {aircraft: {rtk_antenna_m: [1, 2.0, 3]}}}",
            "params.yaml: parameter aircraft.rtk_antenna_m: .*decimal point",
        ),
    ],
)
def test_a_wrong_parameter_file_is_named(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message):
        check_arguments("ekf_node", ["--ros-args", "--params-file", write(tmp_path, text)])


AIRCRAFT_FILE = """
/**:
  ros__parameters:
    aircraft:
      imu_m: [0.5, 0.0, 0.0]
      rtk_antenna_m: [0.0, 0.55, 0.35]
      second_antenna_m: []
/**/overlay_node: {ros__parameters: {jpeg_quality: 70}}
"""


@pytest.mark.parametrize("name", NODE_CONFIGS)
def test_the_aircraft_is_set_once_for_all_nodes(make_node, tmp_path, name):
    """As rcl reads it: nodes that need it have it, an empty list too; the others accept it."""
    path = write(tmp_path, AIRCRAFT_FILE)
    check_arguments(name, ["--ros-args", "--params-file", path])
    config = declare(make_node(name, [path]), NODE_CONFIGS[name])
    assert repr(config) == repr(ParameterFile(path).config(name, NODE_CONFIGS[name]))
    places = AircraftConfig(imu_m=(0.5, 0, 0), rtk_antenna_m=(0, 0.55, 0.35))
    needed = name in {"dji_node", "ekf_node", "gimbal_node", "bag_player"}
    assert getattr(config, "aircraft", None) == (places if needed else None)


def test_a_node_by_another_name_is_left_to_rcl(tmp_path):
    path = write(tmp_path, "front: {ros__parameters: {method: rtk}}")
    check_arguments("ekf_node", ["--params-file", path, "-r", "__node:=front"])
    names = ["-r", "__node:=ekf_node", "-r", "__node:=front"]  # rcl takes the first
    wrong = write(tmp_path, "ekf_node: {ros__parameters: {methodd: rtk}}")
    with pytest.raises(ConfigError, match="methodd"):
        check_arguments("bag_player", ["--params-file", wrong, *names])


def test_the_names_that_somebody_set(make_node):
    node = make_node(publish_rate_hz=50, aircraft__rtk_antenna_m=[0.0, 0.0, 0.0], port="/dev/tty")
    assert given_names(node, EkfConfig) == {"publish_rate_hz", "aircraft.rtk_antenna_m"}
    assert given_names(make_node(), EkfConfig) == frozenset()


TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
    tuple: ParameterType.PARAMETER_DOUBLE_ARRAY,
}


def dumped(stranger, node: str) -> dict[str, Any]:
    """All parameters of a node, in one request each, with what was declared checked."""
    names = stranger.ask(f"/{node}/list_parameters", ListParameters).result.names
    values = stranger.ask(f"/{node}/get_parameters", GetParameters, names=names).values
    reports = stranger.ask(f"/{node}/describe_parameters", DescribeParameters, names=names)
    assert len(names) == len(values) == len(reports.descriptors)
    own = {parameter.name: parameter for parameter in parameters_of(NODE_CONFIGS[node])}
    assert own.keys() <= set(names)
    for name, value, descriptor in zip(names, values, reports.descriptors, strict=True):
        assert value.type == descriptor.type != ParameterType.PARAMETER_NOT_SET
        if name in own:
            assert value.type == TYPES[type(own[name].default)]
            assert descriptor.read_only is not own[name].live
    return {n: parameter_value_to_python(v) for n, v in zip(names, values, strict=True)}


def nested(values: dict[str, Any]) -> dict[str, Any]:
    """Dotted names as ``ros2 param dump`` writes them: a group in a group."""
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *groups, last = name.split(".") if "/" not in name else [name]
        inner = tree
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[last] = value
    return tree


@pytest.mark.parametrize("node", NODE_CONFIGS)
@pytest.mark.graph
def test_what_param_dump_writes_loads_again(idle_nodes, meet, tmp_path, node):
    """Every parameter has a value of its type, the empty lists too, and rcl reads the file."""
    idle_nodes[node].check_running()
    values = dumped(meet(), node)
    assert "use_sim_time" in values
    path = tmp_path / "dump.yaml"
    path.write_text(yaml.dump({f"/{node}": {"ros__parameters": nested(values)}}))
    kind = NODE_CONFIGS[node]
    own = {parameter.name for parameter in parameters_of(kind)}
    flown = config_from(kind, {name: value for name, value in values.items() if name in own})
    assert repr(ParameterFile(path).config(node, kind)) == repr(flown)
    context = Context()
    rclpy.init(context=context, args=["--ros-args", "--params-file", str(path)], domain_id=99)
    try:
        loaded = Node(node, context=context, enable_rosout=False)
        assert repr(declare(loaded, kind)) == repr(flown)
        loaded.destroy_node()
    finally:
        context.try_shutdown()


@pytest.mark.graph
def test_parameters_are_set_in_flight_or_refused_with_the_reason(idle_nodes, meet):
    process = idle_nodes["ekf_node"]
    stranger = meet()

    def put(**values: Any) -> tuple[bool, str]:
        given = [Parameter(n.replace("__", "."), *value_of(v)) for n, v in values.items()]
        result = stranger.ask(
            "/ekf_node/set_parameters_atomically",
            SetParametersAtomically,
            parameters=[item.to_parameter_msg() for item in given],
        ).result
        return result.successful, result.reason

    def floor() -> float:
        (value,) = stranger.ask(
            "/ekf_node/get_parameters", GetParameters, names=["rtk.position_sigma_floor_m"]
        ).values
        return value.double_value

    def value_of(value: Any) -> tuple[Parameter.Type, Any]:
        # ``ros2 param set`` takes a list without numbers for one of truth values.
        kind = Parameter.Type.BOOL_ARRAY if value == [] else None
        return (kind or Parameter.Type.from_parameter_value(value)), value

    assert put(rtk__position_sigma_floor_m=0.05) == (True, "")
    assert put(rtk__gate_sigma=6, use_sim_time=False) == (True, "")  # a whole number for a double
    # As it is: a dump is loaded again, with what was read at start.
    assert put(method="ekf_heading", aircraft__second_antenna_m=[]) == (True, "")
    for values, reason in (
        ({"method": "ekf"}, "method is read only at start: .* restart the node"),
        (
            {"aircraft__rtk_antenna_m": [0.0, 1.0, 0.0]},
            "measured before flight.* restart all nodes",
        ),
        ({"rtk__gate_sigma": 0.5}, "rtk.gate_sigma: 0.5 is outside 1 to 1e"),
        ({"rtk__gate_sgma": 5.0}, "unknown parameter rtk.gate_sgma .did you mean rtk.gate_sigma"),
        ({"gps__position_sigma_m": [1.0, 2.0]}, "gps.position_sigma_m: needs 3 numbers, has 2"),
        ({"rtk__position_sigma_floor_m": math.nan}, "nan m is outside"),
        ({"rtk__position_sigma_floor_m": 0.2, "rtk__gate_sigma": "5"}, "not of type double"),
        ({"rtk__position_sigma_floor_m": 0.2, "use_sim_time": 3}, "Wrong parameter type"),
    ):
        done, why = put(**values)
        assert not done
        assert re.search(reason, why), why
    assert floor() == 0.05  # a refused group has changed nothing
    reports = [line for line in process.text().splitlines() if "set in flight" in line]
    assert [line.partition("flight: ")[2] for line in reports] == [
        "rtk.position_sigma_floor_m: 0.01 -> 0.05",
        "rtk.gate_sigma: 5.0 -> 6.0",
    ]


SECRETS = {
    "token": "an-operators-secret",
    "viewer_token": "a-viewers-secret",
    "cot_password": "a key's secret",
}


@pytest.fixture
def node(make_node):
    return make_node("viewer_node", kind=GraphNode, **SECRETS)


def test_a_secret_is_used_and_read_back_as_stars(node):
    config = node.configured(ViewerConfig)
    assert {name: getattr(config, name) for name in SECRETS} == SECRETS
    assert [item.value for item in node.get_parameters([*SECRETS])] == ["***"] * 3


def test_the_stars_of_a_dump_leave_a_secret_unchanged(node):
    node.configured(ViewerConfig)
    stars = [Parameter(name, value="***") for name in SECRETS]
    assert node.set_parameters_atomically(stars).successful
    assert node.set_parameters_atomically([Parameter("token", value=SECRETS["token"])]).successful
    refused = node.set_parameters_atomically([Parameter("token", value="another-secret")])
    assert "token is read only at start" in refused.reason
    assert [item.value for item in node.get_parameters([*SECRETS])] == ["***"] * 3


@pytest.mark.parametrize("name", [*SECRETS])
def test_a_secret_comes_from_a_file(name, tmp_path):
    file = tmp_path / "secret"
    file.write_text(f"{SECRETS[name]}\n")
    config = with_secrets(replace(ViewerConfig(), **{f"{name}_file": str(file)}))
    assert getattr(config, name) == SECRETS[name]
    both = replace(config, **{name: SECRETS[name]})
    with pytest.raises(ConfigError, match=f"^parameter {name}_file: {name} is set too"):
        with_secrets(both)


@pytest.mark.parametrize("held", [None, b"", b"\n", b"two\nlines\n", b"\xff\xfe"])
def test_a_file_without_a_secret_is_named(held, tmp_path):
    file = tmp_path / "secret"
    if held is not None:
        file.write_bytes(held)
    for name in SECRETS:
        with pytest.raises(ConfigError, match=re.escape(str(file))):
            with_secrets(replace(ViewerConfig(), **{f"{name}_file": str(file)}))


def test_a_wrong_token_in_a_file_is_refused_and_not_shown(tmp_path):
    file = tmp_path / "secret"
    file.write_text("too short")
    with pytest.raises(ConfigError, match=r"^parameter token: \*\*\* is no token"):
        with_secrets(replace(ViewerConfig(), token_file=str(file)))
