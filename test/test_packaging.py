"""The files that describe the package agree with one another and with the code."""

from __future__ import annotations

import ast
import configparser
import importlib
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import pytest
import setuptools
from project import NODES, PROJECT

import tirgeo_ros

NAME = "tirgeo"

#: What the modules that the code imports are called in package.xml, where not the same.
KEYS = {
    "numpy": "python3-numpy",
    "cv2": "python3-opencv",
    "pyproj": "python3-pyproj",
    "yaml": "python3-yaml",
    "PIL": "python3-pil",
    "matplotlib": "python3-matplotlib",
    "scipy": "python3-scipy",
    "serial": "python3-serial",
    "cryptography": "python3-cryptography",
}
#: What they are called on PyPI.
WHEELS = {
    "cv2": "opencv-python-headless",
    "yaml": "PyYAML",
    "PIL": "Pillow",
    "serial": "pyserial",
}
#: No key of rosdep that a system with an externally managed Python would take.
BY_PIP_ALONE = {"av", "mcap", "lz4", "zstandard", "rosbags", "pyogrio"}
#: Not in the distribution, and needed with an M300 or M350 alone.
FROM_SOURCE = {"psdk_interfaces"}
#: Imported where they are needed and installed: extras of setup.py.
OPTIONAL = {"rasterio": "dem"}
#: Types of messages in bags that others recorded: their definitions come with the bags.
IN_BAGS = {"dji_sdk"}
LAUNCH = {"launch", "launch_ros", "ros2launch"}


@pytest.fixture(scope="module")
def package_xml():
    return ET.parse(PROJECT / "package.xml").getroot()


def setup_arguments(monkeypatch, *argv):
    """What setup.py gives to setuptools when it is called with ``argv``."""
    given = {}
    monkeypatch.setattr(setuptools, "setup", lambda **arguments: given.update(arguments))
    monkeypatch.setattr(sys, "argv", ["setup.py", *argv])
    runpy.run_path(str(PROJECT / "setup.py"))
    return given


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
    return names - set(sys.stdlib_module_names) - {"tirgeo_ros"}


@cache
def message_packages(folder):
    """Packages of the message types that are looked up by name: "sensor_msgs/msg/Imu"."""
    texts = (n.value for n in syntax_nodes(folder) if isinstance(n, ast.Constant))
    typenames = (re.fullmatch(r"(\w+)/(msg|srv)/\w+", text) for text in texts if type(text) is str)
    return {found.group(1) for found in typenames if found}


def dependencies(package_xml, *tags):
    return {item.text for tag in tags for item in package_xml.findall(tag)}


def test_names_agree(package_xml, arguments):
    config = configparser.ConfigParser()
    config.read(PROJECT / "setup.cfg")
    assert package_xml.findtext("name") == NAME
    assert arguments["name"] == NAME
    assert config["develop"]["script_dir"] == f"$base/lib/{NAME}"
    assert config["install"]["install_scripts"] == f"$base/lib/{NAME}"
    assert (PROJECT / "resource" / NAME).is_file()


def test_versions_agree(package_xml, arguments):
    newest = re.search(r"^(\d+\.\d+\.\d+) \(\d{4}-\d\d-\d\d\)$", changelog(), re.MULTILINE)
    assert newest
    assert newest.group(1) == tirgeo_ros.__version__
    assert package_xml.findtext("version") == tirgeo_ros.__version__
    assert arguments["version"] == tirgeo_ros.__version__


def changelog():
    return (PROJECT / "CHANGELOG.rst").read_text()


def test_what_the_code_imports_is_in_package_xml_and_no_more(package_xml):
    code = imported_modules(PROJECT / "tirgeo_ros") | message_packages(PROJECT / "tirgeo_ros")
    keys = {
        KEYS.get(name, name)
        for name in code - BY_PIP_ALONE - FROM_SOURCE - IN_BAGS - OPTIONAL.keys()
    }
    assert dependencies(package_xml, "depend", "exec_depend") == keys | LAUNCH
    assert imported_modules(PROJECT / "launch") <= LAUNCH


def test_what_the_code_imports_is_in_setup_py_and_no_more(arguments):
    code = imported_modules(PROJECT / "tirgeo_ros") & {*KEYS, *BY_PIP_ALONE}
    needed = {re.split(r"[<>=]", item)[0] for item in arguments["install_requires"]}
    assert needed == {WHEELS.get(name, name) for name in code}


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
    assert files[f"share/{NAME}"] == ["package.xml"]
    assert files[f"share/{NAME}/launch"] == ["launch/tirgeo.launch.py"]
    aircraft = {"config/m600_xt2.yaml", "config/m300_h20t.yaml"}
    assert aircraft <= set(files[f"share/{NAME}/config"])
    assert all((PROJECT / path).is_file() for paths in files.values() for path in paths)


def test_only_a_wheel_has_forwarding_scripts(monkeypatch, tmp_path, arguments):
    assert not any(folder.startswith("lib") for folder, _ in arguments["data_files"])
    for name in ("tirgeo_ros", "resource", "package.xml", "config", "launch"):
        (tmp_path / name).symlink_to(PROJECT / name)
    monkeypatch.chdir(tmp_path)
    files = dict(setup_arguments(monkeypatch, "bdist_wheel")["data_files"])
    assert {Path(path).name for path in files[f"lib/{NAME}"]} == NODES
    lay_out(tmp_path / "prefix", files[f"lib/{NAME}"])
    script = tmp_path / "prefix" / "lib" / NAME / "ekf_node"
    run = subprocess.run([script, "a b", "c"], capture_output=True, text=True, check=True)
    assert run.stdout == "in bin: a b,c,\n"


def lay_out(prefix, scripts):
    """The scripts as pip installs them, and beside them an ekf_node that tells its arguments."""
    (prefix / "bin").mkdir(parents=True)
    (prefix / "lib" / NAME).mkdir(parents=True)
    for path in scripts:
        Path(path).rename(prefix / "lib" / NAME / Path(path).name)
    target = prefix / "bin" / "ekf_node"
    target.write_text('#!/bin/sh\nprintf "in bin: "; printf "%s," "$@"; echo\n')
    target.chmod(0o755)
