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
"""Say how to install a Python package that is missing."""

from __future__ import annotations

import importlib
from typing import Any

from tirgeo_ros.core.types.errors import TirgeoError

_MESSAGES = ("_msgs", "_srvs", "_interfaces")  # endings of ROS's packages of messages
#: Module -> its name on PyPI, the extra of setup.py that has it ("": every install has it), and
#: Ubuntu's package ("": there is none).
PACKAGES = {
    "PIL": ("Pillow", "", "python3-pil"),
    "cv2": ("opencv-python-headless", "", "python3-opencv"),
    "lz4": ("lz4", "", "python3-lz4"),
    "mcap": ("mcap", "", ""),
    "numpy": ("numpy", "", "python3-numpy"),
    "pyproj": ("pyproj", "", "python3-pyproj"),
    "rosbags": ("rosbags", "", ""),
    "yaml": ("PyYAML", "", "python3-yaml"),
    "zstandard": ("zstandard", "", "python3-zstandard"),
    "aiohttp": ("aiohttp", "page", "python3-aiohttp"),
    "av": ("av", "video", "python3-av"),
    "cryptography": ("cryptography", "dji", "python3-cryptography"),
    "distributed": ("distributed", "cluster", "python3-distributed"),
    "matplotlib": ("matplotlib", "plots", "python3-matplotlib"),
    "mgrs": ("mgrs", "page", ""),
    "pynmeagps": ("pynmeagps", "logs", ""),
    "pyogrio": ("pyogrio", "maps", "python3-pyogrio"),
    "pymavlink": ("pymavlink", "logs", ""),
    "pytak": ("pytak", "page", ""),
    "pyubx2": ("pyubx2", "logs", ""),
    "pyulog": ("pyulog", "logs", ""),
    "rasterio": ("rasterio", "dem", "python3-rasterio"),
    "scipy": ("scipy", "plots", "python3-scipy"),
    "segno": ("segno", "page", "python3-segno"),
    "serial": ("pyserial", "dji", "python3-serial"),
}


def missing_line(module: str, purpose: str = "") -> str:
    """Return the line to print if a module (``cv2``, ``sensor_msgs.msg``) cannot be imported.

    ``purpose`` is what needs it: "writing out.mp4".
    """
    name = module.partition(".")[0]
    pip, extra, apt = PACKAGES.get(name, (name, "", ""))
    remedy = f"sudo apt install {apt}, or pip install {pip}" if apt else f"pip install {pip}"
    if extra:
        remedy = f'pip install "tirgeo[{extra}]"'
    elif name.endswith(_MESSAGES):
        remedy = f"sudo apt install ros-jazzy-{name.replace('_', '-')}, or "
        remedy += 'pip install "tirgeo[ros]"'
    elif name.startswith(("rclpy", "rosidl", "ament_", "rpyutils")):
        remedy = "source ROS 2 Jazzy (/opt/ros/jazzy/setup.bash), or "
        remedy += 'pip install "tirgeo[ros]"'
    lack = f"{purpose} needs {pip}" if purpose else f"the Python package {name} is missing"
    return f"{lack}: {remedy}"


def needed(module: str, purpose: str, error: type[TirgeoError]) -> Any:
    """Return a module; raise ``error`` with ``missing_line`` if it cannot be imported."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise error(missing_line(module, purpose)) from None


def needed_extra(extra: str, purpose: str, error: type[TirgeoError]) -> None:
    """Raise ``error`` with ``missing_line`` if a package of an extra cannot be imported."""
    for module, (_, own, _) in PACKAGES.items():
        if own == extra:
            needed(module, purpose, error)
