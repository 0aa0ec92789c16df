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
"""Makes the virtual environment that runs it smaller; nothing that runs is lost.

Wheels hold no links, so ROS's have one library under up to five names; identical ones become one
file with several names. Headers of C++ and CMake's files are for who compiles against ROS. Some
libraries bring their tests; NumPy's stay, for NumPy imports one. Zstandard brings a second library
that is for PyPy.
"""

from __future__ import annotations

import filecmp
import os
import shutil
import sys
from collections import defaultdict
from pathlib import Path

SMALLEST_BYTES = 100_000
WITH_TESTS = ("scipy", "matplotlib", "mpl_toolkits", "pyogrio")


def main() -> None:
    """Slim ``sys.prefix``."""
    prefix = Path(sys.prefix)
    if sys.prefix == sys.base_prefix:
        sys.exit("slim.py: this Python is not of a virtual environment")
    packages = "lib/python3*/site-packages"
    unused = ["include/*", "lib/cmake", "share/*/cmake"]
    unused += [f"{packages}/{library}/**/tests" for library in WITH_TESTS]
    for folder in [folder for pattern in unused for folder in prefix.glob(pattern)]:
        shutil.rmtree(folder)
    for library in prefix.glob(f"{packages}/zstandard/_cffi.*"):
        library.unlink()
    by_size: dict[int, list[Path]] = defaultdict(list)
    for path in sorted((prefix / "lib").rglob("*.so*")):
        if path.is_file() and not path.is_symlink() and path.stat().st_size >= SMALLEST_BYTES:
            by_size[path.stat().st_size].append(path)
    for paths in by_size.values():
        link_same(paths)


def link_same(paths: list[Path]) -> None:
    """Make each file that has the bytes of an earlier one a second name of it."""
    kept: list[Path] = []
    for path in paths:
        same = next((one for one in kept if filecmp.cmp(one, path, shallow=False)), None)
        if same is None:
            kept.append(path)
        elif not path.samefile(same):
            beside = path.with_name(f"{path.name}.new")
            os.link(same, beside)
            beside.replace(path)


if __name__ == "__main__":
    main()
