"""Write docs/parameters.md: every node's parameters, as the dataclasses of core/config have them.

``python -m tirgeo_ros.nodes.parameters_page docs/parameters.md``, or ``make parameters``. No ROS.
"""

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
from tirgeo_ros.nodes.help import as_yaml

_HEAD = """\
# Parameters

Made from the code by `make parameters`: do not edit this page, but the descriptions in
`tirgeo_ros/core/config`.

No file needs them all: a parameter that no file sets has its default. An owner edits the lines of
[m600_xt2.yaml](../config/m600_xt2.yaml), [m300_h20t.yaml](../config/m300_h20t.yaml) or
[generic.yaml](../config/generic.yaml), which is for an aircraft that is not DJI's. Any other
parameter goes into the same file, or into a second one, under the name of its node, and the block
`aircraft` and the frames' names under `/**`, for all nodes:

```yaml
/**/ekf_node:
  ros__parameters:
    rtk.delay_s: 0.08
```

Give files to the launch file (`params_file:=a.yaml,b.yaml`), to a node (`--ros-args
--params-file`) and to the commands (`--params`); the last two may be repeated. Later files
override earlier ones. An unknown name, a wrong type or a value out of range is refused at start.

Where *in flight* says `yes`, a running node takes another value too, within the same range,
from its next sample on, and logs the change: `ros2 param set /ekf_node
rtk.position_sigma_floor_m 0.05`. The filter keeps its state; an alignment begins again. What
was set is gone when the node ends: write it into the file. The others are read at start: they
are measured before flight (`aircraft.*`), are opened once, or decide how the node is built.
Setting one is refused with the reason. `ros2 param dump NODE` writes a file that loads again, once
the secrets that it has as `***` are written into it.

- Write a double with its point, also with an exponent: `5.0`, `1.0e-3`.
- *unset* is `.nan`, *empty* is `""` for a string and `[]` for a list.
- Standard deviations are one sigma. Angles are in degrees where the name ends in `_deg`.
- Three numbers along the aircraft's or the camera's axes are forward, left, up.
- `NODE --help` prints the same for one node.
"""
_COLUMNS = """\
| parameter | type | unit | range | default | in flight | meaning |
| --- | --- | --- | --- | --- | --- | --- |"""
_KINDS = {bool: "bool", int: "int", float: "double", str: "string"}
#: What is written once, for all nodes: a group, and names.
_AIRCRAFT = "aircraft"
_FRAMES = {one.name for one in parameters_of(FramesConfig)}


def parameters_page() -> str:
    """Return the page: the aircraft's group, then a section per node and a table per group."""
    links = ", ".join(f"[{node}](#{node})" for node in NODE_CONFIGS)
    parts = [_HEAD, f"[All nodes](#all-nodes), {links}\n", "## All nodes\n"]
    shared = (one for one in parameters_of(EkfConfig) if _group_name(one) == _AIRCRAFT)
    parts += _group(_AIRCRAFT, AircraftConfig, "", shared)
    parts += ["### Frames\n\n[Outputs](outputs.md#the-frames) draws them.\n"]
    parts += _group("", None, "", parameters_of(FramesConfig))
    for node, kind in NODE_CONFIGS.items():
        parts.append(f"## {node}\n")
        other = (one for one in parameters_of(kind) if one.name not in _FRAMES)
        for name, own in groupby(other, _group_name):
            if name != _AIRCRAFT:
                holder = type(reduce(getattr, name.split("."), kind())) if name else None
                parts += _group(name, holder, f" of {node}", own)
    return "\n".join(parts)


def _group_name(one: Parameter) -> str:
    return one.name.rpartition(".")[0]


def _group(name: str, holder: type | None, whose: str, own: Iterable[Parameter]) -> Iterator[str]:
    """Yield a group's heading and its dataclass's docstring, then its table."""
    if holder:
        text = " ".join((inspect.getdoc(holder) or "").split()).replace("``", "`")
        yield f"### `{name}.*`{whose}\n\n{text}\n"
    yield "\n".join([_COLUMNS, *map(_row, own)]) + "\n"


def _row(one: Parameter) -> str:
    kind = _KINDS.get(type(one.default)) or f"{' or '.join(map(str, one.sizes))} doubles"
    text = as_yaml(one.default)
    default = f"*{text}*" if text in ("unset", "empty") else f"`{text}`"
    live = "yes" if one.live else ""
    cells = [f"`{one.name}`", kind, one.unit, _range(one), default, live, one.description]
    return f"| {' | '.join(cells)} |"


def _range(one: Parameter) -> str:
    if one.choices:
        return ", ".join(one.choices)
    if math.isinf(one.low) or math.isinf(one.high):
        return ""
    return f"{_bound(one.low)} to {_bound(one.high)}"


def _bound(value: float) -> str:
    """Return a bound as text, without an exponent if it is a whole number below 1e7."""
    whole = value == int(value) and (abs(value) < 1e7 or isinstance(value, int))
    return str(int(value)) if whole else f"{value:g}"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(parameters_page(), encoding="utf-8")
