"""Write the parameter files of calibrations, for ``--params`` and the nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import yaml

from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.files.whole_files import PathLike, write_files

#: A parameter's value: a number (written with nine digits), a word, or numbers.
Value = float | int | bool | str | Sequence[float]


def parameters_yaml(nodes: Mapping[str, Mapping[str, Value]], head: str) -> str:
    """Return a ROS 2 parameter file: dotted names by node, under ``head`` as comment lines.

    The empty name stands for all nodes.
    """
    comment = "".join(f"# {line}".rstrip() + "\n" for line in head.splitlines())
    tree = {
        f"/**/{node}".rstrip("/"): {
            "ros__parameters": {name: _plain(v) for name, v in values.items()}
        }
        for node, values in nodes.items()
    }
    body: str = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=95)
    return comment + body


def write_parameters(path: PathLike, nodes: Mapping[str, Mapping[str, Value]], head: str) -> None:
    """Write ``parameters_yaml``: the whole file or none. Raises ConfigError."""
    write_files({path: parameters_yaml(nodes, head)}, ConfigError)


def _plain(value: Value) -> object:
    if isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return _rounded(value)
    return [_rounded(float(number)) for number in value]


def _rounded(number: float) -> float:
    """Round to nine digits: more than any calibration resolves, and no binary fraction's tail."""
    return float(f"{number:.9g}")
