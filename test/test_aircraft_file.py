"""config/m600_xt2.yaml holds every parameter with its unit, and all but places at the defaults."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
import yaml
from project import PROJECT

from tirgeo_ros.core.config import NODE_CONFIGS, AircraftConfig, DjiConfig
from tirgeo_ros.core.config.schema import parameters_of, values_of
from tirgeo_ros.io.parameters.parameter_file import load_config

AIRCRAFT = PROJECT / "config" / "m600_xt2.yaml"
NODES = ("bag_player", "dji_node", "ekf_node", "gimbal_node", "overlay_node")
TREE = yaml.safe_load(AIRCRAFT.read_text())
PLACES = load_config(AIRCRAFT, "dji_node", DjiConfig).aircraft


@pytest.mark.parametrize("node", NODES)
def test_the_aircrafts_file_holds_every_parameter_at_its_default(node):
    kind = NODE_CONFIGS[node]
    given = load_config(AIRCRAFT, node, kind)
    if hasattr(given, "aircraft"):
        assert given.aircraft == PLACES
        given = replace(given, aircraft=AircraftConfig())
    # repr, since NaN is not equal to itself
    assert repr(given) == repr(kind())
    section = TREE[f"/**/{node}"]["ros__parameters"]
    assert list(flat(section)) == [name for name in values_of(kind()) if not is_of_all(name)]


def is_of_all(name):
    return name.startswith("aircraft.")


def flat(section, prefix=""):
    for key, value in section.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key


def test_the_aircrafts_places_are_said_once_with_djis_antennas_across():
    section = TREE["/**"]["ros__parameters"]
    assert list(flat(section)) == [p.name for p in parameters_of(DjiConfig) if is_of_all(p.name)]
    assert PLACES.baseline_deg == 90.0
    assert 1.0 <= float(abs(PLACES.baseline_b[1])) <= 1.2
    assert "MEASURE YOURS" in AIRCRAFT.read_text()


@pytest.mark.parametrize("node", ["", *NODES])
def test_the_comment_above_each_parameter_tells_its_unit(node):
    start = f"\n/**/{node}:".replace("/:", ":")
    text = AIRCRAFT.read_text().partition(start)[2].partition("\n/**/")[0]
    comments = re.findall(r"((?:^ *#.*\n)+) *(\w+): \S", text, re.MULTILINE)
    told = [(name, comment) for comment, name in comments]
    kind = NODE_CONFIGS[node or "dji_node"]
    parameters = [p for p in parameters_of(kind) if is_of_all(p.name) is (node == "")]
    assert [name for name, _ in told] == [item.name.rpartition(".")[2] for item in parameters]
    for parameter, (_, comment) in zip(parameters, told, strict=True):
        assert not parameter.unit or f"[{parameter.unit}]" in comment, parameter.name
