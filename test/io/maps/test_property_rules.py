"""Labels from properties, and conditions on them: what each takes, and what is none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.maps.style_sheet import Condition, LabelRule

ROW = {
    "kind": "hydrant",
    "flow": 60.0,
    "Ref": "07",
    "main street": "A-1",
    "open": True,
    "no": None,
}


def holds(text, row=ROW):
    condition = Condition.parsed(text, "s.yaml: layer 1: where")
    return condition.holds(condition.columns(row), row)


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
def test_what_holds_and_what_does_not(text):
    assert holds(text) is (text in HOLDS)


BAD = [
    "",
    "kind",
    "kind = hydrant",
    "kind == ",
    "kind == a b",
    "kind == a or kind == b",
    "kind == a and",
    "kind == aand flow == 60",
    "kind > hydrant",
    "kind in a",
    "kind in []",
    "kind in [a b]",
    "kind in [a, b",
    "kindin [hydrant]",
    "kind == 'a",
    "== a",
    "kind == __import__('os')",
]


@pytest.mark.parametrize("text", BAD)
def test_what_is_none(text):
    with pytest.raises(ConfigError, match="is no condition; write it as") as caught:
        Condition.parsed(text, "s.yaml: layer 1: where")
    assert str(caught.value).startswith(f"s.yaml: layer 1: where: {text!r} is no condition; ")


def test_a_condition_that_is_too_long():
    with pytest.raises(ConfigError, match="layer 1: where: longer than 1000 characters"):
        Condition.parsed("kind in [" + "a," * 500 + "a]", "s.yaml: layer 1: where")


@given(st.text(st.sampled_from("ab1 =!<>[],'\"and.in\n"), max_size=60))
def test_any_text_is_a_condition_or_an_error(text):
    try:
        assert holds(text) in {True, False}
    except ConfigError as error:
        assert "is no condition" in str(error)  # noqa: PT017  either outcome is right


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
