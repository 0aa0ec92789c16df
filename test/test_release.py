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
"""What ``make release`` refuses, and that the project's addresses stand in package.xml alone."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from project import PROJECT

import tirgeo_ros

VERSION = tirgeo_ros.__version__
#: Written so that this file is none of those with the address.
PLACEHOLDER = "tirgeo" + ".example"
FILES = ("package.xml", "tirgeo_ros/__init__.py", "CHANGELOG.rst", "scripts/release.py")
HEADING = re.compile(r"^.+\n-+$", re.MULTILINE)


@pytest.fixture
def tree(tmp_path):
    """A small project that is ready for a release, committed."""
    for name in FILES:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(PROJECT / name, tmp_path / name)
    change(tmp_path, "package.xml", PLACEHOLDER, "tirgeo.org")
    log = tmp_path / "CHANGELOG.rst"
    log.write_text(HEADING.sub(f"{VERSION} (2026-11-27)\n------------------", log.read_text(), 1))
    git(tmp_path, "init", "--quiet")
    commit(tmp_path)
    return tmp_path


def git(tree: Path, *words: str) -> None:
    subprocess.run(["git", *words], cwd=tree, check=True)


def commit(tree: Path) -> None:
    git(tree, "add", ".")
    name = ("-c", "user.name=tirgeo", "-c", "user.email=tirgeo@localhost")
    git(tree, *name, "commit", "--quiet", "--message", "A change")


def change(tree: Path, name: str, old: str, new: str) -> None:
    text = (tree / name).read_text()
    assert old in text
    (tree / name).write_text(text.replace(old, new))


def release(tree: Path, *words: str) -> tuple[int, str]:
    command = [sys.executable, "scripts/release.py", *words]
    done = subprocess.run(command, cwd=tree, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


def refusal(tree: Path, *words: str) -> str:
    code, text = release(tree, *words)
    (line,) = text.splitlines()
    assert code == 1
    assert line.startswith("tirgeo: not released: ")
    return line.removeprefix("tirgeo: not released: ")


def test_a_tree_that_is_ready(tree):
    assert release(tree) == (0, "")
    git(tree, "tag", VERSION)
    assert release(tree, VERSION) == (0, "")


def test_a_placeholder_among_the_addresses(tree):
    change(tree, "package.xml", "https://tirgeo.org/issues", "https://" + PLACEHOLDER + "/issues")
    commit(tree)
    assert refusal(tree) == (
        f"package.xml has the placeholder address {PLACEHOLDER}: write the project's own"
    )


@pytest.mark.parametrize("name", FILES[:3])
def test_versions_that_differ(tree, name):
    change(tree, name, VERSION, "9.9.9")
    commit(tree)
    line = refusal(tree)
    assert line.startswith("versions differ: package.xml ")
    assert f"{name} 9.9.9" in line


def test_a_changelog_whose_newest_heading_is_no_release(tree):
    change(tree, "CHANGELOG.rst", f"{VERSION} (2026-11-27)\n---", "Forthcoming\n---")
    commit(tree)
    assert refusal(tree).endswith("CHANGELOG.rst Forthcoming")


def test_a_change_that_is_not_committed(tree):
    (tree / "new").touch()
    assert refusal(tree) == "the tree has changes that are not committed: see git status"


def test_a_tag_that_exists_and_one_of_another_version(tree):
    git(tree, "tag", VERSION)
    assert refusal(tree) == f"the tag {VERSION} exists: raise the version"
    assert refusal(tree, "9.9.9") == f"the tag is 9.9.9, the version {VERSION}"


def test_a_tree_without_git(tree):
    shutil.rmtree(tree / ".git")
    assert "not a git repository" in refusal(tree)


def test_the_addresses_stand_in_package_xml_alone():
    if not (PROJECT / ".git").exists():
        pytest.skip("git knows which files are the project's, and this is no clone")
    root = ET.parse(PROJECT / "package.xml").getroot()
    addresses = [url.text.removesuffix(".git") for url in root.iter("url")]
    addresses += [item.get("email") for item in root.iter("maintainer")]
    words = [word for address in addresses for word in ("-e", address)]
    command = ["git", "grep", "--files-with-matches", "--fixed-strings", *words]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["package.xml"]
