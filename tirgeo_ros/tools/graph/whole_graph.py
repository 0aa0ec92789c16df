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
"""Run the whole node graph, live or on a bag, in one process that replaces this one."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from tirgeo_ros.core.types.errors import ConfigError, GraphError
from tirgeo_ros.core.types.missing_package import needed_extra
from tirgeo_ros.io.files.child_process import node_command
from tirgeo_ros.io.files.stop_signals import stop_signals
from tirgeo_ros.io.files.whole_files import PathLike, named_files
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.graph.node_graph import (
    localhost_environment,
    parameter_words,
    video_environment,
)
from tirgeo_ros.tools.replay.node_configs import values_without_rates
from tirgeo_ros.tools.replay.registration import INPUTS

_USUAL_PARAMS = "config/m600_xt2.yaml"
_NAME = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def read_remaps(path: PathLike) -> list[tuple[str, str]]:
    """Return the pairs (topic of the contract, its name in the user's graph) of a file.

    Raise ConfigError naming file and key if the file is no mapping, or a name is invalid.
    """
    tree = load_yaml(path)
    if not isinstance(tree, dict) or not tree:
        raise ConfigError(f"{path}: write lines as imu/data: mavros/imu/data")
    for own, other in tree.items():
        if own not in INPUTS:
            raise ConfigError(f"{path}: {own}: not an input of tirgeo: use {', '.join(INPUTS)}")
        if not isinstance(other, str) or not _NAME.fullmatch(other):
            raise ConfigError(f"{path}: {own}: {other!r} is not the name of a topic")
    return list(tree.items())


@dataclass(frozen=True)
class WholeGraph:
    """Hold the nodes that run, and their inputs; the launch file starts the same graph.

    Raise GraphError for a file that does not exist, or if the page's packages are missing. Without
    ``params``, the parameters of an M600 apply. Without a bag, dji_node publishes the aircraft's
    topics unless ``dji`` is False. ``page`` is the address of the operator's page: None: no page,
    empty: as in the parameters.
    """

    bag: Path | None = None
    map: Path | None = None
    params: Sequence[Path] = ()
    namespace: str = ""
    dji: bool = True
    page: str | None = None
    cot: str | None = None  # where the page sends Cursor-on-Target
    remap: Path | None = None  # file of inputs that have other names

    def __post_init__(self) -> None:
        if self.page is not None:
            needed_extra("page", "--page", GraphError)
        maps = map(Path, named_files(str(self.map or "")))
        for path in (self.bag, self.remap, *maps, *self.params):
            if path and not path.exists():
                raise GraphError(f"{path}: there is no such file; check its name")

    @property
    def nodes(self) -> list[str]:
        """Return the names of the nodes; the node that publishes the inputs is the last."""
        source = ["bag_player"] if self.bag else ["dji_node"] if self.dji else []
        page = [] if self.page is None else ["viewer_node"]
        return ["ekf_node", "gimbal_node", "overlay_node", *page, *source]

    @property
    def arguments(self) -> list[str]:
        """Return the ROS arguments, which are the same for each node."""
        usual = find_resource(_USUAL_PARAMS)
        fitting = values_without_rates(self.bag, self.params, self.namespace) if self.bag else {}
        files = self.params or ([usual] if usual and not fitting else [])  # no M600 without an IMU
        bag = {"bag": self.bag, "use_sim_time": True, **fitting} if self.bag else {}
        values = {"map": self.map, "listen": self.page, "cot": self.cot}
        words = parameter_words(
            bag | {name: value for name, value in values.items() if value}, files
        )
        if self.namespace:
            words += ["-r", f"__ns:=/{self.namespace.strip('/')}"]
        if self.bag:  # the bag's clock goes into the namespace, as its topics do
            words += ["-r", "/clock:=clock"]
        for own, other in read_remaps(self.remap) if self.remap else ():
            words += ["-r", f"{own}:={other}"]
        return words

    @property
    def environment(self) -> dict[str, str]:
        """Return the nodes' environment; with a bag, only this machine reaches them."""
        config = find_resource("config")
        if self.bag:
            return localhost_environment(os.environ, config)
        return video_environment(os.environ, config) if config else dict(os.environ)

    def run(self) -> NoReturn:
        """Become the process of the nodes.

        No child can then outlive this process, and the exit code is that of the nodes.
        """
        command = node_command("one_process", [*self.arguments, "--", *self.nodes])
        # Signals are blocked from the first instruction; the nodes poll for them later.
        signal.pthread_sigmask(signal.SIG_BLOCK, stop_signals())
        os.execve(command[0], command, self.environment)  # noqa: S606  this very Python
