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
"""Print ``NODE --help``, without ROS: what a node does, and its parameters."""

from __future__ import annotations

import ast
import math
import textwrap
from importlib.resources import files

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import Parameter, Value, parameters_of

NONE = _UNSET, _EMPTY = "unset", "empty"
_USAGE = """\
How to set them, and to put the topics into a namespace:
  {name} --ros-args -p {some}:={value} -r __ns:=/uav1
  {name} --ros-args --params-file aircraft.yaml
where aircraft.yaml contains
  /**/{name}:
    ros__parameters: {{{some}: {value}}}"""


def help_text(name: str, package: str = "tirgeo_ros.nodes") -> str:
    """Return the help of a node in a package."""
    # The docstring of the node's module; reading it needs no ROS.
    source = files(package).joinpath(f"{name}.py").read_text(encoding="utf-8")
    docstring = ast.get_docstring(ast.parse(source)) or ""
    parts = [f"{name}: {docstring}".replace("``", "")]
    if name in NODE_CONFIGS:
        own = parameters_of(NODE_CONFIGS[name])
        parts.append("\n".join(["Parameters, with defaults:", *map(_parameter, own)]))
        parts.append(_USAGE.format(name=name, some=own[0].name, value=as_yaml(own[0].default)))
    return "\n\n".join(parts) + "\n"


def _parameter(parameter: Parameter) -> str:
    value = as_yaml(parameter.default)
    unit = f" {parameter.unit}" if parameter.unit and value not in NONE else ""
    live = "  [in flight]" if parameter.live else ""
    choices = f" ({', '.join(parameter.choices)})" if parameter.choices else ""
    text = textwrap.indent(textwrap.fill(parameter.description + choices, 93), " " * 6)
    return f"  {parameter.name}  {value}{unit}{live}\n{text}"


def as_yaml(value: Value) -> str:
    """Return a default as YAML has it; ``unset`` for nan, ``empty`` for an empty value."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(as_yaml, value))}]" if value else _EMPTY
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return _UNSET if math.isnan(value) else repr(value)
    return str(value) or _EMPTY
