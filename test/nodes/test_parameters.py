# ruff: noqa: E402 what follows imports ROS, which may be absent
"""Parameters of nodes: declared with description and range, refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock

from tirgeo_ros.core.config import NODE_CONFIGS, AircraftConfig, EkfConfig, OverlayConfig
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.parameters.parameter_file import ParameterFile, overridden_topic
from tirgeo_ros.nodes.parameters import (
    check_arguments,
    declare,
    given_names,
    idle_overrides,
    parameter_files,
)
from tirgeo_ros.tools.graph.node_graph import parameter_words


@pytest.fixture
def make_node():
    context = Context()
    rclpy.init(context=context, args=[], domain_id=99)
    nodes = []

    def make(called="ekf_node", files=(), **overrides) -> Node:
        given = [Parameter(name.replace("__", "."), value=v) for name, v in overrides.items()]
        line = ["--ros-args", *(word for path in files for word in ("--params-file", str(path)))]
        nodes.append(
            Node(
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
def test_what_is_wrong_is_refused_by_name(make_node, overrides, message):
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
def test_the_aircraft_is_said_once_for_all_nodes(make_node, tmp_path, name):
    """By rcl's own reading: who needs it has it, an empty list too; nobody trips over it."""
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
