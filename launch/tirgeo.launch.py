"""The node graph, live or on a bag.

``ros2 launch tirgeo tirgeo.launch.py map:=park.geojson`` on an aircraft, with dji_node unless
``dji:=false`` says that other drivers give its topics;
``ros2 launch tirgeo tirgeo.launch.py map:=park.geojson bag:=flight.mcap`` plays a flight in sim
time and ends when it ends; only this machine reaches that graph (docs/security.md).
"""

from __future__ import annotations

import os
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.action import Action
from launch.actions import (
    DeclareLaunchArgument,
    OpaqueFunction,
    SetEnvironmentVariable,
    Shutdown,
    UnsetEnvironmentVariable,
)
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from tirgeo_ros.tools.graph.localhost import localhost_environment, video_environment

SHARE = Path(__file__).resolve().parents[1]  # share/tirgeo when installed, else the source tree
ARGUMENTS = {
    "params_file": (str(SHARE / "config" / "m600_xt2.yaml"), "parameters of all nodes (YAML)"),
    "map": ("", "the map to draw; empty = as params_file says"),
    "bag": ("", "MCAP file to play instead of a live aircraft; the graph ends with it"),
    "dji": ("true", "whether dji_node brings the aircraft's topics; never with a bag"),
    "namespace": ("", "namespace of the aircraft, as uav1; empty = none"),
    "localhost_only": ("", "whether only this machine reaches the graph; empty = with a bag"),
}


def generate_launch_description() -> LaunchDescription:
    """What ros2 launch asks for."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=graph)])


def environment(*, local: bool) -> list[Action]:
    """What the nodes' environment has otherwise than ours: DDS for video, and who reaches it."""
    ours = dict(os.environ)
    theirs = (localhost_environment if local else video_environment)(ours, SHARE / "config")
    changed = {name: value for name, value in theirs.items() if ours.get(name) != value}
    gone = [UnsetEnvironmentVariable(name) for name in sorted(ours.keys() - theirs.keys())]
    return [*gone, *(SetEnvironmentVariable(name, value) for name, value in changed.items())]


def graph(context: LaunchContext) -> list[Action]:
    """The nodes in their environment, from the arguments as given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    params = [absolute(given["params_file"])] if given["params_file"] else []
    common = [*params, {"use_sim_time": True}] if given["bag"] else params
    drawn = [*common, *path_parameter("map", given["map"])]
    nodes = [
        node("ekf_node", given["namespace"], common),
        node("gimbal_node", given["namespace"], common),
        node("overlay_node", given["namespace"], drawn),
    ]
    if given["bag"]:
        played = [*params, *path_parameter("bag", given["bag"])]
        end = Shutdown(reason="the bag has ended")
        nodes.append(node("bag_player", given["namespace"], played, on_exit=end))
    elif is_true("dji", given["dji"]):
        nodes.append(node("dji_node", given["namespace"], common))
    local = is_true("localhost_only", given["localhost_only"] or str(bool(given["bag"])))
    return [*environment(local=local), *nodes]


def is_true(name: str, value: str) -> bool:
    """A launch argument that is true or false, in any case, or 1 or 0."""
    known = {"true": True, "1": True, "false": False, "0": False}
    if value.lower() not in known:
        raise ValueError(f"argument {name}:={value}: say true or false")
    return known[value.lower()]


def node(name: str, namespace: str, parameters: list[object], **more: object) -> Node:
    """One of the package's executables under its own name."""
    return Node(
        package="tirgeo",
        executable=name,
        name=name,
        namespace=namespace,
        parameters=parameters,
        output="screen",
        ros_arguments=["--enclave", f"/tirgeo/{name}"],  # whose keys it has, under SROS 2
        **more,
    )


def path_parameter(name: str, path: str) -> list[dict[str, ParameterValue]]:
    """A parameter that is a path; none where it is empty, so that params_file decides."""
    # The type is told, for a bare text is read as YAML: a bag named 7 would become a number.
    return [{name: ParameterValue(absolute(path), value_type=str)}] if path else []


def absolute(path: str) -> str:
    """The path as seen from where ros2 launch was called."""
    return str(Path(path).expanduser().absolute())
