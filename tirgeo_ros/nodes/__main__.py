"""Run a node that is not installed: ``python -m tirgeo_ros.nodes NAME --ros-args ...``."""

from __future__ import annotations

import sys

from tirgeo_ros.nodes.start import start

NAMES = (
    "dji_node",
    "ekf_node",
    "gimbal_node",
    "overlay_node",
    "bag_player",
    "recorder",
)


def main() -> None:
    """Run the node that the first argument names."""
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        sys.exit(
            f"usage: python -m tirgeo_ros.nodes {{{','.join(NAMES)}}} [--help] [--ros-args ...]"
        )
    sys.exit(start(sys.argv.pop(1)))


if __name__ == "__main__":
    main()
