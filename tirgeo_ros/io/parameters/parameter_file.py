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
"""Read and write ROS 2 parameter files (YAML) as rcl does; check them as the nodes do.

A file serves all nodes. Sections are node names, whole or with the wildcards ``*`` (one name) and
``**`` (any number), and may be nested by namespace. Of the sections that match a node the later
ones take precedence.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

import yaml

from tirgeo_ros.core.config import NODE_CONFIGS, RENAMED
from tirgeo_ros.core.config.schema import config_from, parameters_of
from tirgeo_ros.core.types.errors import ConfigError, nearest
from tirgeo_ros.io.files.whole_files import PathLike, read_text

T = TypeVar("T")
#: A file; or several, of which the later take precedence; or none.
Files = PathLike | Sequence[PathLike] | None

_MARK = "ros__parameters"
#: Seven times the longest file of this package; this takes a second or two to read.
_MOST_BYTES = 1 << 17
_EVERY_NODE = ("use_sim_time", "start_type_description_service")
_OVERRIDE = "qos_overrides."
#: The policies of a topic's QoS that rclpy lets a parameter override.
_POLICIES = [
    f"{end}.{policy}"
    for end in ("subscription", "publisher")
    for policy in ("depth", "history", "reliability")
]

_SHOWN = 60  # characters of a refused value that a message shows

Section = tuple[str, dict[str, object]]  # pattern of a node's full name, dotted values
#: A parameter's value: a number (written with nine digits), a word, or numbers.
Value = float | int | bool | str | Sequence[float]


def load_yaml(path: PathLike) -> Any:
    """Load a YAML file, plain values as rcl reads them. Raises ConfigError if it is not YAML."""
    try:
        # The loader is a safe one: it creates plain values only.
        return yaml.load(read_text(path, ConfigError, _MOST_BYTES), _Loader)  # noqa: S506  a safe loader
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or "not readable"
        raise ConfigError(f"{path}: {where}not YAML: {problem}") from None
    except RecursionError:
        raise ConfigError(f"{path}: not YAML: nested too deeply") from None


class ParameterFile:
    """Read and check a parameter file as a whole; without a path all values are defaults.

    Of several files the later take precedence, as when a node is given several. Raises
    ConfigError, naming file and key, for an invalid parameter file, a node that is not tirgeo's,
    an unknown name, a wrong type or a value out of range.
    """

    def __init__(self, files: Files) -> None:
        paths = paths_of(files)
        self._name = ", ".join(str(path) for path in paths)
        self._parts: list[Section] = []
        for path in paths:
            tree = load_yaml(path)
            if not isinstance(tree, Mapping):
                raise ConfigError(
                    f"{path}: not a parameter file: it needs NODE: {_MARK}: NAME: VALUE"
                )
            parts = list(_sections(path, "", tree))
            for pattern, values in parts:
                _check(path, pattern, values)
            self._parts += parts

    def values(self, node: str, namespace: str = "") -> dict[str, object]:
        """Return the dotted values that the file gives a node."""
        full_name = _full_name(node, namespace)
        names = {parameter.name for parameter in parameters_of(NODE_CONFIGS[node])}
        values: dict[str, object] = {}
        for pattern, section in self._parts:
            if _fits(pattern, full_name):
                values |= {k: v for k, v in section.items() if k in names or _of_every_node(k)}
        return values

    def elsewhere(self, namespace: str = "") -> list[str]:
        """Return the sections of other namespaces, for nodes without a section in this one."""
        nodes = [_full_name(node, namespace) for node in NODE_CONFIGS]
        patterns = [pattern for pattern, _ in self._parts]
        here = {pattern for pattern in patterns if any(_fits(pattern, node) for node in nodes)}
        served = {pattern.rpartition("/")[2] for pattern in here}
        return [p for p in patterns if p not in here and p.rpartition("/")[2] not in served]

    def config(self, node: str, kind: type[T], namespace: str = "") -> T:
        """Return a node's configuration. Raises ConfigError if values contradict each other."""
        values = self.values(node, namespace)
        own = {name: value for name, value in values.items() if not _of_every_node(name)}
        return config_from(kind, own, self._name)


def paths_of(files: Files) -> list[PathLike]:
    """Return the files as a list. Raises ConfigError for a value that cannot name a file."""
    if files is None:
        return []
    if isinstance(files, str | os.PathLike) or not isinstance(files, Sequence):
        files = [files]
    for path in files:
        if not isinstance(path, str | os.PathLike):
            why = f"{type(path).__name__} cannot be the name of a file: {path!r}"
            raise ConfigError(f"parameters: {why}")
    return list(files)


def _full_name(node: str, namespace: str) -> str:
    return "/".join(["", *namespace.strip("/").split("/"), node]).replace("//", "/")


def _of_every_node(name: str, where: str = "") -> bool:
    return name in _EVERY_NODE or overridden_topic(name, where) != ""


def overridden_topic(name: str, where: str = "") -> str:
    """Return the topic whose QoS a parameter overrides, or ""; ConfigError if rclpy ignores it."""
    if not name.startswith(_OVERRIDE):
        return ""
    topic = "/" + name.removeprefix(_OVERRIDE).partition(".")[0].lstrip("/")
    names = [f"{_OVERRIDE}{topic}.{policy}" for policy in _POLICIES]
    if name not in names:
        raise ConfigError(f"{where}unknown parameter {name}{nearest(name, names)}")
    return topic


def _check(path: PathLike, pattern: str, values: Mapping[str, object]) -> None:
    """Raise ConfigError for values that no node that matches the pattern accepts."""
    name = pattern.rpartition("/")[2]
    kinds = list(NODE_CONFIGS.values()) if "*" in name else [NODE_CONFIGS[name]]
    names = {parameter.name: kind for kind in kinds for parameter in parameters_of(kind)}
    for key, value in values.items():
        if _of_every_node(key, f"{path}: "):
            continue
        if key in RENAMED and key not in names:
            raise ConfigError(f"{path}: parameter {key} {RENAMED[key]}")
        if key not in names:
            raise ConfigError(f"{path}: unknown parameter {key} of {pattern}{nearest(key, names)}")
        config_from(names[key], {key: value}, str(path))


def _fits(pattern: str, full_name: str) -> bool:
    """Return whether a section's name matches a node, with rcl's wildcards."""
    parts = re.split(r"(/\*\*|/\*)", pattern)
    wild = {"/**": r"(/\w+)*", "/*": r"/\w+"}
    expression = "".join(wild.get(part, re.escape(part)) for part in parts)
    return re.fullmatch(expression, full_name) is not None


def _sections(path: PathLike, above: str, tree: Mapping[Any, Any]) -> Iterator[Section]:
    for key, value in tree.items():
        name = f"{above}/{str(key).strip('/')}"
        if key == _MARK:
            node = above.rpartition("/")[2]
            if "*" not in node and node not in NODE_CONFIGS:
                nodes = ", ".join(NODE_CONFIGS)
                raise ConfigError(f"{path}: unknown node {above or _MARK}; known: {nodes}")
            yield above, dict(_flat(path, "", value))
        elif isinstance(value, Mapping):
            yield from _sections(path, name, value)
        else:
            raise ConfigError(f"{path}: {name.strip('/')} is not under {_MARK}")


def _flat(path: PathLike, above: str, tree: Any) -> Iterator[tuple[str, object]]:
    """Yield nested parameters with their dotted names."""
    if not isinstance(tree, Mapping):
        raise ConfigError(f"{path}: {above or _MARK} holds no parameters")
    for key, value in tree.items():
        name = f"{above}.{key}" if above else str(key)
        if isinstance(value, Mapping):
            yield from _flat(path, name, value)
        else:
            yield name, value


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Load YAML with rcl's plain values: no dates, no sexagesimals, and 1e-4 is a number."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012  as PyYAML has it
    bool_values = {**yaml.SafeLoader.bool_values, "y": True, "n": False}  # noqa: RUF012  as PyYAML has it

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node; refuse, as rcl does, an alias, which may contain itself."""
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.composer.ComposerError(None, None, "aliases are not supported", mark)
        return super().compose_node(parent, index)

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Construct a value; refuse, with its line, what its tag or length does not allow."""
        try:
            value = super().construct_object(node, deep)
            if isinstance(value, str):
                value.encode()
            elif isinstance(value, int) and value.bit_length() > 63:
                value = float(value)  # as in rcl
        except (ValueError, LookupError, AttributeError, TypeError, OverflowError):
            kind = node.tag.rpartition(":")[2]
            text = repr(getattr(node, "value", ""))[:_SHOWN]
            raise yaml.constructor.ConstructorError(
                None, None, f"{text} is not a valid {kind}", node.start_mark
            ) from None
        return value

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Construct a mapping; refuse a repeated key, as the first one would be lost silently."""
        keys = set()
        pairs = node.value if isinstance(node, yaml.MappingNode) else ()
        for key in (key for key, _ in pairs if isinstance(key, yaml.ScalarNode)):
            if key.value in keys:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key.value} appears twice", key.start_mark
                )
            keys.add(key.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


for _tag, _pattern, _first in (
    (
        "bool",
        r"y|Y|n|N|(yes|Yes|YES|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF)",
        "yYnNtTfFoO",
    ),
    ("int", r"[-+]?(0x[0-9a-fA-F]+|0[0-7]*|[1-9]\d*)", "-+0123456789"),
    (
        "float",
        r"[-+]?((\d+\.\d*|\.\d+)([eE][-+]?\d+)?|\d+[eE][-+]?\d+|\.(inf|Inf|INF))|\.(nan|NaN|NAN)",
        "-+0123456789.",
    ),
    ("null", r"~|null|Null|NULL|", ("~", "n", "N", "")),
):
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(f"^({_pattern})$"), list(_first)
    )


def parameters_yaml(nodes: Mapping[str, Mapping[str, Value]], head: str) -> str:
    """Return a ROS 2 parameter file: dotted names by node (empty: all), ``head`` as comment."""
    comment = "".join(f"# {line}".rstrip() + "\n" for line in head.splitlines())
    tree = {
        f"/**/{node}".rstrip("/"): {_MARK: {name: _plain(v) for name, v in values.items()}}
        for node, values in nodes.items()
    }
    body: str = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=95)
    return comment + body


def _plain(value: Value) -> object:
    """Return a value rounded to nine digits: more than any calibration resolves."""
    if isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return float(f"{value:.9g}")
    return [_plain(float(number)) for number in value]
