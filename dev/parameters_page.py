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
