"""Where the project's own files are, and what its nodes are called."""

from __future__ import annotations

from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]

#: The executables that a launch file starts.
NODES = frozenset({"dji_node", "ekf_node", "gimbal_node", "overlay_node", "bag_player"})
