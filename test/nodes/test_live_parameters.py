# ruff: noqa: E402 what follows imports ROS, which may be absent
"""Parameters over DDS, as the command line tools ask for them: dumped, loaded, set in flight."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest
import yaml

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import await_words
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

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import config_from, parameters_of
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.nodes.parameters import declare

pytestmark = pytest.mark.graph
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
    told = stranger.ask(f"/{node}/describe_parameters", DescribeParameters, names=names)
    assert len(names) == len(values) == len(told.descriptors)
    own = {parameter.name: parameter for parameter in parameters_of(NODE_CONFIGS[node])}
    assert own.keys() <= set(names)
    for name, value, descriptor in zip(names, values, told.descriptors, strict=True):
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


def arguments(node: str, bag, folder) -> tuple[str, ...]:
    """What keeps a node running that has nothing to do."""
    given = {
        "bag_player": {"bag": bag, "wait_timeout_s": 600.0, "wait_for": "imu/data"},
        "recorder": {"output": folder / "out.mcap", "topics": "imu/data"},
        "video_writer": {"output": folder / "out.ts"},
        "viewer_node": {"listen": "127.0.0.1:0", "targets": folder / "targets.gpkg"},
        "dji_node": {"port": folder / "no_port"},
    }
    pairs = given.get(node, {}).items()
    return tuple(word for name, value in pairs for word in ("-p", f"{name}:={value}"))


@pytest.mark.parametrize("node", NODE_CONFIGS)
def test_what_param_dump_writes_loads_again(spawn, meet, flight_bag, tmp_path, node):
    """Every parameter has a value of its type, the empty lists too, and rcl reads the file."""
    process = spawn(node, *arguments(node, flight_bag, tmp_path))
    await_words(process, "ready")
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


def test_parameters_are_set_in_flight_or_refused_with_the_reason(spawn, meet):
    process = spawn("ekf_node")
    await_words(process, "ready")
    stranger = meet()

    def put(**values: Any) -> tuple[bool, str]:
        given = [Parameter(n.replace("__", "."), *value_of(v)) for n, v in values.items()]
        result = stranger.ask(
            "/ekf_node/set_parameters_atomically",
            SetParametersAtomically,
            parameters=[one.to_parameter_msg() for one in given],
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
        ({"method": "ekf"}, "method is read at start alone: .* restart the node"),
        (
            {"aircraft__rtk_antenna_m": [0.0, 1.0, 0.0]},
            "measured before flight.* restart them all",
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
    told = [line for line in process.text().splitlines() if "set in flight" in line]
    assert [line.partition("flight: ")[2] for line in told] == [
        "rtk.position_sigma_floor_m: 0.01 -> 0.05",
        "rtk.gate_sigma: 5.0 -> 6.0",
    ]
