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
"""Every row of the findings' table is used, and gets the numbers that its texts name."""

from __future__ import annotations

import ast
import string
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
from project import PROJECT

from tirgeo_ros.core import checks
from tirgeo_ros.core.checks.finding_table import FINDINGS, AtLeast, Row, finding
from tirgeo_ros.core.types.finding import Severity

CORE = [*Path(checks.__path__[0]).glob("*.py")]
OTHERS = [
    PROJECT / "tirgeo_ros" / name
    for name in ("tools/replay/check.py", "tools/replay/flight_checks.py", "nodes/setup_checks.py")
]


def calls() -> Iterator[tuple[str, ast.Call]]:
    for path in (*CORE, *OTHERS):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "finding":
                yield path.name, node


SOURCE = "".join(path.read_text() for path in (*CORE, *OTHERS) if path.name != "finding_table.py")


def texts(row: Row, field: str) -> list[str]:
    value = getattr(row, field)
    return [*value.values()] if isinstance(value, Mapping) else [value]


def names(row: Row) -> set[str]:
    """The facts of a row."""
    of_texts = {
        name
        for field in ("evidence", "parameter", "mend")
        for text in texts(row, field)
        for _, name, _, _ in string.Formatter().parse(text)
        if name
    }
    return of_texts | ({row.severity.number} if isinstance(row.severity, AtLeast) else set())


@pytest.mark.parametrize("key", FINDINGS)
def test_each_row_is_complete_and_used(key):
    row = FINDINGS[key]
    for field in ("severity", "evidence", "parameter", "mend"):
        value = getattr(row, field)
        assert not isinstance(value, Mapping) or "" in value
    spelled = {f'"{key}"', f'"{key.removeprefix("rtk_fix").removeprefix("rtk_vel")}'}
    assert any(text in SOURCE for text in spelled) or key.endswith("_delay")


@pytest.mark.parametrize("key", FINDINGS)
def test_each_text_can_be_written(key):
    row = FINDINGS[key]
    cases = {""}
    for value in (row.severity, row.evidence, row.parameter, row.mend):
        cases |= set(value) if isinstance(value, Mapping) else set()
    facts = dict.fromkeys(names(row), 1.5) | {"topic": "rtk/vel"}
    for case in cases:
        made = finding(key, case, **facts)
        assert made.evidence
        assert made.mend
        assert "{" not in made.check + made.line


def test_literal_calls_give_the_numbers_of_their_rows():
    checked = 0
    for name, call in calls():
        key, starred = call.args[0], [word for word in call.keywords if word.arg is None]
        if isinstance(key, ast.Constant) and not starred:
            needed, given = names(FINDINGS[key.value]), {word.arg for word in call.keywords}
            assert needed == given - {"topic"} | needed & {"topic"}, (name, key.value)
            checked += 1
    assert checked > 30


def test_severities_by_case_and_by_size():
    assert finding("map_unreadable", why="no JSON").severity is Severity.STOP
    assert finding("map_unreadable", "older", why="no JSON").severity is Severity.CAUTION
    facts = {"topic": "rtk/fix", "way": "later", "sigma_s": 0.01}
    sizes = [finding("rtk_fix_delay", **facts, size_s=size).severity for size in (0.1, 0.2, 0.5)]
    assert sizes == list(Severity)
