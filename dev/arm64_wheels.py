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
"""Ask pip whether every dependency has a wheel for Linux on ARM64: ``make check-arm64``.

ROS itself has none: on ARM64 it comes from Ubuntu's packages (docs/install.md).
"""

from __future__ import annotations

import runpy
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from unittest import mock

from tirgeo_ros.io.files.child_process import python_command

PYTHONS = ("3.10", "3.11", "3.12", "3.13")
#: The oldest system with a Python 3.10 is Ubuntu 22.04, glibc 2.35: wheels for any older one run.
_TAGS = ("manylinux2014", *(f"manylinux_2_{minor}" for minor in range(17, 36)))
_FROM_APT = "ros"
#: Without a wheel for any computer: plain Python, of which pip makes one.
_FROM_SOURCE = ("taky",)
_PIP = "import runpy; runpy.run_module('pip', run_name='__main__')"


def requirements(setup_py: Path) -> list[str]:
    """Return what ``setup.py`` requires as wheels, with its extras but those of ROS."""
    with mock.patch("setuptools.setup") as setup:
        runpy.run_path(str(setup_py))
    arguments = setup.call_args.kwargs
    extras = [wanted for name, wanted in arguments["extras_require"].items() if name != _FROM_APT]
    every = chain(arguments["install_requires"], *extras)
    return [wanted for wanted in dict.fromkeys(every) if not wanted.startswith(_FROM_SOURCE)]


def refusal(wanted: Sequence[str], python: str) -> str:
    """Return pip's error for wheels of these and all that they need; empty if it has them all."""
    with tempfile.TemporaryDirectory() as work:
        options = ["--dry-run", "--ignore-installed", "--only-binary=:all:", "--target", work]
        options += ["--python-version", python, "--quiet"]
        options += [word for tag in _TAGS for word in ("--platform", f"{tag}_aarch64")]
        command = python_command(_PIP, "install", *options, *wanted)
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603  pip itself
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""


def main(setup_py: Path = Path("setup.py")) -> int:
    """Print a line for each Python; return 1 if a wheel is missing or pip fails."""
    wanted, code = requirements(setup_py), 0
    for python in PYTHONS:
        why = refusal(wanted, python)
        sys.stdout.write(f"Python {python}: {why or f'{len(wanted)} dependencies have wheels'}\n")
        code |= bool(why)
    sys.stdout.write("ROS 2 Jazzy comes from Ubuntu's packages there\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
