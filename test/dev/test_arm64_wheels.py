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
"""The check for wheels on ARM64: what it asks for, its lines and its exit code, without pip."""

from __future__ import annotations

import pytest
from project import PROJECT

from dev import arm64_wheels
from dev.arm64_wheels import main, requirements


def test_what_setup_py_requires_is_asked_for_but_not_ros():
    wanted = requirements(PROJECT / "setup.py")
    assert {"numpy>=1.26", "lz4", "rasterio>=1.3"} <= set(wanted)
    assert not [each for each in wanted if each.startswith("ros-")]


@pytest.mark.parametrize("missing", [False, True])
def test_a_missing_wheel_is_a_line_and_an_exit_code(monkeypatch, capsys, missing):
    why = "ERROR: No matching distribution found for lz4"
    monkeypatch.setattr(
        arm64_wheels, "refusal", lambda _, python: why if missing and python == "3.13" else ""
    )
    assert main(PROJECT / "setup.py") == int(missing)
    *_, last, _ = lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5
    assert (last == f"Python 3.13: {why}") == missing
