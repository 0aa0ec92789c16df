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
"""Stand-ins for ROS's launch, which no wheel holds, and what the launch file does with them."""

from __future__ import annotations

import os
import runpy
import sys
from types import ModuleType, SimpleNamespace

import yaml
from project import PROJECT


class Recorded(SimpleNamespace):
    def __init__(self, *positional, **named):
        super().__init__(positional=positional, **named)


class Argument(Recorded):
    def perform(self, context):
        (name,) = self.positional
        return context.launch_configurations.get(name, getattr(self, "default", None))


class PackageNotFoundError(KeyError):
    """As ament_index_python has it."""


def no_prefix(package):
    raise PackageNotFoundError(package)


def loaded(monkeypatch):
    """What the launch file defines, read with the stand-ins in place."""
    names = {
        "ament_index_python": "",
        "ament_index_python.packages": "",
        "launch": "LaunchContext LaunchDescription",
        "launch.action": "Action",
        "launch.actions": "DeclareLaunchArgument OpaqueFunction SetEnvironmentVariable Shutdown "
        "UnsetEnvironmentVariable",
        "launch.events": "",
        "launch.events.process": "ProcessExited",
        "launch_ros": "",
        "launch_ros.actions": "Node",
        "launch_ros.parameter_descriptions": "ParameterValue",
        "launch.substitutions": "",
    }
    for module_name, classes in names.items():
        module = ModuleType(module_name)
        for name in classes.split():
            setattr(module, name, type(name, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, module_name, module)
    sys.modules["launch.substitutions"].LaunchConfiguration = Argument
    packages = sys.modules["ament_index_python.packages"]
    packages.PackageNotFoundError, packages.get_package_prefix = PackageNotFoundError, no_prefix
    for name in [name for name in os.environ if name.startswith(("ROS_", "RMW_", "FAST"))]:
        monkeypatch.delenv(name)
    return runpy.run_path(str(PROJECT / "launch" / "tirgeo.launch.py"))


def actions_of(launch_file, others=(), **given):
    """``others`` are the launch configurations that the file itself does not declare."""
    actions = launch_file["generate_launch_description"]().positional[0]
    declared = {
        action.positional[0]: action.default_value
        for action in actions
        if type(action).__name__ == "DeclareLaunchArgument"
    }
    assert given.keys() <= declared.keys()
    configurations = declared | given | dict(others)
    return actions[-1].function(SimpleNamespace(launch_configurations=configurations))


def launched(launch_file, others=(), **given):
    actions = actions_of(launch_file, others, **given)
    return {node.name: node for node in actions if type(node).__name__ == "Node"}


def environment_of(launch_file, **given):
    """What the launch file sets, and None for what it takes away."""
    return {
        action.positional[0]: dict(enumerate(action.positional)).get(1)
        for action in actions_of(launch_file, **given)
        if type(action).__name__.endswith("EnvironmentVariable")
    }


def ros_arguments_of(node, folder):
    """What launch_ros calls the node's executable with, after ``--ros-args``."""
    full_name = f"/{node.namespace.strip('/')}/{node.name}".replace("//", "/")
    words = [*node.ros_arguments, "-r", f"__node:={node.name}", "-r", f"__ns:=/{node.namespace}"]
    for number, given in enumerate(node.parameters):
        path = given
        if isinstance(given, dict):
            values = {key: plain(value) for key, value in given.items()}
            path = folder / f"{node.name}.{number}.yaml"
            path.write_text(yaml.safe_dump({full_name: {"ros__parameters": values}}))
        words += ["--params-file", str(path)]
    return words + [word for own, other in node.remappings for word in ("-r", f"{own}:={other}")]


def plain(value):
    return value.positional[0] if type(value).__name__ == "ParameterValue" else value
