"""Print ``NODE --help`` and docs/parameters.md: what a node does, and its parameters.

``make parameters``, or ``python -m tirgeo_ros.nodes.help docs/parameters.md``, writes the page. It
needs no ROS.
"""

from __future__ import annotations

import ast
import inspect
import math
import sys
import textwrap
from collections.abc import Iterable, Iterator
from functools import reduce
from importlib.resources import files
from itertools import groupby
from pathlib import Path

from tirgeo_ros.core.config import NODE_CONFIGS, AircraftConfig, EkfConfig, FramesConfig
from tirgeo_ros.core.config.schema import Parameter, Value, parameters_of

_HEAD = """\
# Parameters

Made from the code by `make parameters`: do not edit this page, but the descriptions in
`tirgeo_ros/core/config`.

A parameter that no file sets has its default. An owner edits the lines of
[m600_xt2.yaml](../config/m600_xt2.yaml), [m300_h20t.yaml](../config/m300_h20t.yaml) or
[generic.yaml](../config/generic.yaml); any other parameter goes into the same file, or into a
second one, under the name of its node, and `aircraft.*` and the frames' names under `/**`:

```yaml
/**/ekf_node:
  ros__parameters:
    rtk.delay_s: 0.08
```

Give files to the launch file (`params_file:=a.yaml,b.yaml`), to a node (`--ros-args
--params-file`) and to the commands (`--params`). Later files override earlier ones. An unknown
name, a wrong type or a value out of range is refused at start.

A parameter that is `live` can be set while the node runs, within the same range: `ros2 param set
/ekf_node rtk.position_sigma_floor_m 0.05`. It counts from the next sample on; the filter keeps its
state. The others are read at start, and setting one is refused with the reason. `ros2 param dump
NODE` writes a file that loads again, once its secrets (`***`) are written into it.

- Write a double with its point, also with an exponent: `5.0`, `1.0e-3`.
- *unset* is `.nan`, *empty* is `""` for a string and `[]` for a list.
- Standard deviations are one sigma. Angles are in degrees where the name ends in `_deg`.
- Three numbers along the aircraft's or the camera's axes are forward, left, up.
- `NODE --help` prints the same for one node.
"""
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
    parts = [_HEAD, f"[All nodes](#all-nodes), {links}\n", "## All nodes\n"]
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
    takes = filter(None, (kind, parameter.unit, between, "live" * parameter.live))
    default = f"*{text}*" if text in _NONE else f"`{text}`"
    cells = [f"`{parameter.name}`", ", ".join(takes), default, parameter.description]
    return f"| {' | '.join(cells)} |"


def _bound(value: float) -> str:
    """Return a bound as text, without an exponent if it is a whole number below 1e7."""
    whole = value == int(value) and (abs(value) < 1e7 or isinstance(value, int))
    return str(int(value)) if whole else f"{value:g}"


_NONE = _UNSET, _EMPTY = "unset", "empty"
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
    unit = f" {parameter.unit}" if parameter.unit and value not in _NONE else ""
    live = "  [in flight]" if parameter.live else ""
    choices = f" ({', '.join(parameter.choices)})" if parameter.choices else ""
    text = textwrap.fill(
        parameter.description + choices, 99, initial_indent=" " * 6, subsequent_indent=" " * 6
    )
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


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(parameters_page(), encoding="utf-8")
