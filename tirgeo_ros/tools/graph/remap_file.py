"""Read a file of topics that have other names in a user's graph, as ``config/mavros.yaml``.

ROS 2 takes remap rules as arguments alone, and from no file: what this gives goes to the nodes as
``-r OWN:=OTHER``, or to launch as ``remappings``.
"""

from __future__ import annotations

import re

from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.tools.replay.flight_topics import INPUTS

_NAME = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def read_remaps(path: PathLike) -> list[tuple[str, str]]:
    """Return the pairs (topic of the contract, its name in the user's graph) of a file.

    Raise ConfigError naming file and key if it is no mapping, or a name is none.
    """
    tree = load_yaml(path)
    if not isinstance(tree, dict) or not tree:
        raise ConfigError(f"{path}: no lines as imu/data: mavros/imu/data")
    for own, other in tree.items():
        if own not in INPUTS:
            raise ConfigError(f"{path}: {own}: no input of tirgeo: use {', '.join(INPUTS)}")
        if not isinstance(other, str) or not _NAME.fullmatch(other):
            raise ConfigError(f"{path}: {own}: {other!r} is no topic's name")
    return list(tree.items())
