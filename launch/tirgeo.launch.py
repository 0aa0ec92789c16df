"""The node graph, live or on a bag.

``ros2 launch tirgeo tirgeo.launch.py map:=park.geojson`` on an aircraft, with dji_node unless
``dji:=false`` says that other drivers give its topics;
``ros2 launch tirgeo tirgeo.launch.py map:=park.geojson bag:=flight.mcap`` plays a flight in sim
time and ends when it ends.
"""

from __future__ import annotations

import os
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

SHARE = Path(__file__).resolve().parents[1]  # share/tirgeo when installed, else the source tree
PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
ARGUMENTS = {
    "params_file": (str(SHARE / "config" / "m600_xt2.yaml"), "parameters of all nodes (YAML)"),
    "map": ("", "the map to draw; empty = as params_file says"),
    "bag": ("", "MCAP file to play instead of a live aircraft; the graph ends with it"),
    "dji": ("true", "whether dji_node brings the aircraft's topics; never with a bag"),
    "namespace": ("", "namespace of the aircraft, as uav1; empty = none"),
}


def generate_launch_description() -> LaunchDescription:
    """What ros2 launch asks for."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, *video_profile(), OpaqueFunction(function=graph)])


def video_profile() -> list[SetEnvironmentVariable]:
    """Shared memory that holds whole frames, unless the user has a profile already."""
    if any(name in os.environ for name in PROFILES):
        return []
    return [SetEnvironmentVariable(PROFILES[0], str(SHARE / "config" / "fastdds.xml"))]


def graph(context: LaunchContext) -> list[Node]:
    """The nodes, from the arguments as given."""
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
    return nodes


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
        **more,
    )


def path_parameter(name: str, path: str) -> list[dict[str, ParameterValue]]:
    """A parameter that is a path; none where it is empty, so that params_file decides."""
    # The type is told, for a bare text is read as YAML: a bag named 7 would become a number.
    return [{name: ParameterValue(absolute(path), value_type=str)}] if path else []


def absolute(path: str) -> str:
    """The path as seen from where ros2 launch was called."""
    return str(Path(path).expanduser().absolute())
