"""Run a node of the laboratory: ``python -m dev.nodes NAME --ros-args ...``."""

from __future__ import annotations

from dev.nodes import NAMES
from tirgeo_ros.nodes.__main__ import main as run_named


def main() -> None:
    """Run the node that the first argument names."""
    run_named(NAMES, "dev.nodes")


if __name__ == "__main__":
    main()
