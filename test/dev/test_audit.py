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
"""The audit names vulnerable packages, and no "none" where nobody was asked."""

from __future__ import annotations

import json

import pytest

from dev.audit import main

HOLE = {"id": "PYSEC-2026-1", "fix_versions": ["2.0.1", "3.0"], "aliases": []}
OPEN = {"id": "PYSEC-2026-2", "fix_versions": [], "aliases": []}
OURS = {"name": "tirgeo", "skip_reason": "distribution marked as editable"}
HEAD = "in 1 packages; 1 others are not in PyPI's database"
LINES = [
    "mgrs 1.4: PYSEC-2026-1, mended in 2.0.1, 3.0",
    "mgrs 1.4: PYSEC-2026-2, mended in no version yet",
]


@pytest.mark.parametrize(("vulns", "lines"), [([], []), ([HOLE, OPEN], LINES)])
def test_each_vulnerability_is_a_line(tmp_path, capsys, vulns, lines):
    packages = [{"name": "mgrs", "version": "1.4", "vulns": vulns}, OURS]
    (tmp_path / "said.json").write_text(json.dumps({"dependencies": packages, "fixes": []}))
    assert main([str(tmp_path / "said.json")]) == int(bool(lines))
    said = [f"vulnerabilities: {len(lines)} {HEAD}", *lines]
    assert capsys.readouterr().out.splitlines() == said


@pytest.mark.parametrize("said", ["", json.dumps({"dependencies": [OURS], "fixes": []}), None])
def test_a_database_out_of_reach_is_no_good_news(tmp_path, capsys, said):
    if said is not None:
        (tmp_path / "said.json").write_text(said)
    assert main([str(tmp_path / "said.json")]) == 0
    assert capsys.readouterr().out.startswith("vulnerabilities: nobody was asked")
