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
"""The package's own import stays quick, gives each public name at its first use, and no other."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys

import pytest
from project import PROJECT

import tirgeo_ros

# What the commands' start must not wait for.
HEAVY = "numpy cv2 pyproj rosbags pandas matplotlib tirgeo_ros.core tirgeo_ros.library"


@pytest.mark.parametrize(
    ("use", "absent"),
    [
        ("pass", HEAVY),
        ("[getattr(tirgeo_ros, name) for name in tirgeo_ros.__all__]", "pandas rclpy"),
    ],
)
def test_the_import_alone_imports_nothing_and_no_name_needs_pandas(use, absent):
    program = f"import sys, tirgeo_ros; {use}; print({{*'{absent}'.split()}} & sys.modules.keys())"
    output = subprocess.check_output([sys.executable, "-c", program], cwd=PROJECT, text=True)
    assert output == "set()\n"


def test_every_name_is_there():
    assert set(tirgeo_ros.__all__) <= set(dir(tirgeo_ros))
    for name in tirgeo_ros.__all__:
        assert getattr(tirgeo_ros, name) is getattr(tirgeo_ros, name)


def test_types_are_those_of_the_stub():
    """mypy reads __init__.pyi, Python __init__.py: each name must come from one place."""
    stub = ast.parse((PROJECT / "tirgeo_ros" / "__init__.pyi").read_text())
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    sources = {alias.name: node.module for node in imports for alias in node.names}
    assert sources == {
        name: inspect.getmodule(getattr(tirgeo_ros, name)).__name__ for name in tirgeo_ros.__all__
    }
    (listed,) = (ast.literal_eval(n.value) for n in stub.body if isinstance(n, ast.Assign))
    assert sorted(listed) == sorted(tirgeo_ros.__all__)


def test_no_other_name_is_there():
    with pytest.raises(
        AttributeError, match="module 'tirgeo_ros' has no attribute 'filterflight'"
    ):
        _ = tirgeo_ros.filterflight
    with pytest.raises(ImportError, match="filterflight"):
        from tirgeo_ros import filterflight  # noqa: F401, PLC0415  a wrong name
