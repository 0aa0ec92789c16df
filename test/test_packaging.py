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
"""The files that describe the package agree with one another and with the code."""

from __future__ import annotations

import ast
import configparser
import importlib
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tarfile
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import pytest
import setuptools
from project import NODES, PROJECT

import tirgeo_ros
from tirgeo_ros.core.types.missing_package import PACKAGES

NAME = "tirgeo"

#: What rosdep has no key for, or one for pip, which neither a released package nor a system with
#: an externally managed Python can use.
NO_KEY = {"av", "mcap", "lz4", "zstandard", "rosbags", "pyogrio", "mgrs", "pytak"}
NO_KEY |= {"pyulog", "pymavlink", "pyubx2", "pynmeagps", "distributed"}
#: What the modules that the code imports are called in package.xml, where not the same.
KEYS = {name: apt for name, (_, _, apt) in PACKAGES.items() if name not in NO_KEY}
#: Not in the distribution, and needed with an M300 or M350 alone.
FROM_SOURCE = {"psdk_interfaces"}
#: Types of messages in bags that others recorded: their definitions come with the bags.
IN_BAGS = {"dji_sdk"}
LAUNCH = {"ament_index_python", "launch", "launch_ros", "ros2launch"}
#: Loaded by rosbag2_py, and imported by nobody.
PLUGINS = {"rosbag2_storage_mcap"}


@pytest.fixture(scope="module")
def package_xml():
    return ET.parse(PROJECT / "package.xml").getroot()


def setup_arguments(monkeypatch, *argv):
    """What setup.py gives to setuptools when it is called with ``argv``."""
    passed = {}
    monkeypatch.setattr(setuptools, "setup", lambda **arguments: passed.update(arguments))
    monkeypatch.setattr(sys, "argv", ["setup.py", *argv])
    runpy.run_path(str(PROJECT / "setup.py"))
    return passed


@pytest.fixture
def arguments(monkeypatch):
    monkeypatch.chdir(PROJECT)
    return setup_arguments(monkeypatch, "install")


def syntax_nodes(folder):
    for path in folder.rglob("*.py"):
        yield from ast.walk(ast.parse(path.read_text(), str(path)))


@cache
def imported_modules(folder):
    """Top-level names of what the files of a folder import from outside the standard library."""
    names = set()
    for node in syntax_nodes(folder):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(node.module.partition(".")[0])
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "needed":
            names |= {a.value.partition(".")[0] for a in node.args[:1] if type(a) is ast.Constant}
    return names - set(sys.stdlib_module_names) - {"tirgeo_ros"}


@cache
def message_packages(folder):
    """Packages of the message types that are looked up by name: "sensor_msgs/msg/Imu"."""
    texts = (n.value for n in syntax_nodes(folder) if isinstance(n, ast.Constant))
    typenames = (re.fullmatch(r"(\w+)/(msg|srv)/\w+", text) for text in texts if type(text) is str)
    return {result.group(1) for result in typenames if result}


def test_names_and_versions_agree(package_xml, arguments):
    config = configparser.ConfigParser()
    config.read(PROJECT / "setup.cfg")
    assert package_xml.findtext("name") == NAME
    assert arguments["name"] == NAME
    assert config["develop"]["script_dir"] == f"$base/lib/{NAME}"
    assert config["install"]["install_scripts"] == f"$base/lib/{NAME}"
    assert (PROJECT / "resource" / NAME).is_file()
    changelog = (PROJECT / "CHANGELOG.rst").read_text()
    newest = re.search(r"^(\d+\.\d+\.\d+) \(\d{4}-\d\d-\d\d\)$", changelog, re.MULTILINE)[1]
    versions = newest, package_xml.findtext("version"), arguments["version"]
    assert {*versions} == {tirgeo_ros.__version__}


def test_names_and_addresses_are_those_of_package_xml(package_xml, arguments):
    urls = {url.get("type"): url.text for url in package_xml.findall("url")}
    maintainer = package_xml.find("maintainer")
    assert arguments["maintainer"] == maintainer.text
    assert arguments["maintainer_email"] == maintainer.get("email")
    assert arguments["author"] == package_xml.findtext("author")
    assert arguments["url"] == urls["website"]
    assert arguments["project_urls"]["Tracker"] == urls["bugtracker"]
    assert f"{arguments['project_urls']['Source']}.git" == urls["repository"]


def test_the_description_links_to_files_of_the_repository(arguments):
    links = re.findall(r"\]\(([^)]+)\)", arguments["long_description"])
    start = re.escape(arguments["project_urls"]["Source"]) + "/(blob|raw)/HEAD/([^#]+)"
    ours = [match for link in links if (match := re.match(start, link))]
    assert ours
    assert all((PROJECT / match[2]).exists() for match in ours)
    assert {match[1] for match in ours if match[2].endswith(".webp")} == {"raw"}
    assert all(link.startswith(("https://", "#")) for link in links)


def test_what_the_code_imports_is_in_package_xml_and_no_more(package_xml):
    code = imported_modules(PROJECT / "tirgeo_ros") | message_packages(PROJECT / "tirgeo_ros")
    keys = {KEYS.get(name, name) for name in code - NO_KEY - FROM_SOURCE - IN_BAGS}
    assert package_xml.get("format") == "3"
    assert not package_xml.findall("depend")
    listed = [item.text for item in package_xml.findall("exec_depend")]
    assert sorted(listed) == sorted(keys | LAUNCH | PLUGINS)
    assert imported_modules(PROJECT / "launch") <= LAUNCH


def packages_by_pip(name):
    """What pip installs in a file beside Ubuntu's packages, without limits to a version."""
    text = (PROJECT / name).read_text().replace("\\\n", "")
    (line,) = re.findall(r"pip install (--break[^`\n]* mcap [^`&\n]*)", text)
    return {word for word in shlex.split(line) if not re.search("^--|<", word)}


def test_container_and_workflow_install_by_pip_what_the_documents_say():
    documented = packages_by_pip("docs/install.md")
    assert documented <= NO_KEY
    assert packages_by_pip("Dockerfile") == documented
    assert packages_by_pip(".github/workflows/ci.yml") == documented


def test_the_tests_that_run_by_default_need_what_package_xml_lists(package_xml):
    """Those are the quick ones: ``colcon test``, and so the build farm, names no tests."""
    options = (PROJECT / "pyproject.toml").read_text()
    (folder,) = re.search(r'^testpaths = \["([^"]+)"\]$', options, re.MULTILINE).groups()
    assert f"$(WORKERS) {folder}\n" in (PROJECT / "Makefile").read_text().partition("quick:")[2]
    listed = {item.text for item in package_xml.findall("test_depend")}
    assert listed == {"python3-hypothesis", "python3-pytest"}
    support = {path.stem for path in (PROJECT / "test/support").rglob("*.py")}
    known = {"hypothesis", "pytest", "dev", *KEYS.keys() - NO_KEY, *support}
    assert imported_modules(PROJECT / folder) <= known


def test_what_the_code_imports_is_in_setup_py_and_no_more(arguments):
    assert PACKAGES.keys() <= imported_modules(PROJECT / "tirgeo_ros")
    extras = arguments["extras_require"] | {"": arguments["install_requires"]}
    for extra in {extra for _, extra, _ in PACKAGES.values()}:
        items = {re.split(r"[<>=]", item)[0] for item in extras[extra]}
        assert items == {pip for pip, own, _ in PACKAGES.values() if own == extra}
        assert not extra or {*extras[extra]} <= {*extras["all"]}


@pytest.mark.slow
def test_a_source_distribution_holds_the_whole_project(tmp_path):
    """Tests and documents too, so that ``make test`` runs where it was unpacked."""
    made = (
        ".git",
        ".gitignore",
        ".venv*",
        "*.egg-info",
        "__pycache__",
        "build",
        "dist",
        ".*_cache",
    )
    made += (".hypothesis", "demo", "examples_output")
    copy = tmp_path / "project"
    shutil.copytree(PROJECT, copy, ignore=shutil.ignore_patterns(*made))
    command = [sys.executable, "setup.py", "-q", "sdist", "--dist-dir", tmp_path]
    run = subprocess.run(command, cwd=copy, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    (packed,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(packed) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    files = {str(path.relative_to(copy)) for path in copy.rglob("*") if path.is_file()}
    assert {name for name in files if not name.startswith(f"{NAME}.egg-info")} <= held


def test_every_executable_is_there_and_resolves(arguments):
    commands = dict(item.split(" = ") for item in arguments["entry_points"]["console_scripts"])
    assert set(commands) == {NAME, *NODES}
    for target in commands.values():
        module, _, function = target.partition(":")
        assert callable(getattr(importlib.import_module(module), function))


def test_every_module_is_installed(arguments):
    folders = {path.parent for path in (PROJECT / "tirgeo_ros").rglob("*.py")}
    assert set(arguments["packages"]) == {
        ".".join(folder.relative_to(PROJECT).parts) for folder in folders
    }


def test_share_holds_what_the_tools_look_for(arguments):
    files = dict(arguments["data_files"])
    assert files["share/ament_index/resource_index/packages"] == [f"resource/{NAME}"]
    assert files[f"share/{NAME}"] == ["package.xml", "LICENSE"]
    assert files[f"share/{NAME}/launch"] == ["launch/tirgeo.launch.py"]
    aircraft = {f"config/{name}.yaml" for name in ("m600_xt2", "m300_h20t", "generic")}
    assert aircraft <= set(files[f"share/{NAME}/config"])
    assert all((PROJECT / path).is_file() for paths in files.values() for path in paths)


def test_it_builds_from_links_in_another_folder_as_colcon_has_it_for_a_symlink_install(
    tmp_path, arguments
):
    """What colcon links, and what its ``develop`` and ``symlink_data`` do there.

    ``develop`` itself is pip from setuptools 80 on, and would install into the tests' Python.
    """
    data = [name for _, names in arguments["data_files"] for name in names]
    for name in ("setup.py", "setup.cfg", "tirgeo_ros", *data):
        link = tmp_path / "build" / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(PROJECT / name)
    commands = ["egg_info", "install_data", "--install-dir", tmp_path / "install"]
    run = subprocess.run(
        [sys.executable, "-W", "ignore:setup.py install", "setup.py", "-q", *commands],
        cwd=tmp_path / "build",
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.returncode, run.stderr) == (0, "")
    laid = [path for path in (tmp_path / "install").rglob("*") if path.is_file()]
    assert len(laid) == len(data) > 30


def test_only_a_wheel_has_forwarding_scripts(monkeypatch, tmp_path, arguments):
    assert not any(folder.startswith("lib") for folder, _ in arguments["data_files"])
    monkeypatch.chdir(tmp_path)
    files = dict(setup_arguments(monkeypatch, "bdist_wheel")["data_files"])
    assert {Path(path).name for path in files[f"lib/{NAME}"]} == {NAME, *NODES}
    # The scripts as pip installs them, and beside them an ekf_node that prints its arguments.
    scripts, target = tmp_path / "lib" / NAME, tmp_path / "bin" / "ekf_node"
    for folder in (scripts, target.parent):
        folder.mkdir(parents=True)
    for path in files[f"lib/{NAME}"]:
        Path(path).rename(scripts / Path(path).name)
    target.write_text('#!/bin/sh\nprintf "in bin: "; printf "%s," "$@"; echo\n')
    target.chmod(0o755)
    run = subprocess.run(
        [scripts / "ekf_node", "a b", "c"], capture_output=True, text=True, check=True
    )
    assert run.stdout == "in bin: a b,c,\n"
