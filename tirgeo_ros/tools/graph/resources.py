"""Files that come with the package but are not code: the sample flight, parameter files."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import tirgeo_ros


def find_resource(relative: str) -> Path | None:
    """The path of ``bags/...`` or ``config/...``, or None where it is not installed.

    Looked for beside the source tree, in the ROS prefixes of the environment, in the virtual
    environment. ``get_package_share_directory`` alone would not find it outside an ROS prefix.
    """
    return next((path for path in _candidates(relative) if path.exists()), None)


def _candidates(relative: str) -> Iterator[Path]:
    source = Path(tirgeo_ros.__file__).resolve().parents[1]
    if (source / "package.xml").is_file():
        yield source / relative
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    yield from (Path(prefix) / "share" / "tirgeo" / relative for prefix in prefixes if prefix)
