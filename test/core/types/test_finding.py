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
"""Findings in order, and the one line of go or no go."""

from __future__ import annotations

import pytest

from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings, verdict_line


def finding(check, severity, evidence="it is 2, not 1"):
    return Finding(check, severity, evidence, "a_node a_parameter", "set it to 1")


NOTE, CAUTION, STOP = (finding(item.name.lower(), item) for item in Severity)


def test_the_worst_comes_first_and_each_check_once():
    worse = finding("note", Severity.STOP, "it is 3, not 1")
    assert sorted_findings([NOTE, CAUTION, worse, STOP]) == [worse, STOP, CAUTION]


@pytest.mark.parametrize(
    ("findings", "line"),
    [
        ([], "GO"),
        ([NOTE], "GO"),
        ([NOTE, CAUTION], "CAUTION: it is 2, not 1: a_node a_parameter"),
        ([CAUTION, NOTE, STOP], "NO GO: it is 2, not 1: a_node a_parameter (and 1 more)"),
    ],
)
def test_one_line_says_whether_to_fly(findings, line):
    assert verdict_line(findings) == line
