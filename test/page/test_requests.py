"""Requests: what is not exactly one is refused, by name and in plain words."""

from __future__ import annotations

import contextlib
import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tirgeo_ros.page.actions import RequestError, read_request

ID = "0123456789abcdef" * 2
CLICK = {
    "type": "click",
    "request": "r1",
    "aircraft": "",
    "stamp_ns": "1700000000000000001",
    "u": 1,
    "v": 2.5,
    "kind": "person",
    "refine": None,
}
EDIT = {"type": "edit", "request": "r2", "id": ID, "was": {"note": ""}}
MEASURE = {"type": "measure", "request": "r3", "from": [48.0, 16.0], "to": [48, 17]}


def test_a_request_is_read_with_its_name_and_types():
    name, kind, fields = read_request(json.dumps(CLICK))
    assert (name, kind) == ("r1", "click")
    assert fields["stamp_ns"] == 1_700_000_000_000_000_001
    assert isinstance(fields["u"], float)
    edit = read_request(json.dumps({**EDIT, "note": "a\nb"}))[2]
    assert edit == {"id": ID, "was": {"note": ""}, "note": "a\nb"}
    pasted = {**EDIT, "name": "Team\t7\r\n"}  # the store makes spaces of these
    assert read_request(json.dumps(pasted))[2]["name"] == "Team\t7\r\n"
    undo = {"type": "undo", "request": "r"}
    assert read_request(json.dumps(undo))[2] == {}
    assert read_request(json.dumps({**undo, "id": ID}))[2] == {"id": ID}
    assert read_request(json.dumps(MEASURE))[2]["to"] == (48.0, 17.0)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({**CLICK, "u": True}, "u must be a number"),
        ({**CLICK, "u": "1"}, "u must be a number"),
        ({**CLICK, "u": 1e300}, "u must be a number from -100000 to 100000"),
        ({**CLICK, "u": 10**400}, "u must be a number"),
        ({**CLICK, "stamp_ns": 17}, "stamp_ns must be a text of digits"),
        ({**CLICK, "stamp_ns": "-1"}, "stamp_ns must be a text of digits"),
        ({**CLICK, "stamp_ns": "9999999999999999999"}, "stamp_ns must be a text of digits"),
        ({**CLICK, "stamp_ns": "\u0661"}, "stamp_ns must be a text of digits"),
        ({**CLICK, "kind": "tank"}, "kind must be one of person, "),
        ({**CLICK, "kind": ["person"]}, "kind must be one of person, "),
        ({**CLICK, "refine": "../x"}, "refine must be the id of a target"),
        ({**CLICK, "aircraft": "a" * 101}, "aircraft must be a text"),
        ({**CLICK, "extra": 1}, "click has no field extra"),
        ({**EDIT, "id": None}, "id must be the id of a target"),
        ({**EDIT, "name": "a\0b"}, "name must be a text without control characters"),
        ({**EDIT, "was": {"name": 1}}, "was must be an object of texts: what each field was"),
        ({"type": "edit", "request": "r", "id": ID, "name": "x"}, "edit lacks was"),
        ({**EDIT, "name": "a" * 101}, "name must be a text of 0 to 100 characters"),
        ({**EDIT, "note": "\ud800"}, "note must be a text without control characters"),
        ({**MEASURE, "to": [91, 0]}, "to must be a number from -90 to 90"),
        ({**MEASURE, "to": [0, 0, 0]}, r"to must be \[latitude, longitude\]"),
        ({**MEASURE, "type": "__init__"}, "type must be one of click, edit"),
        ({**MEASURE, "type": ["click"]}, "type must be one of click, edit"),
        ({"type": "delete", "request": "r", "id": ID}, "delete lacks was"),
        ({"type": "record", "request": "r", "aircraft": "", "on": 1}, "on must be true or false"),
    ],
)
def test_a_wrong_field_is_named(changed, words):
    with pytest.raises(RequestError, match=words) as error:
        read_request(json.dumps(changed))
    assert error.value.request == changed["request"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x",
        "[]",
        "null",
        "{}",
        "[" * 60_000,
        '{"a":' * 10_000,
        '{"request": 1, "type": "undo"}',
        '{"request": "", "type": "undo"}',
        json.dumps(CLICK).replace("2.5", "NaN"),
        json.dumps(CLICK).replace("2.5", "1e999"),
        json.dumps(CLICK).replace("2.5", "9" * 5000),
    ],
)
def test_what_is_no_request_is_refused(text):
    with pytest.raises(RequestError):
        read_request(text)


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)


@settings(max_examples=40)
@given(st.sampled_from([CLICK, EDIT, MEASURE]), st.data(), ANYTHING)
def test_no_value_does_harm(good, data, value):
    field = data.draw(st.sampled_from(sorted(good)))
    with contextlib.suppress(RequestError):
        assert len(read_request(json.dumps({**good, field: value}))) == 3
