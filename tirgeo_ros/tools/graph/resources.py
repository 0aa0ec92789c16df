"""Find files that come with the package but are not code: sample flight, parameter files."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import tirgeo_ros


def find_resource(relative: str) -> Path | None:
    """Return the path of ``bags/...`` or ``config/...``, or None if it is not installed.

    The search goes through the source tree, the ROS prefixes of the environment and the virtual
    environment. ``get_package_share_directory`` alone would not find a file outside a ROS prefix.
    """
    return next((path for path in _candidates(relative) if path.exists()), None)


def _candidates(relative: str) -> Iterator[Path]:
    source = Path(tirgeo_ros.__file__).resolve().parents[1]
    if (source / "package.xml").is_file():
        yield source / relative
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    yield from (Path(prefix) / "share" / "tirgeo" / relative for prefix in prefixes if prefix)
