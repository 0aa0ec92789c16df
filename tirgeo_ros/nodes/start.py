"""The executables: signals are held back before anything slow is imported.

A stop signal that comes while modules load, or a second one on the heels of the first, must
neither end in a traceback nor leave half a file. So both are blocked from the first line on, in
every thread, and ``runner`` takes them when it is ready to.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def start(name: str) -> int:
    """Run the node whose module is ``name``; the exit code."""
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    # Matrices of 15 rows gain nothing from threads, and idle ones spin.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        module = importlib.import_module(f"tirgeo_ros.nodes.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("tirgeo_ros"):
            raise
        sys.stderr.write(f"{name}: {error}: source ROS 2 Jazzy or install its wheels\n")
        return 1
    return int(module.main())


def dji_node() -> int:
    """Aircraft to topics."""
    return start("dji_node")


def ekf_node() -> int:
    """Navigation filter."""
    return start("ekf_node")


def gimbal_node() -> int:
    """Camera pose."""
    return start("gimbal_node")


def overlay_node() -> int:
    """Map on video."""
    return start("overlay_node")


def bag_player() -> int:
    """Bag to topics."""
    return start("bag_player")
