"""Run a node as a child process, which ends with this one."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import threading
from collections.abc import Mapping
from contextlib import suppress

from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.core.config.viewer import GroundConfig
from tirgeo_ros.io.files.child_process import node_command
from tirgeo_ros.nodes.graph_node import GraphNode

_END_S = 20.0


class ChildNode:
    """Hold a node's process, in a namespace and by the clock of ``node``.

    It ends when the thread ends that started it.
    """

    def __init__(
        self, node: GraphNode, name: str, values: Mapping[str, object], namespace: str
    ) -> None:
        self.name = name
        simulated = node.get_parameter("use_sim_time").value
        words = [word for one in values.items() for word in _assignment(*one)]
        words += [
            "-p",
            f"use_sim_time:={json.dumps(simulated)}",
            "-r",
            f"__ns:={namespace or '/'}",
        ]
        self._process = subprocess.Popen(  # noqa: S603  this very Python
            node_command(name, words, ends_with=os.getpid()),
            stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
        self._line = "it said nothing"
        self._reader = threading.Thread(target=self._read, name=f"{name}'s log", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self._line = line.strip() or self._line

    @property
    def fault(self) -> str:
        """Return why it has ended by itself; empty while it runs."""
        if self._process.poll() is None:
            return ""
        self._reader.join(1.0)
        return f"{self.name} ended (exit code {self._process.returncode}): {self._line}"

    def end(self) -> str:
        """End it; return why that did not go well, else an empty text."""
        for number in (signal.SIGINT, signal.SIGKILL):
            self._process.send_signal(number)
            with suppress(subprocess.TimeoutExpired):
                return self.fault if self._process.wait(_END_S) else ""
        return f"{self.name} does not end"


def ground_values(config: GroundConfig) -> dict[str, object]:
    """Return the parameters of the ground, for a child."""
    return {one.name: getattr(config, one.name) for one in parameters_of(GroundConfig)}


def _assignment(name: str, value: object) -> list[str]:
    """Return the arguments that set a parameter; none for nan, which is unset."""
    if isinstance(value, float):
        return [] if math.isnan(value) else ["-p", f"{name}:={value!r}"]
    # ROS reads the value as YAML: a file named 7 would be a number without its quotes.
    return ["-p", f"{name}:={json.dumps(str(value), ensure_ascii=False)}"]
