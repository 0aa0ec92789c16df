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
"""Refuse, in one line, to release a tree that is not ready: make release.

release.py            the tree of a release to come: its tag does not exist yet
release.py 1.0.0      the tree that has this tag
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
#: Where a version stands. The changelog's newest heading must be that of a release, with its date.
VERSIONS = {
    "package.xml": r"<version>(.+)</version>",
    "tirgeo_ros/__init__.py": r'^__version__ = "(.+)"$',
    "CHANGELOG.rst": r"^(.+)\n-+$",
}
REFUSED = "tirgeo: not released"
#: RFC 2606 reserves names that end so: nobody can be reached there.
PLACEHOLDER = r"[\w.@-]+\.example\b"


def read(name: str) -> str:
    """Return the text of a file of the project."""
    return (PROJECT / name).read_text(encoding="utf-8")


def git(*words: str) -> str:
    """Return what git prints; raise SystemExit with its error."""
    command = ["git", "-C", str(PROJECT), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        sys.exit(f"{REFUSED}: {done.stderr.strip()}")
    return done.stdout.strip()


def versions() -> dict[str, str]:
    """Return the version by the file where it stands; of the changelog its newest heading."""
    found = {name: re.search(text, read(name), re.MULTILINE) for name, text in VERSIONS.items()}
    result = {name: match[1] if match else "none" for name, match in found.items()}
    heading = re.fullmatch(r"(\S+) \(\d{4}-\d\d-\d\d\)", result["CHANGELOG.rst"])
    return result | ({"CHANGELOG.rst": heading[1]} if heading else {})


def refusal(tag: str | None) -> str:
    """Return why this tree is not to be released; empty if it is."""
    if address := re.search(PLACEHOLDER, read("package.xml")):
        return f"package.xml has the placeholder address {address[0]}: write the project's own"
    stated = versions()
    version = stated["package.xml"]
    if {*stated.values()} != {version}:
        return "versions differ: " + ", ".join(f"{name} {text}" for name, text in stated.items())
    if git("status", "--porcelain"):
        return "the tree has changes that are not committed: see git status"
    if tag is None and git("tag", "--list", version):
        return f"the tag {version} exists: raise the version"
    if tag not in {None, version}:
        return f"the tag is {tag}, the version {version}"
    return ""


if __name__ == "__main__":
    reason = refusal(*(sys.argv[1:] or [None]))
    sys.exit(f"{REFUSED}: {reason}" if reason else 0)
