"""States: the newest goes out, at most at 5 Hz, and nothing of a track is lost."""

from __future__ import annotations

import asyncio
import json
import math

import numpy as np
import pytest

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

    told = asyncio.run(run())
    assert told["k"] == 19
    assert told["latency_ms"] == 12.0
    assert (told["track_from"], len(told["track"])) == (0, 20)


def test_states_go_out_at_most_at_5_hz():
    async def run():
        hub, outbox = StateHub(lambda *_: None), Outbox()
        hub.join(outbox, "me")
        loop, begun, seen = asyncio.get_running_loop(), asyncio.get_running_loop().time(), []
        while loop.time() - begun < 1.0:
            hub.report("", {"k": len(seen)})
            try:
                seen.append(json.loads(await asyncio.wait_for(outbox.take(), 0.01)))
            except asyncio.TimeoutError:
                continue
        return seen

    assert 1 <= len(asyncio.run(run())) <= 7


def test_a_newcomer_gets_all_there_is():
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
        seen = [await take(later), await take(later), await take(later)]
        return first, rest, seen, len(outbox._newest)

    first, (second, state, third), seen, waiting = asyncio.run(run())
    assert (first["whole"], first["more"], first["targets"]) == (
        True,
        True,
        [[k] for k in range(50)],
    )
    assert (second["whole"], second["more"], second["gone"]) == (False, False, ["0"])
    assert second["targets"] == [*([k] for k in range(50, 70)), [1.5]]
    assert state["type"] == "state"
    assert (third["gone"], third["targets"]) == ([], [[2.6], [3.5]])
    parts = [one for one in seen if one["type"] == "targets"]
    assert [one["whole"] for one in parts] == [True, False]
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


def test_a_page_gets_again_what_of_a_track_has_changed():
    """As after the track was thinned, or with a new flight."""

    async def run():
        hub, outbox = StateHub(lambda *_: None), Outbox()
        hub.join(outbox, "me")
        told = []
        for track, start in (([[k, 0] for k in range(5)], 0), ([[9, 9]], 2), ([], 1)):
            hub.report("a", {"track": track, "track_from": start})
            told.append(await take(outbox))
        return [(one["track_from"], one["track"]) for one in told]

    whole, changed, shorter = asyncio.run(run())
    assert (whole[0], len(whole[1])) == (0, 5)
    assert changed == (2, [[9, 9]])
    assert shorter == (1, [])


@pytest.mark.parametrize("value", [math.nan, math.inf, np.float64("nan")])
def test_a_number_that_is_none_is_unknown(value):
    given = {"a": [value, (1, "x")], "b": np.float32(2), "c": np.bool_(1)}
    assert json.dumps(plain(given)) == '{"a": [null, [1, "x"]], "b": 2.0, "c": true}'


def test_what_has_no_json_is_an_error_of_the_node():
    with pytest.raises(TypeError, match="ndarray has no JSON"):
        plain({"a": np.zeros(3)})
