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
"""Imports run one way, from package to package; only the nodes know ROS."""

from __future__ import annotations

import ast
import graphlib
import re
import subprocess
import sys

import package_edges
import pytest
from package_edges import module_graph, modules, package_graph, rooms
from project import PROJECT

MODULES = modules()
GRAPH = package_graph(MODULES)

#: What each layer may import of the others. Nothing of the product imports the laboratory.
LAYERS = {
    "core": {"core"},
    "dji": {"core", "dji"},
    "io": {"core", "io"},
    "tools": {"core", "dji", "io", "tools"},
    "library": {"core", "io", "tools", "library"},
    "page": {"core", "io", "page"},
    "nodes": {"core", "dji", "io", "page", "nodes"},
    "dev": {"core", "dji", "io", "tools", "page", "nodes", "dev"},
}
#: Within a layer, or a package, each package imports only from those before it.
ORDER = {
    "core": "types frames config streams camera ground orthorectification map targets accuracy "
    "ties navigation calibration adjustment gimbal overlay checks",
    "core.navigation": "ins aiding alignment timeline estimator smoothing",
    "dji": "clocks protocol link sources interpret simulator",
    "io": "files coordinates parameters elevation messages pictures video logs bags maps "
    "surveys targets",
    "tools": "presentation convert replay simulate budget calibrate evaluate export many_flights "
    "graph cli",
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


@pytest.mark.parametrize("package", sorted(filter(None, GRAPH)))
def test_a_package_imports_only_layers_below_its_own(package):
    layers = {other.partition(".")[0] for other in GRAPH[package]} - {""}
    assert layers <= LAYERS[package.partition(".")[0]]


@pytest.mark.parametrize("package", ORDER)
def test_within_a_package_imports_run_from_right_to_left(package):
    order = [f"{package}.{name}" for name in ORDER[package].split()]
    graph = rooms(GRAPH, package)
    assert {*order} == graph.keys() - {package}
    for place, name in enumerate(order):
        assert graph[name] <= {*order[:place]}


@pytest.mark.parametrize("package", sorted(GRAPH.keys() - {""}))
def test_no_package_imports_itself_by_a_detour(package):
    list(graphlib.TopologicalSorter(rooms(GRAPH, package)).static_order())


def test_no_module_imports_itself_by_a_detour():
    list(graphlib.TopologicalSorter(module_graph(MODULES)).static_order())


def test_the_table_of_packages_is_the_present_one():
    written = package_edges.PAGE.read_text()
    assert written == package_edges.page(GRAPH), "run: python test/support/package_edges.py"


def test_all_but_the_nodes_import_without_ros():
    names = {name for name in MODULES if not {"nodes", "dev"} & set(name.split("."))}
    names.remove(
        "tirgeo_ros.io.bags.rosbag2_file"
    )  # of use where ROS is, and imported there alone
    assert len(names) > 30
    run = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS, *names],
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr


#: What the core does not do: files, printing, logging, clocks of its own.
SILENT = {"logging", "pathlib", "os", "shutil", "tempfile", "warnings", "subprocess", "time"}


@pytest.mark.parametrize("name", [name for name in MODULES if ".core." in name])
def test_the_core_is_silent(name):
    path = MODULES[name]
    assert not {other.split(".")[0] for other in package_edges.imported(name, path)} & SILENT
    calls = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call))
    named = {call.func.id for call in calls if isinstance(call.func, ast.Name)}
    assert not named & {"print", "open", "input"}


#: Diagnostics and markers are for people and RViz: programs read the JSON beside them.
FOR_PEOPLE = ("/diagnostics", "tirgeo/targets/markers")
#: What declares, publishes or records them, or says who does.
NAMES_THEM = {
    "tirgeo_ros.io.messages.topics",
    "tirgeo_ros.nodes.aircraft_view",
    "tirgeo_ros.nodes.graph_node",
    "tirgeo_ros.nodes.recordings",
    "tirgeo_ros.tools.graph.node_graph",
    "tirgeo_ros.tools.replay.process_outputs",
}


def test_no_program_reads_what_is_for_people():
    naming = set()
    for name, path in MODULES.items():
        text = path.read_text()
        heard = re.findall(r"""\.(?:listen|create_subscription)\(\s*f?["']([^"']*)""", text)
        assert not set(heard) & set(FOR_PEOPLE), name
        assert not re.search("import Diagnostic(Array|Status)", text), name
        if name.startswith("tirgeo_ros.") and any(f'"{topic}"' in text for topic in FOR_PEOPLE):
            naming.add(name)
    assert naming == NAMES_THEM
