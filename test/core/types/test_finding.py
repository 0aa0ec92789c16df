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
