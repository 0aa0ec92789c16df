# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Define the executables; block the stop signals before anything slow is imported.

A stop signal that comes while modules load, or a second one shortly after the first, must not end
in a traceback or leave an incomplete file. So all stop signals are blocked from the first line on,
in every thread, and ``runner`` takes them when it is ready.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
import sys
from contextlib import suppress
from functools import partial

from tirgeo_ros.core.types.missing_package import missing_line
from tirgeo_ros.io.files.dds_profiles import take_small_profile
from tirgeo_ros.io.files.stop_signals import stop_signals

STOP_SIGNALS = stop_signals()
#: Nodes that send no pictures.
_SMALL_NODES = {"dji_node", "ekf_node", "gimbal_node"}
#: Parameters of mallopt (malloc.h), and values that keep some tens of pictures of 1 MB.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_TRIM_BYTES, _MMAP_BYTES = 64 << 20, 32 << 20


def start(name: str, package: str = "tirgeo_ros.nodes") -> int:
    """Run the node whose module is ``package.name``, or print its help; return the exit code."""
    if not {"-h", "--help", "--help-all"}.isdisjoint(sys.argv[1:]):
        from tirgeo_ros.nodes.help import help_text  # noqa: PLC0415  a running node does not need it

        sys.stdout.write(help_text(name, package))
        return 0
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    # A shell ignores SIGINT for background jobs.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Matrices of 15 rows gain nothing from threads, and idle threads use CPU time by spinning.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    leave_script_folder()
    if name in _SMALL_NODES:
        take_small_profile()
    else:
        keep_memory()
    try:
        module = importlib.import_module(f"{package}.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "tirgeo_ros").startswith("tirgeo_ros"):
            raise
        sys.stderr.write(f"{name}: {missing_line(str(error.name))}\n")
        return 1
    return int(module.main())


def leave_script_folder() -> None:
    """Take the folder of this script, which Python puts first, off the module path.

    It holds programs, not modules. With pip one of them, em.py of empy, has the name of a module
    that rclpy imports: run as a script, it is compiled anew at each start and takes 9 MB.
    """
    folder = os.path.dirname(sys.argv[0])  # noqa: PTH120  pathlib is not imported yet
    if folder and sys.path[0] == folder:
        del sys.path[0]


def keep_memory() -> None:
    """Make the C library keep freed memory for the next picture.

    By default it returns a picture's buffers to the system and requests new ones for the next,
    page by page. Without a large block in memory that costs over a thousand page faults per
    picture, and half of the time that it takes to pass a picture on.
    """
    with suppress(AttributeError):  # no glibc
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_TRIM_THRESHOLD, _TRIM_BYTES)
        mallopt(_MMAP_THRESHOLD, _MMAP_BYTES)


# The executables of setup.py.
dji_node = partial(start, "dji_node")
ekf_node = partial(start, "ekf_node")
gimbal_node = partial(start, "gimbal_node")
overlay_node = partial(start, "overlay_node")
viewer_node = partial(start, "viewer_node")
bag_player = partial(start, "bag_player")
