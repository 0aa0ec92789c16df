"""The measurement of many flights: its flights, and what it calls missed."""

from __future__ import annotations

import json
import math

import pytest

from dev.judging import Figure
from dev.season import different, scenario_of
from tirgeo_ros.tools.simulate.scenario import load_scenario


def test_its_flights_are_scenarios_that_all_differ(tmp_path):
    found = []
    for number in range(60):
        path = tmp_path / f"{number}.yaml"
        path.write_text(json.dumps(scenario_of(number)))
        found.append(load_scenario(path))
    assert len({one.start_ns for one in found}) == 60
    assert len({one.site for one in found}) == 3
    assert {one.route.shape for one in found} == {"lawnmower", "hover", "figure_eight"}


@pytest.mark.parametrize(
    ("value", "wanted", "expected"),
    [
        (1.71, ">= 1.7", False),
        (1.69, ">= 1.7", True),
        (0.0, "= 0", False),
        (1.0, "= 0", True),
        (math.nan, "<= 4", True),
        (5.0, "about 0", False),
        (5.0, "", False),
    ],
)
def test_what_is_missed(value, wanted, expected):
    assert Figure("a figure", value, "", wanted).missed == expected


def test_lost_flights_and_other_bytes_count(tmp_path):
    bags = [tmp_path / f"{name}.mcap" for name in "abc"]
    alone = [tmp_path / f"alone_{bag.name}" for bag in bags]
    for path, content in zip(alone, (b"one", b"two", b"six"), strict=True):
        path.write_bytes(content)
    made = [str(alone[0]), str(alone[2]), None]
    flights = [{"input": str(bag), "output": out} for bag, out in zip(bags, made, strict=True)]
    assert different({"flights": flights}, alone, bags) == 2
