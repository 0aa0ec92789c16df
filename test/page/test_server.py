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
"""The page's server as a browser uses it: video, states, targets, files."""

from __future__ import annotations

import asyncio
import gzip
import json
import math
from contextlib import closing
from threading import current_thread
from unittest.mock import Mock

import aiohttp
import cv2
import numpy as np
import pytest
from page_backend import HEIGHT, WIDTH, Pictures, pixel_of, place_at
from page_clients import Page, Served, ServedApart, next_picture, tile_file

from tirgeo_ros.core.config.viewer_parameters import ViewerConfig
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.types.errors import PageError
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.page import routes, video as video_module
from tirgeo_ros.page.server import PageServer
from tirgeo_ros.page.video import HEADER

WORDS = {"kind": "other", "note": ""}
STAMP_NS = 10**18


def test_video_comes_untouched_to_a_quick_viewer_with_its_stamp_and_size(served):
    async def look():
        async with Page(served.url) as page, page.video() as video:
            before = 0
            for _ in range(3000):  # on a busy machine it takes a while
                data = (await asyncio.wait_for(video.receive(), 30)).data
                number = int.from_bytes(data[16:20], "little")
                assert number > before
                before = number
                await video.send_str(f"shown {number}")
                stamp_ns = int.from_bytes(data[:8], "little")
                shapes_bytes = int.from_bytes(data[24:28], "little")
                if data[HEADER.size + shapes_bytes :] == pictures.jpeg(stamp_ns):
                    return np.frombuffer(data, "<u2", 2, 20).tolist()
            return None

    pictures = Pictures()
    assert asyncio.run(look()) == [640, 512]


def test_a_viewer_whose_picture_fails_can_come_back(served, monkeypatch, caplog):
    """As without memory for it: the page opens a lost connection again, but not a silent one."""

    async def look():
        types = []
        async with Page(served.url) as page:
            while aiohttp.WSMsgType.BINARY not in types:
                async with page.video() as video:
                    types.append((await asyncio.wait_for(video.receive(), 10)).type)
                monkeypatch.undo()
                await asyncio.sleep(0.1)  # until another picture
        return types

    monkeypatch.setattr(video_module, "_smaller", Mock(side_effect=cv2.error("no memory")))
    assert asyncio.run(asyncio.wait_for(look(), 30))[0] is aiohttp.WSMsgType.CLOSE
    assert "a viewer's video begins anew" in caplog.text


def test_a_click_is_a_target_for_all_pages_and_on_the_disk(served):
    async def click():
        async with (
            Page(served.url) as item,
            item.state() as mine,
            item.video() as video,
            Page(served.url) as other,
            other.state() as theirs,
        ):
            stamp_ns, _ = await next_picture(video)
            answer = await mine.click(stamp_ns, 400.5, 300.25, kind="fire")
            target = answer["target"]
            both = [
                await page.until("targets", lambda told: target in told["targets"])
                for page in (mine, theirs)
            ]
            assert both[0] == both[1]
            picture = await other.get(f"/targets/{target['id']}/picture")
            code = await other.get(f"/targets/{target['id']}/qr")
            return stamp_ns, target, picture, code

    stamp_ns, target, picture, code = asyncio.run(click())
    place = place_at(stamp_ns, 400.5, 300.25)
    assert (target["latitude_deg"], target["longitude_deg"]) == pytest.approx(place, abs=1e-9)
    assert target["kind"] == "fire"
    assert target["coordinates"]["decimal"] == f"{place[0]:.6f}, {place[1]:.6f}"
    assert target["ellipse"]["major_m"] == pytest.approx(0.5 * 2.4477, rel=1e-3)
    assert target["outline"][0] == target["outline"][-1]
    assert target["height_msl_m"] is None
    assert served.backend.targets.get(target["id"]).kind == "fire"
    assert picture[0] == code[0] == 200
    assert cv2.imdecode(np.frombuffer(picture[1], np.uint8), 1).shape == (160, 160, 3)
    assert b"<svg" in code[1]


def test_a_picture_that_stood_still_on_a_screen_is_cut_out_later(served):
    async def click():
        async with Page(served.url) as page, page.state() as state:
            async with page.video() as video:
                stamp_ns, _ = await next_picture(video)
            for at in range(150):  # more than the feed keeps
                served.server.show("", stamp_ns + 1 + at, jpeg)
            target = (await state.click(stamp_ns))["target"]
            return await page.get(f"/targets/{target['id']}/picture")

    jpeg = Pictures().jpeg(0)
    assert asyncio.run(click())[0] == 200


def test_one_goes_back_to_a_whole_picture_with_its_shapes(tmp_path):
    """The message has what came together, at full size; one that is gone is 404."""

    async def go_back():
        async with Page(served.url) as page:
            for k in range(3):
                served.server.show("b", STAMP_NS + k * 10**8, jpeg, shapes=b"shapes %d" % k)
            listed = json.loads((await page.get("/frames/b"))[1])["stamps_ns"]
            one = await page.get(f"/frame/b/{STAMP_NS + 10**8}")
            return listed, one, (await page.get("/frame/b/77"))[0]

    jpeg = Pictures().jpeg(0)
    with Served(tmp_path, parked=("b",)) as served:
        listed, (status, body), gone = asyncio.run(go_back())
    assert listed == [str(STAMP_NS + k * 10**8) for k in range(3)]
    assert (status, gone) == (200, 404)
    stamp_ns, _, _, width, height, size = HEADER.unpack_from(body)
    assert (stamp_ns, width, height) == (STAMP_NS + 10**8, WIDTH, HEIGHT)
    assert body[HEADER.size :] == b"shapes 1" + jpeg
    assert size == len(b"shapes 1")


def test_refine_edit_delete_undo_and_refusals_are_answered(served):
    async def ask():
        async with Page(served.url) as page, page.state() as state, page.video() as video:
            stamp_ns, _ = await next_picture(video)
            first = (await state.click(stamp_ns))["target"]
            again = await state.click(stamp_ns, 321.0, refine=first["id"])
            was = {"kind": "person", "name": "", "note": ""}
            id_ = {"id": first["id"], "was": was}
            edit = await state.ask("edit", **id_, name="Anna", note="two\nlines")
            other = await state.ask("delete", **id_)
            was |= {"name": "Anna", "note": "two\nlines"}
            gone = await state.ask("delete", **id_)
            lost = await state.ask("edit", **id_, name="Berta")
            back = await state.ask("undo", id=first["id"])
            sky = await state.click(stamp_ns, v=1.0)
            listed = await state.until("targets", lambda told: len(told["targets"]) > 0)
            return again, edit, other, gone, lost, back, sky, listed

    again, edit, other, gone, lost, back, sky, _ = asyncio.run(ask())
    assert again["target"]["clicks"] == 2
    assert (edit["target"]["name"], edit["target"]["note"]) == ("Anna", "two\nlines")
    assert other["reason"] == "it was changed meanwhile: look at it, then delete it"
    assert gone["ok"]
    assert lost["reason"] == "it was deleted meanwhile; your text is kept with it"
    assert back["ok"]
    assert "is back" in back["text"]
    assert not sky["ok"]
    assert sky["reason"] == "the ray does not meet the ground"


def test_a_second_press_is_near_the_first_and_both_can_be_one(served):
    async def ask():
        async with Page(served.url) as page, page.state() as state, page.video() as video:
            stamp_ns, _ = await next_picture(video)
            first = await state.click(stamp_ns, 500.0, 200.0)
            second = await state.click(stamp_ns, 508.0, 200.0)  # 0.8 m, sigmas of 0.3 and 0.5 m
            away = await state.click(stamp_ns, 560.0, 200.0)
            ids = {"id": second["target"]["id"], "into": first["target"]["id"]}
            merged = await state.ask("merge", **ids)
            again = await state.ask("merge", **ids)
            undone = await state.ask("undo", id=ids["into"])
            was = {"status": "new"}
            found = await state.ask("edit", id=ids["id"], was=was, status="found")
            wrong = await state.ask("edit", id=ids["id"], was=was, status="lost")
            return first, second, away, merged, again, undone, found, wrong

    first, second, away, merged, again, undone, found, wrong = asyncio.run(ask())
    assert [first["near"], away["near"]] == [[], []]
    assert second["near"] == [first["target"]["id"]]
    assert merged["target"]["clicks"] == 2
    assert again["reason"] == "there is no such target; perhaps it was deleted"
    numbers = [answer["target"]["number"] for answer in (first, second)]
    words = "target {} as before; target {} is back"
    assert undone["text"] == words.format(*numbers)
    assert found["target"]["status"] == "found"
    assert wrong["reason"] == "edit: status must be one of new, checked, found, dismissed"


def test_a_click_never_waits_for_the_disk_in_the_video_s_thread(served, monkeypatch):
    """The store is locked while another change is written, which takes long on a slow card."""
    store, threads = served.backend.targets, set()
    kept = store.all
    monkeypatch.setattr(store, "all", lambda: (threads.add(current_thread().name), kept())[1])

    async def ask():
        async with Page(served.url) as page, page.state() as state, page.video() as video:
            stamp_ns, _ = await next_picture(video)
            return await state.click(stamp_ns, 500.0, 200.0)

    assert asyncio.run(ask())["ok"]
    assert threads
    assert "page" not in threads


def test_codes_are_made_beside_the_video(served, monkeypatch):
    """Each takes milliseconds, and a viewer may ask for 60 a second."""
    made, threads = routes.segno.make, set()

    def make(uri, **how):
        threads.add(current_thread().name)
        return made(uri, **how)

    async def ask():
        async with Page(served.url) as page, page.state() as state, page.video() as video:
            target = (await state.click((await next_picture(video))[0]))["target"]
            known = await page.get(f"/targets/{target['id']}/qr")
            return known, await page.get("/targets/none/qr")

    monkeypatch.setattr(routes.segno, "make", make)
    (known, code), (unknown, _) = asyncio.run(ask())
    assert (known, code[:5], unknown) == (200, b"<?xml", 404)
    assert threads
    assert "page" not in threads


def test_what_needs_no_target_is_answered(served):
    async def ask():
        async with Page(served.url) as page, page.state() as state, page.video() as video:
            await next_picture(video)
            latitude, longitude = place_at(served.backend.newest_ns[""], 320, 256)
            return (
                await state.ask(
                    "where", aircraft="", latitude_deg=latitude, longitude_deg=longitude
                ),
                await state.ask("where", aircraft="", latitude_deg=0, longitude_deg=0),
                await state.ask("measure", **{"from": [48.0, 16.0], "to": [48.0, 16.1]}),
                await state.ask("record", aircraft="", on=True),
                await state.ask("record", aircraft="none", on=True),
                await state.ask("share", on=True),
                await state.ask("mark", text="smoke"),
            )

    where, far, measure, record, unknown, share, mark = asyncio.run(ask())
    latitude, longitude = place_at(int(where["stamp_ns"]), where["u"], where["v"])
    assert pixel_of(int(where["stamp_ns"]), latitude, longitude) == pytest.approx(
        (where["u"], where["v"])
    )
    assert far["reason"] == "it is outside the picture"
    # The parallel's arc, and half the meridians' convergence; the geodesic is 0.3 mm shorter.
    across_m = 6378137 / math.sqrt(1 - 0.00669438 * math.sin(math.radians(48)) ** 2)
    arc_m = across_m * math.cos(math.radians(48)) * math.radians(0.1)
    assert measure["distance_m"] == pytest.approx(arc_m, abs=0.01)
    assert measure["bearing_deg"] == pytest.approx(
        90 - 0.05 * math.sin(math.radians(48)), abs=1e-4
    )
    assert record["text"] == "recording"
    assert unknown["reason"] == "there is no such aircraft"
    assert share["text"] == "sharing"
    assert mark["ok"]
    assert "smoke" in [text for _, text in served.backend.targets.marks()]


def test_a_request_that_is_sent_again_is_done_once(served):
    async def ask():
        async with Page(served.url) as page, page.video() as video:
            stamp_ns, _ = await next_picture(video)
            answers = []
            for _ in range(2):  # the connection is lost in between
                async with page.state() as state:
                    name = "0123456789abcdef-1"
                    answers.append(await state.click(stamp_ns, request=name))
            return answers

    before = len(served.backend.targets.all())
    first, second = asyncio.run(ask())
    assert first == second
    assert len(served.backend.targets.all()) == before + 1


def test_states_come_with_the_whole_track_and_the_own_latency(served):
    async def look():
        async with Page(served.url) as page, page.state() as state, page.video() as video:
            hello = await state.until("hello")
            track = []
            for _ in range(60):
                for _ in range(6):
                    await next_picture(video)
                told = await state.until("state")
                assert told["track_from"] == len(track)
                track += told["track"]
                if told["latency_ms"] is not None and len(track) > 5:
                    return hello, told
            return None

    hello, state = asyncio.run(look())
    assert hello["role"] == "operator"
    assert hello["aircraft"] == [{"id": "", "name": "aircraft"}]
    assert state["latency_ms"] > 0
    assert state["verdict"]["word"] in {"GO", "LOST"}


def test_files_come_zipped_and_not_twice(served):
    async def look():
        async with Page(served.url, auto_decompress=False) as page:
            async with page.session.get(f"{served.url}/map/") as answer:
                body, tag = await answer.read(), answer.headers["ETag"]
                assert answer.headers["Content-Encoding"] == "gzip"
            again = await page.get("/map/", headers={"If-None-Match": tag})
            exports = [await page.get(f"/export/{form}") for form in ("geojson", "kml", "none")]
            return body, again, exports

    body, again, exports = asyncio.run(look())
    assert len(json.loads(gzip.decompress(body))["features"]) == 49
    assert again == (304, b"")
    assert [status for status, _ in exports] == [200, 200, 404]


def test_tiles_come_where_there_are_any(tmp_path):
    async def look():
        async with Page(item.url) as page, page.state() as state:
            hello = await state.until("hello")
            return hello, [await page.get(f"/tiles/{at}") for at in ("2/1/0", "2/1/3", "2/x/0")]

    with Served(tmp_path, tiles=str(tile_file(tmp_path / "a.mbtiles"))) as item:
        hello, answers = asyncio.run(look())
    assert hello["tiles"] == {"min": 2, "max": 5, "attribution": ""}
    assert answers[:2] == [(200, b"north"), (204, b"")]
    assert answers[2][0] == 404


def test_an_address_that_is_taken_is_named(served):
    config = ViewerConfig(listen=f"127.0.0.1:{served.port}")
    with pytest.raises(PageError, match=f"listen: 127.0.0.1:{served.port}: .*free port"):
        PageServer(served.backend, config, {"": "aircraft"}).start()


def test_wrong_files_are_named(served, tmp_path):
    pem = tmp_path / "wrong.pem"
    pem.write_text("no certificate")
    for wrong, words in (
        ({"certificate": str(pem)}, "certificate: .*wrong.pem"),
        ({"certificate": str(tmp_path / "absent.pem")}, "certificate: .*absent.pem"),
        ({"tiles": str(pem)}, "tiles: .*wrong.pem: .*MBTiles"),
    ):
        server = PageServer(served.backend, ViewerConfig(listen="127.0.0.1:0", **wrong), {})
        with pytest.raises(PageError, match=words):
            server.start()


def test_an_edit_sends_the_targets_that_changed_alone(tmp_path):
    """Of 2000 with long notes the whole list is 30 MB, for each page."""

    async def edit():
        async with Page(item.url) as page, page.state() as state:
            listed = []
            while len(listed) < 60:
                part = await state.until("targets")
                listed += part["targets"]
            last = listed[59]
            await state.ask("edit", id=last["id"], was={"name": ""}, name="Anna")
            edited = await state.until("targets")
            await state.ask("delete", id=last["id"], was={"name": "Anna"} | WORDS)
            gone = await state.until("targets")
            await state.ask("undo")
            return last, edited, gone, await state.until("targets")

    with Served(tmp_path) as item:
        place = Located(1, 48.0, 16.0, 190.0, (1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0))
        for now_ns in range(60):
            item.backend.targets.add(place, now_ns=now_ns)
        item.server.targets_changed()
        last, edited, gone, back = asyncio.run(edit())
    assert [(target["id"], target["name"]) for target in edited["targets"]] == [
        (last["id"], "Anna")
    ]
    assert (gone["gone"], gone["targets"]) == ([last["id"]], [])
    assert (back["gone"], back["targets"]) == ([], edited["targets"])


def test_undo_is_answered_whatever_the_journal_holds(tmp_path):
    async def ask():
        async with Page(item.url) as page, page.state() as state:
            result = [await asyncio.wait_for(state.ask("undo"), 20) for _ in range(2)]
            item.backend.targets.undo = None  # a fault of this program
            return *result, await asyncio.wait_for(state.ask("undo"), 20)

    with Served(tmp_path) as item:
        store = item.backend.targets
        edited = store.add(Located(1, 48.0, 16.0, 190.0, (1.0,) * 9), now_ns=1)
        store.edit(edited.id, 2, name="Anna")
        store._db.execute("UPDATE tirgeo_changes SET before = substr(before, 2)")
        damaged, again, fault = asyncio.run(ask())
    assert not damaged["ok"]
    assert damaged["reason"].startswith("the record of the last change is damaged")
    assert (again["ok"], again["text"]) == (True, "target 1 removed again")
    assert not fault["ok"]
    assert fault["reason"] == "a fault in this program: its log says where"


KILLS, EDITS = 20, 50


async def confirmed(url, process, target_id, name, first, kill_after):
    """Edit as fast as answers come, kill the server after some; return the last confirmed name."""
    async with (
        aiohttp.ClientSession(headers={"Origin": url}) as session,
        session.ws_connect(f"{url}/state") as state,
    ):
        for number in range(first, first + 2 * EDITS):
            edit = {"type": "edit", "request": f"e{number}", "id": target_id}
            await state.send_json({**edit, "was": {"name": name}, "name": f"edit {number}"})
            if number == first + kill_after:  # this one is on its way, or being written
                await asyncio.sleep(0.0005 * (kill_after % KILLS))
                process.kill()
            async for message in state:
                told = message.json()
                if told["type"] == "answer" and told["request"] == f"e{number}":
                    assert told["ok"], told
                    name = f"edit {number}"
                    break
            else:
                return name
    return name


@pytest.mark.slow
def test_twenty_kills_during_a_thousand_edits_lose_no_confirmed_one(tmp_path):
    file = tmp_path / "targets.gpkg"
    with closing(TargetStore(file)) as store:
        place = Located(1, 48.0, 16.0, 0.0, (1, 0, 0, 0, 1, 0, 0, 0, 1))
        target_id, name = store.add(place, now_ns=1).id, ""
    for kill in range(KILLS):
        with ServedApart("--targets", file) as page:
            words = page.url, page.process, target_id, name, 1000 * kill, EDITS - 10 + kill
            last = asyncio.run(confirmed(*words))
        assert last != name
        with closing(TargetStore(file)) as store:
            name = store.get(target_id).name
        # The one that was on its way may be there too.
        result = int(name.removeprefix("edit "))
        assert result - int(last.removeprefix("edit ")) in {0, 1}
