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
"""The floors of coverage: what is below one fails, by branches and not by lines."""

from __future__ import annotations

import json

import pytest

from dev.coverage_floors import main


def summary(ran, branches):
    """Return a file's summary whose lines were all run."""
    counts = {"num_branches": branches, "covered_branches": ran}
    return {"summary": {**counts, "num_statements": 100, "covered_lines": 100}}


@pytest.mark.parametrize(
    ("core", "rest", "low"),
    [
        (95, 85, ""),
        (94, 100, "below the floor: tirgeo_ros/core/\n"),
        (95, 84, "below the floor: tirgeo_ros/\n"),
        (80, 90, "below the floor: tirgeo_ros/core/, tirgeo_ros/\n"),
    ],
)
def test_what_is_below_its_floor_fails_and_is_named(tmp_path, capsys, core, rest, low):
    files = {"tirgeo_ros/core/a.py": summary(core, 100), "tirgeo_ros/io/b.py": summary(rest, 100)}
    (tmp_path / "report.json").write_text(json.dumps({"files": files}))
    assert main([str(tmp_path / "report.json")]) == int(bool(low))
    out, err = capsys.readouterr()
    assert err == low
    assert f"tirgeo_ros/core/     branches {core:5.1f} % (floor 95), lines 100.0 %\n" in out
    worst = sorted(((100 - core, "core/a.py"), (100 - rest, "io/b.py")), reverse=True)
    rows = [f"{count:5} of  100  tirgeo_ros/{path}" for count, path in worst]
    assert out.splitlines()[1:3] == rows
