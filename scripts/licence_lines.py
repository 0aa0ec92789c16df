#!/usr/bin/env python3
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
"""Add the copyright and licence lines to the source files of the project that lack them.

    scripts/licence_lines.py [FILE...]      default: all that git has, but for what others wrote

It prints the files that it changes. The lines are at the head of a file, after its ``#!`` line. In
Python, which ROS's linter ament_copyright checks, Apache's own notice follows: the linter knows no
SPDX line, and reports an unknown licence without it (0.13.2, Debian's python3-ament-copyright).
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
#: Files of other people, under their own licence.
VENDORED = "tirgeo_ros/page/static/vendor/"
LINES = ("Copyright 2026 The tirgeo maintainers", "SPDX-License-Identifier: Apache-2.0")
NOTICE = """
Licensed under the Apache License, Version 2.0 (the "License");
you may not use this file except in compliance with the License.
You may obtain a copy of the License at

    http://www.apache.org/licenses/LICENSE-2.0

Unless required by applicable law or agreed to in writing, software
distributed under the License is distributed on an "AS IS" BASIS,
WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
See the License for the specific language governing permissions and
limitations under the License.
"""


def _commented(lines: Iterable[str], mark: str) -> str:
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines)


HASH = _commented(LINES, "#")
#: By the ending of the name; shell scripts may have none.
HEADS = {
    ".py": _commented([*LINES, *NOTICE.splitlines()], "#"),
    ".pyi": HASH,
    ".sh": HASH,
    "": HASH,
    ".js": _commented(LINES, "//"),
    ".css": f"/* {LINES[0]}\n * {LINES[1]} */\n",
}


def source_files() -> list[Path]:
    """Return the files of these kinds that git has."""
    listed = subprocess.run(
        ("git", "ls-files", "-z"),  # noqa: S607  whichever git there is
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=True,
    )
    names = [name for name in listed.stdout.split("\0") if name and not name.startswith(VENDORED)]
    return [path for path in map(PROJECT.joinpath, names) if _is_source(path)]


def _is_source(path: Path) -> bool:
    if path.suffix:
        return path.suffix in HEADS
    return path.name == "Makefile" or path.read_bytes().startswith(b"#!")


def lacking(paths: Iterable[Path]) -> list[Path]:
    """Return the files that lack the lines of their kind at their head; empty ones need none."""
    return [path for path in paths if (text := path.read_text()) and not _has_lines(path, text)]


def _has_lines(path: Path, text: str) -> bool:
    return _parts(text)[1].startswith(HEADS[path.suffix])


def _parts(text: str) -> tuple[str, str]:
    """Return the ``#!`` line, which must stay first, and the rest."""
    end = text.index("\n") + 1 if text.startswith("#!") else 0
    return text[:end], text[end:]


def main() -> None:
    """Add the lines to the files given, or to all."""
    for path in lacking(map(Path, sys.argv[1:]) if sys.argv[1:] else source_files()):
        (first, rest), head = _parts(path.read_text()), HEADS[path.suffix]
        gap = "\n" if rest.startswith(("#", "//")) else ""  # another comment is not of the notice
        path.write_text(first + head + gap + rest)
        sys.stdout.write(f"{path}\n")


if __name__ == "__main__":
    main()
