"""Conditions on properties: what each comparison takes, and what is none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.maps.style_condition import Condition

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


@pytest.mark.parametrize(
    "text",
    [
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
        "absent != 5",
        "absent == ''",
    ],
)
def test_what_holds(text):
    assert holds(text)


@pytest.mark.parametrize(
    "text",
    [
        "kind == Hydrant",
        "kind == hydrant and flow > 60",
        "ref == '7'",
        "flow == '60.0'",
        "open > 0",
        "absent in [5, 6]",
        "absent >= 0",
        "kind in [pump]",
    ],
)
def test_what_does_not_hold(text):
    assert not holds(text)


BAD = {
    "": "it ends where a property should stand",
    "kind": "it ends where ==, !=, <, <=, >, >= or in should stand",
    "kind = hydrant": "= stands where ==, !=",
    "kind == ": "it ends where a value should stand",
    "kind == a b": "b stands where and should",
    "kind == a or kind == b": "or stands where and should",
    "kind == a and": "it ends where a property",
    "kind > hydrant": "> needs a number, and hydrant is none",
    "kind in a": "a stands where \\[ should",
    "kind in []": "\\] stands where a value should",
    "kind in [a b]": "b stands where , or \\] should",
    "kind in [a, b": "it ends where , or \\] should",
    "kind == 'a": "' stands where a value should",
    "== a": "== stands where a property should",
    "kind == __import__('os')": "'os' stands where and should|stands where and",
}


@pytest.mark.parametrize("text", BAD)
def test_what_is_none(text):
    with pytest.raises(ConfigError, match=BAD[text]) as caught:
        Condition.parsed(text, "s.yaml: layer 1: where")
    assert str(caught.value).startswith(f"s.yaml: layer 1: where: {text!r} is no condition: ")


def test_a_condition_that_is_too_long():
    with pytest.raises(ConfigError, match="layer 1: where: longer than 1000 characters"):
        Condition.parsed("kind in [" + "a," * 500 + "a]", "s.yaml: layer 1: where")


def test_the_values_that_there_are_so_far_as_they_are_few():
    rows = [{"kind": f"k{number}"} for number in range(9)]
    condition = Condition.parsed("kind == a", "s")
    told = condition.unmet(["kind"], rows, "m")
    assert told == "s: no feature of m is so: kind is k0, k1, k2, k3, k4, k5, ..."


@given(st.text(st.sampled_from("ab1 =!<>[],'\"and.in\n"), max_size=60))
def test_any_text_is_a_condition_or_an_error(text):
    try:
        assert holds(text) in {True, False}
    except ConfigError as error:
        assert "is no condition" in str(error)  # noqa: PT017  either outcome is right
