"""Run the node graph; do the work of ``tirgeo demo`` and ``tirgeo run``."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import tirgeo_ros


def find_resource(relative: str) -> Path | None:
    """Return the path of ``bags/...`` or ``config/...``, or None if it is not installed.

    The search goes through the source tree, the ROS prefixes of the environment and the virtual
    environment. ``get_package_share_directory`` alone would not find a file outside a ROS prefix.
    """
    source = Path(tirgeo_ros.__file__).resolve().parents[1]
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    folders = [Path(prefix) / "share" / "tirgeo" for prefix in prefixes if prefix]
    if (source / "package.xml").is_file():
        folders.insert(0, source)
    return next((path for folder in folders if (path := folder / relative).exists()), None)
