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
"""Let a process find only what a ROS from Ubuntu's packages has with it.

That is: the standard library, ROS, the libraries that rosdep has apt keys for, and what those
libraries need. The process's own children find no more. In the place of ROS's rosbag2_py, which is
not to be had here, stands the one of test/support/stand_ins; what that needs is hidden after it
was imported.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from importlib import metadata
from importlib.machinery import ModuleSpec
from pathlib import Path

#: Distributions on PyPI of the libraries with a key, an apt package on Ubuntu 24.04, in rosdep.
KEYED = (
    *("numpy", "scipy", "opencv-python-headless", "Pillow", "pyproj", "PyYAML", "pyserial"),
    *("cryptography", "aiohttp", "segno", "rasterio", "matplotlib"),
)
_OWN = {"tirgeo_ros", "rosbag2_py", "blocked_imports"}
_BEGIN = """\
import sys
sys.path[:0] = {!r}
import blocked_imports
blocked_imports.block({!r})
"""


def _with_needs(names: Iterable[str], found: set[str]) -> set[str]:
    """Add distributions and all that they need, without extras, to a set, and return it."""
    for name in map(_plain, names):
        if name in found:
            continue
        try:
            needs = metadata.requires(name) or []
        except metadata.PackageNotFoundError:  # for other Pythons, or not installed here
            continue
        found.add(name)
        _with_needs((each for each in needs if "extra ==" not in each), found)
    return found


def _plain(requirement: str) -> str:
    return re.split(r"[^\w.-]", requirement)[0].lower().replace("_", "-")


def allowed_modules() -> list[str]:
    """Return the modules outside the standard library that a process may find."""
    keyed = _with_needs(KEYED, set())
    return sorted(
        module
        for module, names in metadata.packages_distributions().items()
        if any(_plain(name) in keyed or _plain(name).startswith("ros-") for name in names)
    )


class _Only:
    """Find only some modules, by the finders that there were."""

    def __init__(self, names: set[str]) -> None:
        self._names, self._finders = names, list(sys.meta_path)

    def find_spec(self, name: str, *where: object) -> ModuleSpec | None:
        top = name.partition(".")[0]
        if top not in self._names and not top.startswith("_sysconfigdata"):
            return None
        specs = (finder.find_spec(name, *where) for finder in self._finders)
        return next(filter(None, specs), None)


def block(names: list[str]) -> None:
    """Hide all but these modules from this process and its children."""
    import rosbag2_py  # noqa: F401, PLC0415  the stand-in

    known = {*names, *sys.stdlib_module_names, *_OWN}
    for name in [name for name in sys.modules if name.partition(".")[0] not in known]:
        if name != "__main__":
            del sys.modules[name]
    sys.meta_path[:] = [_Only(known)]
    from tirgeo_ros.io.files import child_process  # noqa: PLC0415  after the block

    child_process.python_command = blocked(child_process.python_command, names)


def blocked(command: Callable[..., list[str]], names: list[str]) -> Callable[..., list[str]]:
    """Return ``python_command`` so that the process that it describes is blocked."""
    here = Path(__file__).parent
    begin = _BEGIN.format([str(here), str(here / "stand_ins")], names)
    return lambda code, *arguments: command(begin + code, *arguments)
