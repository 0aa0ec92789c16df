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
"""Write docs/parameters.md: ``make parameters``, or ``python -m dev.parameters_page PAGE``."""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Iterable, Iterator
from functools import reduce
from itertools import groupby
from pathlib import Path

from tirgeo_ros.core.config import NODE_CONFIGS, AircraftConfig, EkfConfig, FramesConfig
from tirgeo_ros.core.config.schema import Parameter, parameters_of
from tirgeo_ros.nodes.help import NONE, as_yaml

_HEAD = Path(__file__).with_name("parameters_head.md")
_COLUMNS = """\
| parameter | takes | default | meaning |
| --- | --- | --- | --- |"""
_KINDS = {bool: "bool", int: "int", float: "double", str: "string"}
#: What is written once, for all nodes: a group, and names.
_AIRCRAFT = "aircraft"
_FRAMES = {parameter.name for parameter in parameters_of(FramesConfig)}


def parameters_page() -> str:
    """Return the page: the aircraft's group, then a section per node and a table per group."""
    links = ", ".join(f"[{node}](#{node})" for node in NODE_CONFIGS)
    parts = [_HEAD.read_text(), f"[All nodes](#all-nodes), {links}\n", "## All nodes\n"]
    shared = [p for p in parameters_of(EkfConfig) if _group_name(p) == _AIRCRAFT]
    parts += _group(_AIRCRAFT, AircraftConfig, "", shared)
    parts += ["### Frames\n\n[Outputs](outputs.md#the-frames) draws them.\n"]
    parts += _group("", None, "", parameters_of(FramesConfig))
    for node, kind in NODE_CONFIGS.items():
        parts.append(f"## {node}\n")
        other = [p for p in parameters_of(kind) if p.name not in _FRAMES]
        for name, own in groupby(other, _group_name):
            if name != _AIRCRAFT:
                holder = type(reduce(getattr, name.split("."), kind())) if name else None
                parts += _group(name, holder, f" of {node}", own)
    return "\n".join(parts)


def _group_name(parameter: Parameter) -> str:
    return parameter.name.rpartition(".")[0]


def _group(name: str, holder: type | None, whose: str, own: Iterable[Parameter]) -> Iterator[str]:
    """Yield a group's heading and its dataclass's docstring, then its table."""
    if holder:
        text = " ".join((inspect.getdoc(holder) or "").split()).replace("``", "`")
        yield f"### `{name}.*`{whose}\n\n{text}\n"
    yield "\n".join([_COLUMNS, *map(_row, own)]) + "\n"


def _row(parameter: Parameter) -> str:
    sizes = f"{' or '.join(map(str, parameter.sizes))} doubles"
    text = as_yaml(parameter.default)
    between = ", ".join(parameter.choices)
    if not between and math.isfinite(parameter.low) and math.isfinite(parameter.high):
        between = f"{_bound(parameter.low)} to {_bound(parameter.high)}"
    kind = _KINDS.get(type(parameter.default)) or sizes
    takes = filter(None, (kind, parameter.unit, between, "live" if parameter.live else ""))
    default = f"*{text}*" if text in NONE else f"`{text}`"
    cells = [f"`{parameter.name}`", ", ".join(takes), default, parameter.description]
    return f"| {' | '.join(cells)} |"


def _bound(value: float) -> str:
    """Return a bound as text, without an exponent if it is a whole number below 1e7."""
    whole = value == int(value) and (abs(value) < 1e7 or isinstance(value, int))
    return str(int(value)) if whole else f"{value:g}"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(parameters_page(), encoding="utf-8")
