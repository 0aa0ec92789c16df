"""Run several nodes in this one process: ``one_process --ros-args ... -- NODE ...``.

All are in one DDS participant: what one publishes reaches the others without a transport, and what
no other process reads is sent nowhere. Other processes see and feed every topic as they do where
each node is a process. Each node has a thread of its own, as it would have there.
"""

from __future__ import annotations

import sys
import threading
from functools import partial
from typing import Any

from tirgeo_ros.nodes.bag_player import BagPlayer
from tirgeo_ros.nodes.dji_node import DjiNode
from tirgeo_ros.nodes.ekf_node import EkfNode
from tirgeo_ros.nodes.gimbal_node import GimbalNode
from tirgeo_ros.nodes.overlay_node import OverlayNode
from tirgeo_ros.nodes.runner import Part, Work, run_all

#: The user's command, at the beginning of its errors.
_PROGRAM = "tirgeo run"
#: After the end of a bag: the last pictures are drawn, the last diagnostics come within 1 s, and
#: what another process has lost is sent again at the writer's heartbeat, every 3 s.
_SETTLE_S = 3.5


def main() -> int:
    """Run the nodes that the command line names; return the exit code."""
    names = sys.argv[sys.argv.index("--") + 1 :]
    return run_all(_PROGRAM, {name: _PARTS[name] for name in names})


def _settled(work: Work, node: Any, stop: threading.Event) -> int:
    """Do a node's work; when it ends by itself, leave the other nodes time to finish theirs."""
    try:
        return work(node, stop)
    finally:
        stop.wait(_SETTLE_S)


_PARTS = {
    "dji_node": Part(DjiNode, DjiNode.serve),
    "ekf_node": Part(EkfNode),
    "gimbal_node": Part(GimbalNode),
    "overlay_node": Part(OverlayNode),
    "bag_player": Part(BagPlayer, partial(_settled, BagPlayer.play)),
}
