"""Run a node that is not installed: ``python -m tirgeo_ros.nodes NAME --ros-args ...``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from tirgeo_ros.nodes.start import start

NAMES = ("dji_node", "ekf_node", "gimbal_node", "overlay_node", "bag_player", "recorder")


def main(names: Sequence[str] = NAMES, package: str = "tirgeo_ros.nodes") -> None:
    """Run the node of a package that the first argument names; ``names`` are those there are."""
    if len(sys.argv) < 2 or sys.argv[1] not in names:
        sys.exit(f"usage: python -m {package} {{{','.join(names)}}} [--help] [--ros-args ...]")
    sys.exit(start(sys.argv.pop(1), package))


if __name__ == "__main__":
    main()
