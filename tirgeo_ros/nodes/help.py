"""Print ``NODE --help`` without ROS: what a node does, its topics, its parameters, their use."""

from __future__ import annotations

import ast
import math
import textwrap
from collections.abc import Mapping, Sequence
from importlib.resources import files

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import Parameter, Value, parameters_of
from tirgeo_ros.io.messages import DJI_TOPICS, NAVIGATION_INPUTS, SENSED_TOPICS, TOPIC_TYPES

_NONE = _UNSET, _EMPTY = "unset", "empty"
_PICTURES = ("thermal/image_raw", "thermal/image_raw/compressed", "thermal/camera_info")

#: Topics of the contract by node: inputs, then outputs.
TOPICS: Mapping[str, tuple[Sequence[str], Sequence[str]]] = {
    "dji_node": ((), (*DJI_TOPICS, "/diagnostics")),
    "ekf_node": (
        [topic for topic, _ in NAVIGATION_INPUTS.values()],
        (
            *("tirgeo/odometry", "tirgeo/fix", "tirgeo/origin", "tirgeo/path"),
            *("/tf", "/tf_static", "/diagnostics"),
        ),
    ),
    "gimbal_node": (
        ("tirgeo/odometry", "gimbal/joint_states", "gimbal/attitude", "imu/data"),
        ("tirgeo/camera_pose", "/tf", "/diagnostics"),
    ),
    "overlay_node": (
        (
            *(*_PICTURES, "tirgeo/camera_pose", "tirgeo/origin", "/diagnostics"),
            *("tirgeo/locate/pixel", "tirgeo/targets"),
        ),
        (
            *("tirgeo/overlay/image", "tirgeo/overlay/image/compressed"),
            *("tirgeo/overlay/camera_info", "tirgeo/footprint"),
            *("tirgeo/locate/fix", "tirgeo/locate/point", "tirgeo/locate/answer"),
            "/diagnostics",
        ),
    ),
    "viewer_node": (
        (
            *("tirgeo/overlay/image/compressed", "tirgeo/overlay/camera_info"),
            *("tirgeo/odometry", "tirgeo/origin", "tirgeo/camera_pose", "tirgeo/footprint"),
            *("tirgeo/path", "tirgeo/locate/answer", "/diagnostics"),
        ),
        ("tirgeo/locate/pixel", "tirgeo/targets", "tirgeo/targets/markers", "/diagnostics"),
    ),
    "bag_player": ((), ("/clock", *SENSED_TOPICS, *_PICTURES)),
}


def help_text(name: str, package: str = "tirgeo_ros.nodes") -> str:
    """Return the help of a node in a package."""
    # The docstring of the node's module; reading it needs no ROS.
    source = files(package).joinpath(f"{name}.py").read_text(encoding="utf-8")
    docstring = ast.get_docstring(ast.parse(source)) or ""
    parts = [f"{name}: {docstring}".replace("``", "")]
    for title, topics in zip(("in", "out"), TOPICS.get(name, ()), strict=False):
        lines = [f"  {topic:<34}{TOPIC_TYPES[topic]}" for topic in topics]
        parts += ["\n".join([f"Topics {title}:", *lines])] if lines else []
    if name in NODE_CONFIGS:
        own = parameters_of(NODE_CONFIGS[name])
        parts += ["\n".join(["Parameters, with defaults:", *map(_parameter, own)]), _usage(name)]
    return "\n\n".join(parts) + "\n"


def _parameter(one: Parameter) -> str:
    value = as_yaml(one.default)
    unit = f" {one.unit}" if one.unit and value not in _NONE else ""
    live = "  [in flight]" if one.live else ""
    choices = f" ({', '.join(one.choices)})" if one.choices else ""
    text = textwrap.fill(
        one.description + choices, 99, initial_indent=" " * 6, subsequent_indent=" " * 6
    )
    return f"  {one.name}  {value}{unit}{live}\n{text}"


def as_yaml(value: Value) -> str:
    """Return a default as YAML has it; ``unset`` for nan, ``empty`` for an empty value."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(as_yaml, value))}]" if value else _EMPTY
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return _UNSET if math.isnan(value) else repr(value)
    return str(value) or _EMPTY


def _usage(name: str) -> str:
    own = parameters_of(NODE_CONFIGS[name])
    some = next((one for one in own if as_yaml(one.default) not in _NONE), own[0])
    value = as_yaml(some.default)
    return (
        "How to set them, and to put the topics into a namespace:\n"
        f"  {name} --ros-args -p {some.name}:={value} -r __ns:=/uav1\n"
        f"  {name} --ros-args --params-file aircraft.yaml\n"
        "where aircraft.yaml contains\n"
        f"  /**/{name}:\n    ros__parameters: {{{some.name}: {value}}}"
    )
