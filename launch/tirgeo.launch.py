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
"""Start the node graph, live or on a bag.

``ros2 launch tirgeo tirgeo.launch.py map:=park.geojson`` on an aircraft, with dji_node unless
``dji:=false`` says that other drivers publish its topics;
``ros2 launch tirgeo tirgeo.launch.py map:=park.geojson bag:=flight.mcap`` plays a flight in sim
time, and ends with it, or with exit code 1 when a node other than viewer_node dies. Only this
machine reaches that graph (docs/security.md). ``--show-args`` lists all arguments.
"""

from __future__ import annotations

import contextlib
import difflib
import os
import secrets
from pathlib import Path, PurePosixPath

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.action import Action
from launch.actions import (
    DeclareLaunchArgument,
    OpaqueFunction,
    SetEnvironmentVariable,
    Shutdown,
    UnsetEnvironmentVariable,
)
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.core.config.viewer_parameters import TOKEN_SEED, address_of
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.files.whole_files import named_files
from tirgeo_ros.tools.graph.node_graph import localhost_environment, video_environment
from tirgeo_ros.tools.graph.whole_graph import read_remaps
from tirgeo_ros.tools.replay.node_configs import values_without_rates

SHARE = Path(__file__).resolve().parents[1]  # share/tirgeo when installed, else the source tree
RVIZ = SHARE / "config" / "tirgeo.rviz"
IMAGE, CAMERA_INFO = "thermal/image_raw", "thermal/camera_info"
RESPAWN_DELAY_S = 2.0
RESEMBLES = 0.75  # difflib's ratio: bagg and bag have 0.86, dem and map 0.33
LEVELS = ("debug", "info", "warn", "error", "fatal")
ARGUMENTS = {
    "params_file": (
        str(SHARE / "config" / "m600_xt2.yaml"),
        "parameters of all nodes (YAML), or several files with commas: later ones override",
    ),
    "params": ("", "the same as params_file"),
    "map": ("", "the map to draw, or several with commas; empty = as params_file says"),
    "bag": ("", "recorded flight to play instead of a live aircraft; the graph ends with it"),
    "dji": ("true", "whether dji_node publishes the aircraft's topics; never with a bag"),
    "namespace": ("", "namespace of the aircraft, as uav1; empty = none"),
    "frames": ("", "prefix of all frames, as uav1/ (frame_prefix); empty = as params_file says"),
    "image": ("", f"topic in place of {IMAGE}, as /flir/image_raw; its /compressed too"),
    "camera_info": ("", f"topic in place of {CAMERA_INFO}; empty = camera_info beside the image"),
    "remap": ("", "file that gives inputs other topic names, as config/mavros.yaml; empty = none"),
    "use_sim_time": (
        "",
        "whether /clock is the nodes' time; empty = with a bag, else as params_file says",
    ),
    "localhost_only": ("", "whether only this machine reaches the graph; empty = with a bag"),
    "log_level": ("info", "least severity that the nodes log"),
    "respawn": (
        "",
        f"whether a node that ends is started again after {RESPAWN_DELAY_S:g} s; empty = live",
    ),
    "page": (
        "false",
        "whether viewer_node serves the operator's page; or its address, as 0.0.0.0:8080",
    ),
    "rviz": ("false", "whether rviz2 shows picture, aircraft and located points"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments, and the function that makes the nodes of them."""
    choices = {"log_level": list(LEVELS)}
    declared = [
        DeclareLaunchArgument(
            name, default_value=default, description=description, choices=choices.get(name)
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=graph)])


def graph(context: LaunchContext) -> list[Action]:
    """Return the nodes and their environment; raise ValueError for wrong arguments."""
    arguments = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    check_names(context, arguments)
    check(arguments)
    arguments["params_file"] = arguments["params"] or arguments["params_file"]
    fitting = without_rates(arguments)
    on_bag = bool(arguments["bag"])
    local = is_true("localhost_only", arguments["localhost_only"] or str(on_bag))
    source = ["bag_player"] if on_bag else ["dji_node"] * is_true("dji", arguments["dji"])
    page = ["viewer_node"] * (page_address(arguments) is not None)
    names = ["ekf_node", "gimbal_node", "overlay_node", *page, *source]
    nodes = [node(context, name, arguments, fitting) for name in names]
    # Each new start of the page has the tokens of its first one.
    seeded = not page or TOKEN_SEED in os.environ
    seed = [] if seeded else [SetEnvironmentVariable(TOKEN_SEED, secrets.token_urlsafe())]
    viewer = [rviz(arguments)] if is_true("rviz", arguments["rviz"]) else []
    return [*environment(local=local), *seed, *nodes, *viewer]


def check_names(context: LaunchContext, arguments: dict[str, str]) -> None:
    """Raise ValueError for an unknown argument whose name resembles that of a known one.

    The context also holds the arguments of a launch file that includes this one. Those pass if
    they add words to a name (use_rviz), or if the argument that they resemble is set as well.
    """
    for name in sorted(context.launch_configurations.keys() - ARGUMENTS.keys()):
        for near in difflib.get_close_matches(name, ARGUMENTS, 1, RESEMBLES):
            more_words = set(near.split("_")) <= set(name.split("_"))
            if not more_words and arguments[near] == ARGUMENTS[near][0]:
                value = context.launch_configurations[name]
                raise ValueError(f"argument {name}:={value}: did you mean {near}:=?")


def check(arguments: dict[str, str]) -> None:
    """Raise ValueError for a file that is not there, before any node is started without it."""
    params, file = arguments["params"], arguments["params_file"]
    if params and file not in (params, ARGUMENTS["params_file"][0], ""):
        raise ValueError(f"arguments params:={params} params_file:={file}: give one of them")
    for name in ("params", "params_file", "map", "bag", "remap"):
        for path in map(Path, paths(arguments[name])):
            # A recorded flight may be a folder, and so may a map (File Geodatabase).
            if not (path.is_file() or (name in {"map", "bag"} and path.is_dir())):
                raise ValueError(f"argument {name}:={arguments[name]}: there is no file {path}")
    if arguments["bag"] and is_true("respawn", arguments["respawn"] or "false"):
        raise ValueError("argument respawn:=true: not with bag:=, which ends when a node dies")


def without_rates(arguments: dict[str, str]) -> dict[str, object]:
    """Return the parameters for a bag whose imu/data has attitudes alone; {} for any other.

    The default parameters, an M600's, are then left out: the bag is of another aircraft.
    """
    is_default = arguments["params_file"] == ARGUMENTS["params_file"][0]
    files = [] if is_default else paths(arguments["params_file"])
    bags, fitting = paths(arguments["bag"])[:1], {}
    with contextlib.suppress(ConfigError):  # the nodes say what is wrong with a parameter
        for bag in bags:
            fitting = values_without_rates(bag, files, arguments["namespace"])
    if fitting and is_default:
        arguments["params_file"] = ""
    return fitting


def node(
    context: LaunchContext, name: str, arguments: dict[str, str], fitting: dict[str, object]
) -> Node:
    """Return the action that runs one of the package's executables under its own name."""
    ends = end_of(name) if arguments["bag"] and name != "viewer_node" else None
    respawn = is_true("respawn", arguments["respawn"] or str(ends is None))
    level = f"{logger_name(context, arguments['namespace'], name)}:={arguments['log_level']}"
    return Node(
        package="tirgeo",
        executable=name,
        name=name,
        namespace=arguments["namespace"],
        parameters=parameters(name, arguments, fitting),
        remappings=remappings(name, arguments),
        output="screen",
        # The enclave names the node's keys under SROS 2.
        ros_arguments=["--enclave", f"/tirgeo/{name}", "--log-level", level],
        respawn=respawn,
        respawn_delay=RESPAWN_DELAY_S,
        on_exit=ends,
    )


def parameters(name: str, arguments: dict[str, str], fitting: dict[str, object]) -> list[object]:
    """Return the parameter files, and the values of arguments and bag that override them."""
    has = {parameter.name for parameter in parameters_of(NODE_CONFIGS[name])}
    texts = {
        "bag": ",".join(paths(arguments["bag"])),
        "map": ",".join(paths(arguments["map"])),
        "listen": page_address(arguments) or "",
        "frame_prefix": arguments["frames"],
    }
    values = {} if name == "bag_player" else sim_time(arguments)
    values |= {key: value for key, value in fitting.items() if key in has}
    for key, value in texts.items():
        values |= text(key, value) if key in has else {}
    return [*paths(arguments["params_file"]), *([values] if values else [])]


def text(name: str, value: str) -> dict[str, object]:
    """Return a text parameter; none for an empty text, so that params_file decides."""
    # The type is set because a text is read as YAML: a bag named 7 would become a number.
    return {name: ParameterValue(value, value_type=str)} if value else {}


def sim_time(arguments: dict[str, str]) -> dict[str, object]:
    """Return the parameter use_sim_time; none if params_file decides."""
    value = arguments["use_sim_time"] or ("true" if arguments["bag"] else "")
    return {"use_sim_time": is_true("use_sim_time", value)} if value else {}


def remappings(name: str, arguments: dict[str, str]) -> list[tuple[str, str]]:
    """Return the remapping rules of a node: (own name, other name). The first for a topic holds.

    A bag's clock is in the namespace, like the bag's topics: two bags have two clocks.
    """
    rules = [("/clock", "clock")] if arguments["bag"] else []
    if name != "overlay_node":
        return rules + renamed(arguments)
    image = arguments["image"].removesuffix("/compressed")
    beside = str(PurePosixPath(image).with_name("camera_info")) if image else ""
    if image:
        rules += [(IMAGE, image), (f"{IMAGE}/compressed", f"{image}/compressed")]
    info = arguments["camera_info"] or beside
    return [*rules, *([(CAMERA_INFO, info)] if info else []), *renamed(arguments)]


def renamed(arguments: dict[str, str]) -> list[tuple[str, str]]:
    """Return the rules in the files of the argument remap; raise ValueError."""
    try:
        return [pair for path in paths(arguments["remap"]) for pair in read_remaps(path)]
    except ConfigError as error:
        raise ValueError(f"argument remap:={arguments['remap']}: {error}") from None


def end_of(name: str) -> object:
    """Return the handler that ends the launch with a node: an error unless the bag has ended."""

    def ended(event: ProcessExited, context: LaunchContext) -> list[Action] | None:
        if context.is_shutdown:
            return None
        if name == "bag_player" and event.returncode == 0:
            return [Shutdown(reason="the bag has ended")]
        # Launch itself ends with exit code 1 for an exception only.
        why = f"{name} has ended (exit code {event.returncode}); its last line above says why"
        raise RuntimeError(why)

    return ended


def rviz(arguments: dict[str, str]) -> Node:
    """Return RViz in the graph's namespace, time and frames; raise RuntimeError if absent."""
    try:
        get_package_prefix("rviz2")
    except PackageNotFoundError:
        raise RuntimeError(
            "argument rviz:=true: rviz2 is not installed: sudo apt install ros-jazzy-rviz2"
        ) from None
    return Node(
        package="rviz2",
        executable="rviz2",
        namespace=arguments["namespace"],
        arguments=["-d", str(RVIZ), "-f", f"{arguments['frames']}map"],
        parameters=[sim_time(arguments)] if sim_time(arguments) else [],
        remappings=remappings("rviz2", arguments),
        output="screen",
        ros_arguments=["--enclave", "/tirgeo/operator"],
    )


def environment(*, local: bool) -> list[Action]:
    """Return the changes of the environment for the nodes: DDS, and who reaches it."""
    own = dict(os.environ)
    new = (localhost_environment if local else video_environment)(own, SHARE / "config")
    changed = {name: value for name, value in new.items() if own.get(name) != value}
    unset = [UnsetEnvironmentVariable(name) for name in sorted(own.keys() - new.keys())]
    return [*unset, *(SetEnvironmentVariable(name, value) for name, value in changed.items())]


def page_address(arguments: dict[str, str]) -> str | None:
    """Return the page's address, empty if params_file decides; None without a page."""
    page = arguments["page"]
    if ":" in page:
        try:
            address_of(page)
        except ConfigError as error:
            raise ValueError(f"argument page:={page}: {error}") from None
        return page
    return "" if is_true("page", page) else None


def is_true(name: str, value: str) -> bool:
    """Return an argument as a bool: true or false in any case, or 1 or 0."""
    values = {"true": True, "1": True, "false": False, "0": False}
    if value.lower() not in values:
        raise ValueError(f"argument {name}:={value}: write true or false")
    return values[value.lower()]


def logger_name(context: LaunchContext, namespace: str, name: str) -> str:
    """Return the name of a node's logger: its level leaves ROS's libraries quiet at debug."""
    pushed = LaunchConfiguration("ros_namespace", default="").perform(context)
    whole = namespace if namespace.startswith("/") else f"{pushed}/{namespace}"
    return ".".join(part for part in [*whole.split("/"), name] if part)


def paths(files: str) -> list[str]:
    """Return the absolute paths of an argument's files, from the folder of ros2 launch."""
    return [str(Path(path).expanduser().absolute()) for path in named_files(files)]
