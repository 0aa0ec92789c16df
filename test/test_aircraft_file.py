"""config/m600_xt2.yaml holds every parameter at its default, each with its unit."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.parameter import parameters_of, values_of
from tirgeo_ros.io.parameter_file import load_config

AIRCRAFT = Path(__file__).resolve().parents[1] / "config" / "m600_xt2.yaml"
NODES = ("bag_player", "dji_node", "ekf_node", "gimbal_node", "overlay_node")


@pytest.mark.parametrize("node", NODES)
def test_the_aircrafts_file_holds_every_parameter_at_its_default(node):
    kind = NODE_CONFIGS[node]
    # repr, since NaN is not equal to itself
    assert repr(load_config(AIRCRAFT, node, kind)) == repr(kind())
    section = yaml.safe_load(AIRCRAFT.read_text())[f"/**/{node}"]["ros__parameters"]
    assert list(flat(section)) == list(values_of(kind()))


def flat(section, prefix=""):
    for key, value in section.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key


@pytest.mark.parametrize("node", NODES)
def test_the_comment_above_each_parameter_tells_its_unit(node):
    text = AIRCRAFT.read_text().partition(f"/**/{node}:")[2].partition("\n/**/")[0]
    comments = re.findall(r"((?:^ *#.*\n)+) *(\w+): \S", text, re.MULTILINE)
    told = [(name, comment) for comment, name in comments]
    parameters = list(parameters_of(NODE_CONFIGS[node]))
    assert [name for name, _ in told] == [item.name.rpartition(".")[2] for item in parameters]
    for parameter, (_, comment) in zip(parameters, told, strict=True):
        assert not parameter.unit or f"[{parameter.unit}]" in comment, parameter.name
