"""docs/parameters.md is what the code makes of its parameters, and holds every one."""

from __future__ import annotations

import re

import pytest
import yaml
from project import PROJECT

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.nodes.parameters_page import parameters_page

PAGE = (PROJECT / "docs" / "parameters.md").read_text()
UNWRITTEN = {"*unset*": ".nan", "*empty*": "''"}


def rows(text):
    """Cells of the tables' rows, by the parameter's name."""
    found = [line.strip("|\n").split(" | ") for line in text.splitlines() if "| `" in line]
    return {cells[0].strip(" `"): [cell.strip() for cell in cells[1:]] for cells in found}


def test_the_page_is_current():
    assert parameters_page() == PAGE, (
        "docs/parameters.md is not what the code says: make parameters"
    )


@pytest.mark.parametrize("node", NODE_CONFIGS)
def test_every_parameter_of_a_node_is_there_once_with_what_it_must_be(node):
    section = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    (own,) = (text for text in section if text.startswith(f"{node}\n"))
    (shared,) = (text for text in section if text.startswith("All nodes\n"))
    table = rows(own)
    parameters = parameters_of(NODE_CONFIGS[node])
    assert [*table] == [one.name for one in parameters if not one.name.startswith("aircraft.")]
    for one in parameters:
        kind, unit, bounds, default, meaning = (rows(shared) | table)[one.name]
        assert (unit, meaning) == (one.unit, one.description)
        read = yaml.safe_load(UNWRITTEN.get(default, default.strip("`")))
        wanted = one.default if not isinstance(one.default, tuple) else [*one.default] or ""
        assert repr(read) == repr(wanted)
        assert all(choice in bounds for choice in one.choices)
        if not one.choices and one.high < float("inf"):
            assert [float(bound) for bound in bounds.split(" to ")] == [one.low, one.high]
        assert ("doubles" in kind) == isinstance(one.default, tuple)
