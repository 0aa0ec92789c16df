"""``python -m dev.nodes NAME --ros-args ...``: run a node of the laboratory."""

from __future__ import annotations

import sys

from dev.nodes.names import NAMES
from tirgeo_ros.nodes.start import start


def main() -> None:
    """Run the node that the first argument names."""
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        sys.exit(f"usage: python -m dev.nodes {{{','.join(NAMES)}}} [--ros-args ...]")
    sys.exit(start(sys.argv.pop(1), "dev.nodes"))


if __name__ == "__main__":
    main()
