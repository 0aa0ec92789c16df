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
"""The operator's page in a real browser: what it shows, and a target's life."""

from __future__ import annotations

import asyncio
import json
import queue
import sqlite3

import pytest
from browser import DESK, LEVEL, PHONE, TABLET
from page_backend import GO, GROUND_M, LATITUDE, LONGITUDE, M_PER_PIXEL, SimulatedBackend
from page_clients import tile_file
from playwright.sync_api import expect
from served_page import ELLIPSE, corner_in, corner_on, off_corner, press, well

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.targets.store import MOST_NAME

FINDING = {"subject": "no fix", "evidence": "1 for 5 s", "parameter": "rtk/fix", "remedy": "wait"}


@pytest.fixture(autouse=True)
def all_is_well(monkeypatch):
    well(monkeypatch)


def still_with_corner(screen):
    """Hold a picture in which a plot is seen wholly; return where its corner is on the screen."""
    while True:
        screen.hold_still()
        picture, left, top = screen.video()
        corner = corner_on(picture)
        if corner is not None:
            return left + corner[0], top + corner[1]
        screen.tap_on("#still")
        screen.page.wait_for_timeout(1000)


def test_it_loads_and_the_video_moves(serve, tablet):
    """No complaint and no request to elsewhere: the fixture looks at its end."""
    screen = tablet(serve().url)
    first_ns = screen.await_picture()
    assert screen.await_picture(first_ns + 500_000_000) > first_ns
    screen.reads("#verdict", "GO")
    screen.reads(".latency", "ms")


def test_a_press_on_an_outline_is_a_target_within_its_ellipse(serve, tablet):
    page = serve()
    screen = tablet(page.url)
    screen.tap_on(".kind[data-kind=fire]")
    screen.tap(*still_with_corner(screen))
    screen.reads(".answer", "21.5 °C")
    screen.reads(".row", "1")
    (target,) = page.targets
    off_m, chi_square = off_corner(target)
    assert chi_square < ELLIPSE
    assert off_m < 3 * screen.shown_pixel() * M_PER_PIXEL
    assert target.kind == "fire"
    screen.tap_on(".row")
    assert screen.one("input[aria-label=Name]").get_attribute("maxlength") == str(MOST_NAME)
    screen.reads(".value[data-form=decimal]", f"{target.place.latitude_deg:.6f}")
    assert screen.one(".picture").evaluate("(image) => image.decode().then(() => true)")
    assert screen.one(".qr").evaluate("(image) => image.decode().then(() => true)")


def test_a_map_that_was_simplified_says_so(serve, tablet):
    page = serve()
    page.backend._map = page.backend._map.replace(b"{", b'{"simplified": "20 of 49 shapes", ', 1)
    tablet(page.url).reads(".map-words", "Map simplified: 20 of 49 shapes")


def test_record_waits_for_its_answer_and_says_a_refusal(serve, tablet, monkeypatch):
    answers = queue.SimpleQueue()
    asked = []

    async def record(backend, aircraft, on):
        asked.append(on)
        if refusal := await asyncio.to_thread(answers.get):
            raise BagError(refusal)
        backend.recording[aircraft] = on
        return "recording"

    monkeypatch.setattr(SimulatedBackend, "record", record)
    screen = tablet(serve().url)
    screen.await_picture()
    for refusal in ("the disk is full", ""):
        screen.tap_on("#record")
        screen.reads("#record", "Wait")
        screen.one("#record").tap(force=True)
        answers.put(refusal)
        screen.reads("#toast", refusal or "Recording")
    assert asked == [True, True]
    screen.wait("() => document.querySelector('#record').ariaPressed === 'true'")


def test_keys_work_after_a_press_on_the_map_but_those_that_move_it(serve, tablet):
    screen = tablet(serve().url, DESK)
    screen.await_picture()
    screen.one("#map").click(position={"x": 90, "y": 90})
    screen.page.keyboard.press("ArrowLeft")
    assert screen.page.locator(".cursor").get_attribute("hidden") is not None
    screen.page.keyboard.press("2")
    screen.reads("#tools [aria-checked=true]", "fire")
    screen.page.keyboard.press("n")
    screen.wait("() => document.documentElement.dataset.theme === 'red'")


def test_keys_work_after_a_slider_was_moved_but_those_that_move_it(serve, tablet):
    """Space led to no live video after a mouse had been on the bar of a still picture."""
    screen = tablet(serve().url, DESK)
    screen.hold_still()
    screen.wait("() => !document.querySelector('#rewind input').disabled")
    screen.one("#rewind input").click()
    screen.page.keyboard.press("ArrowLeft")
    assert screen.page.locator(".cursor").get_attribute("hidden") is not None
    screen.page.keyboard.press("2")
    screen.reads("#tools [aria-checked=true]", "fire")
    screen.page.keyboard.press(" ")
    screen.shows("#rewind", 0)
    screen.tap_on("#look-button")
    screen.one("#look input").click()
    screen.page.keyboard.press("Escape")
    screen.shows("#look", 0)


def test_keys_work_with_caps_lock_and_on_a_german_keyboard(serve, tablet):
    """The help shows capital letters, and says that Shift and a comma go back by a second."""
    screen = tablet(serve().url, DESK)
    screen.await_picture(screen.await_picture() + 1_500_000_000)
    stamp_ns = screen.hold_still()
    screen.page.evaluate(_KEY, ["N"])
    screen.wait("() => document.documentElement.dataset.theme === 'red'")
    screen.page.evaluate(_KEY, [";"])  # Shift and a comma
    screen.until(_IS_BEFORE, str(stamp_ns - 500_000_000))  # far more than a picture


def test_a_french_keyboard_needs_no_shift_for_a_kind_and_zooms_with_its_minus(serve, tablet):
    screen = tablet(serve().url, DESK)
    screen.await_picture()
    screen.page.evaluate(_KEY, ["é", "Digit2"])
    screen.reads("#tools [aria-checked=true]", "fire")
    screen.page.evaluate(_KEY, ["-", "Digit6"])
    screen.page.evaluate(_KEY, ["n", "KeyN"])  # what comes after it has come: so has it
    screen.wait("() => document.documentElement.dataset.theme === 'red'")
    screen.reads("#tools [aria-checked=true]", "fire")


_KEY = """([key, code = ""]) => {
  document.body.dispatchEvent(new KeyboardEvent("keydown", { key, code, bubbles: true }));
}"""
_IS_BEFORE = """async (stamp) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  return BigInt(stageOf("").frame.stampNs) < BigInt(stamp);
}"""


@pytest.mark.parametrize(("row", "words"), [("#aircraft", "two"), ("#tools", "fire")])
def test_what_a_key_selects_keeps_the_focus(serve, tablet, row, words):
    """It was lost, and the next press of the key was on the video."""
    screen = tablet(serve("one", "two").url)
    screen.one(f"{row} [role=radio]", has_text=words).press(" ")
    screen.reads(f"{row} [aria-checked=true]", words)
    screen.page.keyboard.press(" ")
    assert screen.page.evaluate("() => document.activeElement.textContent") == words
    assert screen.page.locator("#still").get_attribute("aria-pressed") == "false"


def test_a_key_that_is_held_down_presses_once_and_moves_on(serve, tablet):
    page = serve()
    screen = tablet(page.url, DESK)
    screen.hold_still()
    screen.one("#still").blur()
    cursor, places = screen.page.locator(".cursor"), set()
    for key in ("ArrowLeft", "Enter"):
        for _ in range(4):
            screen.page.keyboard.down(key)
            places.add(cursor.evaluate("(node) => node.style.transform"))
        screen.page.keyboard.up(key)
    assert len(places) == 4
    screen.reads("#toast", "Target 1 set")
    screen.page.wait_for_timeout(500)
    assert len(page.targets) == 1


@pytest.mark.slow
def test_a_press_that_lasts_is_one(serve, tablet):
    page = serve()
    screen = tablet(page.url)
    place = screen.on_screen(*corner_in(screen.hold_still()))
    screen.page.mouse.move(*place)
    screen.page.mouse.down()
    screen.page.wait_for_timeout(1500)
    screen.page.mouse.up()
    screen.reads(".row", "1")


@pytest.mark.slow
def test_tiles_are_enlarged_where_the_map_is_nearer_than_they_are(serve, tablet, tmp_path):
    path = tile_file(tmp_path / "a.mbtiles")
    with sqlite3.connect(path) as db:
        db.execute("insert into metadata values ('attribution', '<a href=x>&copy; Survey</a>')")
    db.close()
    screen = tablet(serve(tiles=str(path)).url, DESK)
    screen.wait("() => document.querySelector('img.leaflet-tile')?.src.includes('/tiles/5/')")
    screen.reads(".map-credit", "\N{COPYRIGHT SIGN} Survey")
    assert screen.page.locator(".map-credit a").count() == 0


def test_a_kind_that_the_server_has_no_more_is_not_remembered(serve, tablet):
    screen = tablet(serve().url)
    screen.tap_on(".kind[data-kind=fire]")
    screen.reads("#tools [aria-checked=true]", "fire")
    kept = "localStorage.setItem('tirgeo', localStorage.getItem('tirgeo').replace('fire', 'boat'))"
    screen.page.evaluate(kept)
    screen.reload()
    screen.reads("#tools [aria-checked=true]", "person")
    press(screen)


def test_a_press_into_the_sky_says_why_not(serve, tablet):
    page = serve()
    screen = tablet(page.url)
    screen.await_picture()
    _, left, top = screen.video()
    screen.tap(left + 400, top + 20)
    screen.reads(".answer", "the ray does not meet the ground")
    assert page.targets == []


@pytest.mark.slow
def test_a_target_is_named_deleted_brought_back_and_handed_over(serve, tablet, tmp_path):
    page = serve()
    screen = tablet(page.url)
    press(screen)
    screen.tap_on(".row")
    screen.one("input[aria-label=Name]").fill("Zwei Personen <b>")
    screen.one("textarea[aria-label=Note]").fill("am Ufer")
    screen.tap_on("#target-card .kind[data-kind=person]")
    screen.reads("#toast", "changed")
    screen.tap_on("#delete")
    screen.reads("#toast", "deleted")
    screen.wait("() => document.querySelectorAll('.row').length === 0")
    screen.tap_on("#undo")
    screen.reads(".row", "Zwei Personen <b>")
    (target,) = page.targets
    assert (target.name, target.note, target.kind) == ("Zwei Personen <b>", "am Ufer", "person")
    screen.tap_on("#export")
    file = screen.download(lambda: screen.tap_on(".exports a[href$=geojson]"), tmp_path)
    points = [
        feature
        for feature in json.loads(file.read_text())["features"]
        if feature["geometry"]["type"] == "Point"
    ]
    place = (target.place.longitude_deg, target.place.latitude_deg)
    assert points[0]["geometry"]["coordinates"][:2] == pytest.approx(place, abs=1e-8)
    assert "Zwei Personen" in str(points[0]["properties"])


@pytest.mark.parametrize(
    "size",
    [
        pytest.param(PHONE, id="phone"),
        pytest.param(TABLET, id="tablet", marks=pytest.mark.slow),
        pytest.param(LEVEL, id="tablet on its side", marks=pytest.mark.slow),
        pytest.param(DESK, id="desk", marks=pytest.mark.slow),
    ],
)
def test_everything_fits_a_glove_hits_it_and_axe_finds_no_fault(serve, tablet, monkeypatch, size):
    page = serve()
    screen = tablet(page.url, size)
    press(screen)
    assert screen.faults() == []
    for tap in (
        "#still",
        "#look-button",
        "#look .switch",
        "#look-button",
        "#export",
        ".row",
        "#refine",
        "#record",
        "[data-tab=checks]",
        *(["[data-tab=map]"] if size == PHONE else []),
    ):
        screen.tap_on(tap)
        assert screen.faults() == [], tap
    for word, tone in (("CAUTION", "caution"), ("LOST", "bad")):
        findings = [FINDING | {"severity": severity} for severity in ("STOP", "CAUTION", "NOTE")]
        verdict = {**GO, "word": word, "tone": tone, "kind": "position", "alarm": tone == "bad"}
        verdict |= {"text": f"{word}: no RTK", "more": "rtk/fix"}
        well(monkeypatch, verdict=verdict, findings=findings)
        screen.reads("#banner", verdict["text"])
        assert screen.faults() == [], word
    screen.expected = "WebSocket connection|ERR_CONNECTION"
    page.stop()
    screen.reads("#banner", "Connection lost")
    assert screen.faults() == []
    page.start()
    screen.tap_on("#menu-button")
    screen.one("#menu").wait_for()
    screen.page.keyboard.press("Escape")
    screen.tap_on("#help-button")
    assert screen.faults() == []


@pytest.mark.slow
def test_an_old_edit_takes_nothing_from_a_newer_one(serve, tablet):
    """Tablet A writes without a connection, B writes later; A comes back."""
    page = serve()
    first, second = tablet(page.url), tablet(page.url)
    first.expected = "WebSocket connection|ERR_|Failed to load"
    press(first)
    note = "textarea[aria-label=Note]"
    for screen in (first, second):
        screen.tap_on(".row")
    first.context.set_offline(True)
    first.reads("#banner", "Connection lost")
    first.one(note).fill("on the shore")
    first.one(note).blur()
    second.one(note).fill("found alive, medic needed")
    second.one(note).blur()
    second.reads("#toast", "changed")
    first.context.set_offline(False)
    first.reads("#toast", "both texts: choose")
    for screen in (first, second):
        screen.reads(".choice .other", "on the shore")
        expect(screen.one(note)).to_have_value("found alive, medic needed")
        assert screen.faults() == []
    second.tap_on(".choice button", has_text="Keep both")
    first.wait("() => !document.querySelector('.choice')")
    expect(first.one(note)).to_have_value("found alive, medic needed\non the shore")
    second.tap_on("#toast button", has_text="Undo")
    first.tap_on(".choice button", has_text="Leave out")
    second.wait("() => !document.querySelector('.choice')")
    assert [target.note for target in page.targets] == ["found alive, medic needed"]
    first.one(note).fill("typed while the other deletes")
    second.tap_on("#delete")
    first.reads("#toast", "deleted meanwhile")
    first.tap_on("#toast button", has_text="Undo")
    second.tap_on(".row", has_text="choose a text")
    second.reads(".choice .other", "typed while the other deletes")


def test_many_targets_come_in_parts_and_a_change_moves_one(serve, tablet):
    """Also after the link was lost, which closes no card."""
    page = serve()
    store, place = page.backend.targets, Located(1, LATITUDE, LONGITUDE, GROUND_M, (1.0,) * 9)
    many = [store.add(place, now_ns=k) for k in range(120)]
    page.server.targets_changed()
    screen = tablet(page.url)
    screen.expected = "WebSocket|ERR_CONNECTION|404"  # they have no pictures
    screen.wait("() => document.querySelectorAll('.row').length === 120")
    screen.tap_on(".row")
    store.edit(many[0].id, 200, name="Anna")
    store.delete(many[1].id, 201)
    page.server.targets_changed()
    screen.wait("() => document.querySelectorAll('.row').length === 119")
    names = "() => [...document.querySelectorAll('.row strong')].map((one) => one.textContent)"
    assert screen.page.evaluate(names)[-1] == "Anna"
    page.stop()
    page.start()
    store = page.backend.targets
    store.undo()
    page.server.targets_changed()
    screen.wait("() => document.querySelectorAll('.row').length === 120")
    numbers = (
        "() => [...document.querySelectorAll('.row .badge b')].map((one) => +one.textContent)"
    )
    assert screen.page.evaluate(numbers) == [*range(120, 0, -1)]
    assert screen.one("#target-card h2").is_visible()
