"""The executables: signals are held back before anything slow is imported.

A stop signal that comes while modules load, or a second one on the heels of the first, must
neither end in a traceback nor leave half a file. So all are blocked from the first line on, in
every thread, and ``runner`` takes them when it is ready to.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
import sys

from tirgeo_ros.io.files.stop_signals import stop_signals

STOP_SIGNALS = stop_signals()
#: Of mallopt (malloc.h), and values that hold some tens of pictures of 1 MB.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_TRIM_BYTES, _MMAP_BYTES = 64 << 20, 32 << 20


def start(name: str, package: str = "tirgeo_ros.nodes") -> int:
    """Run the node whose module is ``package.name``, or print its help; return the exit code."""
    if not {"-h", "--help", "--help-all"}.isdisjoint(sys.argv[1:]):
        from tirgeo_ros.nodes.help import help_text  # noqa: PLC0415  no node has a use for it

        sys.stdout.write(help_text(name, sys.argv[1:]))
        return 0
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
    # Matrices of 15 rows gain nothing from threads, and idle ones spin.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    keep_memory()
    try:
        module = importlib.import_module(f"{package}.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("tirgeo_ros"):
            raise
        sys.stderr.write(f"{name}: {error}: source ROS 2 Jazzy or install its wheels\n")
        return 1
    return int(module.main())


def keep_memory() -> None:
    """Have the C library keep what is freed for the next picture.

    By itself it gives a picture's buffers back to the system and takes new ones for the next,
    page by page: where nothing large lies in memory over a thousand faults a picture, and half of
    the time that passing one on takes.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except AttributeError:
        return  # no glibc
    mallopt(_TRIM_THRESHOLD, _TRIM_BYTES)
    mallopt(_MMAP_THRESHOLD, _MMAP_BYTES)


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
