"""Imports run one way, and only the nodes know ROS."""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest
from project import PROJECT

PACKAGE = PROJECT / "tirgeo_ros"
MODULES = sorted(PACKAGE.rglob("*.py"))

#: What each layer may import of the others.
ALLOWED = {
    "core": {"core"},
    "dji": {"core", "dji"},
    "io": {"core", "io"},
    "tools": {"core", "dji", "io", "tools"},
    "nodes": {"core", "dji", "io", "nodes"},
}

# Imports every module but the nodes' where no ROS package can be found: neither rclpy, nor the
# packages of messages, nor what ament installs beside them.
WITHOUT_ROS = """
import importlib, sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        ros = top.endswith(("_msgs", "_srvs", "_interfaces")) or top.startswith(
            ("rclpy", "rosidl", "ament_", "launch", "tf2", "rosbag2", "rpyutils", "cv_bridge")
        )
        if ros:
            raise ModuleNotFoundError(f"{name} is blocked", name=name)

sys.meta_path.insert(0, NoRos())
try:
    import rclpy
except ModuleNotFoundError:
    pass
else:
    sys.exit("the block does not hold")
for name in sys.argv[1:]:
    importlib.import_module(name)
"""


def layer_of(path):
    parts = path.relative_to(PACKAGE).parts
    return parts[0] if len(parts) > 1 else ""


def dotted(path):
    return ".".join(path.relative_to(PROJECT).with_suffix("").parts).removesuffix(".__init__")


def imported(path):
    """Full names of all that a file imports, wherever in it the import stands."""
    package = dotted(path) if path.name == "__init__.py" else dotted(path).rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = ".".join([*above, node.module or ""]).strip(".") if node.level else node.module
            yield from (f"{base}.{alias.name}" for alias in node.names)


def layers_imported(path):
    names = (name.split(".") for name in imported(path))
    return {
        name[1] for name in names if name[0] == "tirgeo_ros" and name[1:2] and name[1] in ALLOWED
    }


def test_every_module_belongs_to_a_layer():
    assert {layer_of(path) for path in MODULES} == {"", *ALLOWED}


@pytest.mark.parametrize("layer", ALLOWED)
def test_imports_run_one_way(layer):
    wrong = {
        f"{dotted(path)} imports {other}"
        for path in MODULES
        if layer_of(path) == layer
        for other in layers_imported(path) - ALLOWED[layer]
    }
    assert not wrong


def test_all_but_the_nodes_import_without_ros():
    names = [dotted(path) for path in MODULES if layer_of(path) != "nodes"]
    assert len(names) > 30
    run = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS, *names],
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr


def test_the_check_sees_an_import_however_it_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "PROJECT", tmp_path)
    path = tmp_path / "tirgeo_ros" / "core" / "sub" / "x.py"
    path.parent.mkdir(parents=True)
    path.write_text(
        "import tirgeo_ros.tools.replay.process\n"
        "def f():\n"
        "    from tirgeo_ros import nodes\n"
        "    from ...io import bag\n"
        "    from . import y\n"
    )
    assert sorted(imported(path)) == [
        "tirgeo_ros.core.sub.y",
        "tirgeo_ros.io.bags.bag",
        "tirgeo_ros.nodes",
        "tirgeo_ros.tools.replay.process",
    ]
    assert layers_imported(path) == {"core", "io", "nodes", "tools"}


#: What the core does not do: files, printing, logging, clocks of its own.
SILENT = {"logging", "pathlib", "os", "shutil", "tempfile", "warnings", "subprocess", "time"}


def test_the_core_is_silent():
    wrong = set()
    for path in MODULES:
        if layer_of(path) != "core":
            continue
        wrong |= {
            f"{dotted(path)} imports {n}" for n in imported(path) if n.split(".")[0] in SILENT
        }
        calls = (
            node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)
        )
        wrong |= {
            f"{dotted(path)} calls {call.func.id}"
            for call in calls
            if isinstance(call.func, ast.Name) and call.func.id in {"print", "open", "input"}
        }
    assert not wrong
