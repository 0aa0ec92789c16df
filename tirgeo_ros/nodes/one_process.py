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
"""Run several nodes in this one process: ``one_process --ros-args ... -- NODE ...``.

The nodes share one DDS participant: their messages to each other need no transport, and a topic is
sent to other processes only if one of them subscribes. To other processes the graph looks as if
each node were a process. Each node has a thread of its own.

Only viewer_node gets a process of its own: its page must not wait for the interpreter that the
other nodes share. If it ends it is started again, unless it refuses its parameters at its start.
"""

from __future__ import annotations

import os
import secrets
import signal
import subprocess
import sys
import threading
from functools import partial
from typing import Any

from tirgeo_ros.core.config.viewer_parameters import TOKEN_SEED
from tirgeo_ros.io.files.child_process import node_command
from tirgeo_ros.nodes.bag_player import BagPlayer
from tirgeo_ros.nodes.dji_node import DjiNode
from tirgeo_ros.nodes.ekf_node import EkfNode
from tirgeo_ros.nodes.gimbal_node import GimbalNode
from tirgeo_ros.nodes.monitor import ERROR
from tirgeo_ros.nodes.overlay_node import OverlayNode
from tirgeo_ros.nodes.runner import Part, Work, run_all

#: The user's command, at the beginning of its errors.
_PROGRAM = "tirgeo run"
#: Wait after the end of a bag: the last pictures are drawn, the last diagnostics come within 1 s,
#: and messages that another process lost are sent again at the writer's heartbeat, every 3 s.
_SETTLE_S = 3.5
_POLL_S = 0.1
#: Longest wait for the end of the page, which may have recordings to complete.
_PAGE_END_S = 30.0
#: Wait before the page is started again.
_RESTART_S = 2.0


def main() -> int:
    """Run the nodes that the command line names; return the exit code."""
    end = sys.argv.index("--")
    names, arguments = sys.argv[end + 1 :], sys.argv[sys.argv.index("--ros-args") + 1 : end]
    parts = {name: _PARTS[name] for name in names if name in _PARTS}
    if "viewer_node" in names:
        os.environ.setdefault(TOKEN_SEED, secrets.token_urlsafe())
        parts["overlay_node"] = Part(OverlayNode, partial(_keep_page_running, arguments))
    return run_all(_PROGRAM, parts)


def _keep_page_running(arguments: list[str], overlay: OverlayNode, stop: threading.Event) -> int:
    """Run viewer_node in its own process, and start it again if it ends, until ``stop`` is set.

    Return its last exit code, 0 or 1. If it ends with an error before its first report, its set-up
    is wrong: then all nodes end.
    """
    while not stop.is_set():
        code = _run_page(arguments, stop)
        if stop.is_set() or (code > 0 and "viewer_node" not in overlay.reporting_nodes):
            return int(code != 0)
        again = f"started again in {_RESTART_S:g} s"
        overlay.log(ERROR, f"viewer_node ended (exit code {code}): {again}")
        stop.wait(_RESTART_S)
    return 0


def _run_page(arguments: list[str], stop: threading.Event) -> int:
    """Run viewer_node until it ends; stop it when ``stop`` is set. Return the exit code."""
    command = node_command("viewer_node", arguments, ends_with=os.getpid())
    with subprocess.Popen(command, stdin=subprocess.DEVNULL) as page:  # noqa: S603  this Python
        while not stop.wait(_POLL_S):
            if page.poll() is not None:
                return page.returncode
        page.send_signal(signal.SIGINT)
        try:
            return page.wait(_PAGE_END_S)
        except subprocess.TimeoutExpired:
            page.kill()
            return 1


def _work_and_settle(work: Work, node: Any, stop: threading.Event) -> int:
    """Do a node's work; if it ends by itself, give the other nodes time to finish."""
    try:
        return work(node, stop)
    finally:
        stop.wait(_SETTLE_S)


_PARTS = {
    "dji_node": Part(DjiNode, DjiNode.serve),
    "ekf_node": Part(EkfNode),
    "gimbal_node": Part(GimbalNode),
    "overlay_node": Part(OverlayNode),
    "bag_player": Part(BagPlayer, partial(_work_and_settle, BagPlayer.play)),
}
