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
"""The states that pages get, and the requests that they may send."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tirgeo_ros.page.actions import RequestError, read_request
from tirgeo_ros.page.state_hub import Outbox, StateHub, Track, plain


async def take(outbox):
    return json.loads(await asyncio.wait_for(outbox.take(), 10))


def test_a_slow_page_gets_the_newest_state_and_the_whole_track():
    async def run():
        hub, outbox = StateHub(lambda *_: 12.0), Outbox()
        hub.join(outbox, "me")
        for k in range(20):
            hub.report("", {"k": k, "track": [[k, 0]]})
        return await take(outbox)

    reports = asyncio.run(run())
    assert reports["k"] == 19
    assert reports["latency_ms"] == 12.0
    assert (reports["track_from"], len(reports["track"])) == (0, 20)


def test_states_go_out_at_most_at_5_hz():
    async def run():
        hub, outbox = StateHub(lambda *_: None), Outbox()
        hub.join(outbox, "me")
        loop, begun, observed = asyncio.get_running_loop(), asyncio.get_running_loop().time(), []
        while loop.time() - begun < 1.0:
            hub.report("", {"k": len(observed)})
            try:
                observed.append(json.loads(await asyncio.wait_for(outbox.take(), 0.01)))
            except asyncio.TimeoutError:
                continue
        return observed

    assert 1 <= len(asyncio.run(run())) <= 7


def test_a_new_page_gets_all_states_and_targets():
    async def run():
        hub, outbox = StateHub(lambda *_: None), Outbox()
        hub.change_targets({})
        hub.report("a", {"track": [[k, 0] for k in range(700)]})
        hub.report("b", {})
        hub.join(outbox, "me")
        before = [await take(outbox) for _ in range(3)]
        hub.report("a", {})
        return [*before, await take(outbox)]

    targets, first, other, rest = asyncio.run(run())
    assert targets == {"type": "targets", "whole": True, "more": False, "gone": [], "targets": []}
    assert (first["aircraft"], first["track_from"], len(first["track"])) == ("a", 0, 500)
    assert (other["aircraft"], other["track"]) == ("b", [])
    assert (rest["aircraft"], rest["track_from"], len(rest["track"])) == ("a", 500, 200)


def test_a_newcomer_gets_the_targets_in_parts_and_then_what_changes():
    async def run():
        hub, outbox = StateHub(lambda *_: None), Outbox()
        hub.join(outbox, "me")
        hub.change_targets({f"{k}": f"[{k}]" for k in range(70)})
        first = await take(outbox)
        hub.report("a", {})
        await asyncio.sleep(0.01)  # the state does not wait for all targets
        hub.change_targets({"0": "", "1": "[1.5]"})
        rest = [await take(outbox) for _ in range(2)]
        hub.change_targets({"2": "[2.5]"})
        hub.change_targets({})
        hub.change_targets({"2": "[2.6]", "3": "[3.5]"})
        rest.append(await take(outbox))
        later = Outbox()
        hub.join(later, "another")
        observed = [await take(later), await take(later), await take(later)]
        return first, rest, observed, len(outbox._newest)

    first, (second, state, third), observed, waiting = asyncio.run(run())
    assert (first["whole"], first["more"], first["targets"]) == (
        True,
        True,
        [[k] for k in range(50)],
    )
    assert (second["whole"], second["more"], second["gone"]) == (False, False, ["0"])
    assert second["targets"] == [*([k] for k in range(50, 70)), [1.5]]
    assert state["type"] == "state"
    assert (third["gone"], third["targets"]) == ([], [[2.6], [3.5]])
    parts = [item for item in observed if item["type"] == "targets"]
    assert [item["whole"] for item in parts] == [True, False]
    assert sorted([*parts[0]["targets"], *parts[1]["targets"]]) == sorted(
        [*([k] for k in range(4, 70)), [1.5], [2.6], [3.5]]
    )
    assert not parts[0]["gone"]  # everybody knows
    assert waiting == 0


def test_answers_come_first_and_all():
    async def run():
        outbox = Outbox()
        outbox.put("state", lambda: '{"type": "state"}')
        outbox.answer({"k": 1})
        outbox.answer({"k": 2})
        return [await take(outbox) for _ in range(3)]

    assert asyncio.run(run()) == [{"k": 1}, {"k": 2}, {"type": "state"}]


def test_a_track_keeps_its_indices_when_it_is_cut_and_begins_anew_with_the_node():
    track = Track()
    for k in range(0, 30_000, 100):
        track.add([[k + i, 0] for i in range(100)], k)
    assert track.after(0) == (10_000, [[k, 0] for k in range(10_000, 10_500)])
    assert track.after(29_999) == (29_999, [[29_999, 0]])
    track.add([[1, 1]], 0)
    assert track.after(0) == (0, [[1, 1]])


def test_a_page_gets_the_changed_part_of_a_track_again():
    """As after the track was thinned, or with a new flight."""

    async def run():
        hub, outbox = StateHub(lambda *_: None), Outbox()
        hub.join(outbox, "me")
        reports = []
        for track, start in (([[k, 0] for k in range(5)], 0), ([[9, 9]], 2), ([], 1)):
            hub.report("a", {"track": track, "track_from": start})
            reports.append(await take(outbox))
        return [(item["track_from"], item["track"]) for item in reports]

    whole, changed, shorter = asyncio.run(run())
    assert (whole[0], len(whole[1])) == (0, 5)
    assert changed == (2, [[9, 9]])
    assert shorter == (1, [])


@pytest.mark.parametrize("value", [math.nan, math.inf, np.float64("nan")])
def test_a_number_that_is_not_finite_is_null(value):
    given = {"a": [value, (1, "x")], "b": np.float32(2), "c": np.bool_(1)}
    assert json.dumps(plain(given)) == '{"a": [null, [1, "x"]], "b": 2.0, "c": true}'


def test_what_has_no_json_is_an_error_of_the_node():
    with pytest.raises(TypeError, match="ndarray has no JSON"):
        plain({"a": np.zeros(3)})


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
        ({**CLICK, "extra": 1}, "click has an unknown field extra"),
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
def test_a_malformed_request_is_refused(text):
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
