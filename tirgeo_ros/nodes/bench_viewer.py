"""The viewer of ``bench_video``, as a node by name."""

from __future__ import annotations

from tirgeo_ros.nodes.bench_video import view as main

__all__ = ["main"]
