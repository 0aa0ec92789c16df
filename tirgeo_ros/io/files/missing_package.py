"""Say how to install a Python package that is missing."""

from __future__ import annotations

import os

_MESSAGES = ("_msgs", "_srvs", "_interfaces")  # endings of ROS's packages of messages
#: Module -> Ubuntu's package ("" where there is none) and the name on PyPI: what setup.py lists.
PACKAGES = {
    "PIL": ("python3-pil", "Pillow"),
    "aiohttp": ("python3-aiohttp", "aiohttp"),
    "av": ("python3-av", "av"),
    "cryptography": ("python3-cryptography", "cryptography"),
    "cv2": ("python3-opencv", "opencv-python-headless"),
    "distributed": ("python3-distributed", "distributed"),
    "lz4": ("python3-lz4", "lz4"),
    "matplotlib": ("python3-matplotlib", "matplotlib"),
    "mcap": ("", "mcap"),
    "mgrs": ("", "mgrs"),
    "numpy": ("python3-numpy", "numpy"),
    "pyogrio": ("python3-pyogrio", "pyogrio"),
    "pymavlink": ("", "pymavlink"),
    "pyproj": ("python3-pyproj", "pyproj"),
    "pytak": ("", "pytak"),
    "pyubx2": ("", "pyubx2"),
    "pyulog": ("", "pyulog"),
    "rasterio": ("python3-rasterio", "rasterio"),
    "rosbags": ("", "rosbags"),
    "scipy": ("python3-scipy", "scipy"),
    "segno": ("python3-segno", "segno"),
    "serial": ("python3-serial", "pyserial"),
    "yaml": ("python3-yaml", "PyYAML"),
    "zstandard": ("python3-zstandard", "zstandard"),
}


def missing_line(module: str) -> str:
    """Return the line to print if a module (``cv2``, ``sensor_msgs.msg``) cannot be imported."""
    name = module.partition(".")[0]
    distribution = os.environ.get("ROS_DISTRO", "")
    apt, pip = PACKAGES.get(name, ("", name))
    remedy = f"sudo apt install {apt}, or pip install {pip}" if apt else f"pip install {pip}"
    if distribution and name.endswith(_MESSAGES):
        remedy = f"sudo apt install ros-{distribution}-{name.replace('_', '-')}"
    elif name.endswith(_MESSAGES) or name.startswith(("rclpy", "rosidl", "ament_", "rpyutils")):
        remedy = "source ROS 2 Jazzy (/opt/ros/jazzy/setup.bash), or pip install 'tirgeo[ros]'"
    return f"the Python package {name} is missing: {remedy}"
