"""Labels from properties: fields, templates, and values of all types."""

import pytest

from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.maps.label_rule import LabelRule


def text(rule, properties):
    return rule.text(rule.columns(list(properties), "a.map"), properties)


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
    rule = LabelRule.parsed("{{{name}}} no. {ref} ", "s.yaml")
    assert text(rule, {"name": "a", "ref": 3}) == "{a} no. 3"
    assert text(rule, {"name": "a", "ref": None}) == "{a} no."
    assert text(rule, {"name": None, "ref": ""}) == ""


def test_an_unknown_field_of_a_sheet():
    rule = LabelRule.parsed("{nmae}", "s.yaml: layer 1: label")
    message = r"^s.yaml: layer 1: label: a.map has no field 'nmae' \(did you mean name\?\)"
    with pytest.raises(ConfigError, match=message):
        rule.columns(["name", "ref"], "a.map")
    with pytest.raises(ConfigError, match="has no field 'nmae': it has none"):
        rule.columns([], "a.map")
