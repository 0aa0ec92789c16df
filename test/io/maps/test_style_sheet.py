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
"""Style sheets: each key, labels and conditions, and the messages for wrong ones."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, strategies as st
from map_files import UTM33_PRJ
from project import PROJECT

from tirgeo_ros.core.map.vector_map import LayerStyle
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.maps.layers import read_layers as load_layers
from tirgeo_ros.io.maps.style_sheet import Condition, LabelRule, load_style_sheet, own_names

SHEET = """
layers:
  - file: roads.gpkg
    layer: roads
    colour: "#ffd000"
    width: 2
    fill: Navy
    fill_opacity: 0.5
    label: name
    scale: [0, 2.5]
    crs: EPSG:25832
    sigma: 0.2
    where: kind == road and lanes >= 2
  - label: false
    scale: [0.5, .inf]
    crs: 32633
    sigma: 1
  - {}
"""


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "style.yaml"
        path.write_text(text, "utf-8")
        return path

    return write


def test_every_key(written, tmp_path):
    full, some, empty = load_style_sheet(written(SHEET))
    assert full.style == LayerStyle(
        line_bgr=(0, 208, 255),
        width_px=2,
        fill_bgr=(128, 0, 0),
        fill_opacity=0.5,
        labels=True,
        scale_m_px=(0.0, 2.5),
    )
    assert (full.file, full.layer) == (tmp_path / "roads.gpkg", "roads")
    assert (full.crs, full.sigma_m, full.label.fields) == ("EPSG:25832", 0.2, ("name",))
    assert full.condition.fields == ("kind", "lanes")
    assert (some.condition, empty.condition) == (None, None)
    assert some.style == LayerStyle(labels=False, scale_m_px=(0.5, math.inf))
    assert (some.crs, some.sigma_m, some.file, some.layer) == ("EPSG:32633", 1.0, None, "")
    assert (empty.style, empty.label, empty.crs, empty.sigma_m) == (LayerStyle(), None, "", None)


def test_a_file_with_the_system(written, tmp_path):
    (tmp_path / "site.prj").write_text(UTM33_PRJ)
    (entry,) = load_style_sheet(written("layers: [{crs: site.prj}]"))
    assert (entry.crs, entry.crs_file) == (UTM33_PRJ, tmp_path / "site.prj")


BAD = {
    "no list": ("layers: 3", "not a style sheet: it needs a list under layers:"),
    "no layers": ("layers: []", "the list of layers is empty"),
    "root": ("layers: [{}]\nlayer: 3", "unknown key layer .did you mean layers"),
    "no keys": ("layers: [roads.gpkg]", "layer 1: is not a mapping of keys"),
    "unknown": ("layers: [{}, {color: red}]", r"layer 2: unknown key color \(did you mean colour"),
    "file": ("layers: [{file: }]", "layer 1: file has no value"),
    "width": ("layers: [{width: 6}]", "layer 1: width: 6 px is outside 1 to 5"),
    "comment": ("layers:\n- colour: #ffd000", "layer 1: colour has no value; .* needs quotes"),
    "colour": ("layers: [{colour: reddish}]", "layer 1: colour: 'reddish' is not a colour"),
    "no fill": ("layers: [{fill_opacity: 0.5}]", "layer 1: fill_opacity without fill"),
    "nan": ("layers: [{sigma: .nan}]", "layer 1: sigma: "),
    "scale": ("layers: [{scale: [2, 1]}]", "layer 1: scale: .* must be two numbers, the smaller"),
    "label": ("layers: [{label: true}]", "layer 1: label: True is neither a field nor false"),
    "format": ("layers: [{label: '{b'}]", "layer 1: label: '{b' is not a label"),
    "crs": ("layers: [{crs: EPSG:1}]", "layer 1: crs: unknown .* system 'EPSG:1'"),
    "where": ("layers: [{where: kind}]", "layer 1: where: 'kind' is not a condition; write it as"),
    "prj": ("layers: [{crs: a.prj}]", "layer 1: crs: .*a.prj: cannot be read"),
}


@pytest.mark.parametrize("case", BAD)
def test_each_error_is_named(written, case):
    text, message = BAD[case]
    path = written(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load_style_sheet(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_an_absent_sheet(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        load_style_sheet(tmp_path / "absent.yaml")


def test_the_example_sheet_draws_the_sample_map():
    """Each layer has features, each feature is in one layer, and there are no notes."""
    root = PROJECT
    sheet, path = root / "config/styles/rescue.yaml", root / "bags/sample/map.geojson"
    layers = load_layers(str(path), str(sheet))
    groups = [{f.group for f in layer.features} for layer in layers]
    features = json.loads(path.read_text())["features"]
    kinds = [features[min(group)]["properties"]["kind"] for group in groups]
    assert kinds == ["bed", "path", "hydrant"]
    assert sum(map(len, groups)) == len(features)
    assert set().union(*groups) == set(range(len(features)))
    assert [layer.left_out for layer in layers] == [()] * 3
    assert len({layer.style.line_bgr for layer in layers}) == 3


ROW = {
    "kind": "hydrant",
    "flow": 60.0,
    "Ref": "07",
    "main street": "A-1",
    "open": True,
    "no": None,
}


def by_wanted(rule, row):
    """The properties of a table by the names that a rule has for them."""
    return {name: row[own] for name, own in own_names(rule.fields, list(row)).items()}


def holds(text, row=ROW):
    condition = Condition.parsed(text, "s.yaml: layer 1: where")
    return condition.holds(by_wanted(condition, row))


HOLDS = [
    "kind == hydrant",
    'kind == "hydrant"',
    "kind != pump",
    "kind in [pump, hydrant]",
    "flow == 6e1",
    "flow >= 60 and flow <= 60 and kind == hydrant",
    "flow > 59.5",
    "ref == 7",
    "REF == '07'",
    "Ref < 8",
    "'main street' == A-1",
    "open == true",
    "open > 0",
    "absent != 5",
    "absent == ''",
]
FAILS = [
    "kind == Hydrant",
    "kind == hydrant and flow > 60",
    "ref == '7'",
    "flow == '60.0'",
    "absent in [5, 6]",
    "absent >= 0",
    "kind in [pump]",
]


@pytest.mark.parametrize("text", [*HOLDS, *FAILS])
def test_conditions_that_hold_and_that_do_not(text):
    assert holds(text) is (text in HOLDS)


BAD_CONDITIONS = [
    "",
    "kind",
    "kind = hydrant",
    "kind == a b",
    "kind == a or kind == b",
    "kind == aand flow == 60",
    "kind > hydrant",
    "kind in []",
    "kind in [a b]",
    "kindin [hydrant]",
    "kind == __import__('os')",
]


@pytest.mark.parametrize("text", BAD_CONDITIONS)
def test_texts_that_are_not_conditions(text):
    with pytest.raises(ConfigError, match="is not a condition; write it as") as caught:
        Condition.parsed(text, "s.yaml: layer 1: where")
    assert str(caught.value).startswith(f"s.yaml: layer 1: where: {text!r} is not a condition; ")


def test_a_condition_that_is_too_long():
    with pytest.raises(ConfigError, match="layer 1: where: longer than 1000 characters"):
        Condition.parsed("kind in [" + "a," * 500 + "a]", "s.yaml: layer 1: where")


@given(st.text(st.sampled_from("ab1 =!<>[],'\"and.in\n"), max_size=60))
def test_any_text_is_a_condition_or_an_error(text):
    try:
        assert holds(text) in {True, False}
    except ConfigError as error:
        assert "is not a condition" in str(error)  # noqa: PT017  either outcome is right


def text(rule, properties):
    return rule.text(by_wanted(rule, properties))


@pytest.mark.parametrize(
    ("value", "label"),
    [
        ("  Grünfläche 花坛\t", "Grünfläche 花坛"),
        (7, "7"),
        (7.0, "7"),
        (7.25, "7.25"),
        (float("nan"), ""),
        (None, ""),
        (True, "True"),
        (b"\0\1", ""),
        ("two\r\nlines\0and\u2028more", "two lines and more"),
        ("half \ud800 pair", "half  pair"),
        ([1, 2], "[1, 2]"),
    ],
)
def test_values(value, label):
    assert text(LabelRule.of_field("name"), {"name": value}) == label


def test_fields_in_other_capitals_and_absent_ones():
    rule = LabelRule.of_field("name")
    assert text(rule, {"NAME": "a"}) == "a"
    assert text(rule, {"NAME": "a", "name": "b"}) == "b"
    assert text(rule, {"title": "a"}) == ""
    assert text(LabelRule.of_field(""), {"": "a"}) == ""


def test_templates():
    rule = LabelRule.parsed("{name} no. {addr:ref} ", "s.yaml")
    assert text(rule, {"name": "a", "addr:ref": 3}) == "a no. 3"
    assert text(rule, {"name": "a", "addr:ref": None}) == "a no."
    assert text(rule, {"name": None, "addr:ref": ""}) == ""


def test_an_unknown_field_of_a_sheet():
    rule = LabelRule.parsed("{nmae}", "s.yaml: layer 1: label")
    message = r"^s.yaml: layer 1: label: a.map has no field 'nmae' \(did you mean name\?\)"
    with pytest.raises(ConfigError, match=message):
        rule.check(["name", "ref"], "a.map")
    with pytest.raises(ConfigError, match="has no field 'nmae': it has none"):
        rule.check([], "a.map")
