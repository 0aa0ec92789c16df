"""Import TFMessage: ROS's own where it is installed, else that of ``tf_package``."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

_FOLDER = str(Path(__file__).parent / "tf_package")
if _FOLDER not in sys.path:
    sys.path.append(_FOLDER)  # behind all others

from tf2_msgs.msg import TFMessage  # noqa: E402

__all__ = ["TFMessage", "with_tf"]


def with_tf(environment: Mapping[str, str]) -> dict[str, str]:
    """The variable with which nodes find the same package."""
    return {"PYTHONPATH": os.pathsep.join([environment.get("PYTHONPATH", ""), _FOLDER])}
