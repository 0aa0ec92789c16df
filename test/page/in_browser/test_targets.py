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
"""Targets on the page in a real browser: status, filter, merging; the map beside the video."""

from __future__ import annotations

import asyncio
import json
import queue
from itertools import pairwise

import numpy as np
import pytest
from browser import DESK, FINGER_PX, LEVEL, PHONE, TABLET
from page_backend import EAST_M, GROUND_M, LATITUDE, LONGITUDE, NORTH_M, SIGMA_M
from served_page import corner_in, well

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.page.actions import Actions, RequestError

COVARIANCE = tuple(np.diag(SIGMA_M).ravel() ** 2)
#: Hebrew, Arabic, Chinese, an emoji, markup.
NAMES = ["אנה", "محمد", "消防栓", "\U0001f525 Halle", "<b>x</b>"]
#: The number of painted pixels on all tiles of the vector map; nan until all tiles are drawn.
_PAINTED = """() => {
  const tiles = [...document.querySelectorAll(".vector-tiles canvas")];
  if (!tiles.every(({ classList }) => classList.contains("leaflet-tile-loaded"))) return NaN;
  return tiles.reduce((sum, tile) => {
    const { data } = tile.getContext("2d").getImageData(0, 0, tile.width, tile.height);
    return sum + data.filter((value, k) => k % 4 === 3 && value > 0).length;
  }, 0);
}"""
_CLUSTERS = """async ([targets, zoom, alone]) => {
  const { clustersOf } = await import("/static/js/map/clusters.js");
  return clustersOf(targets, zoom, alone).map(({ members }) => members.map(({ id }) => id));
}"""


@pytest.fixture(autouse=True)
def all_is_well(monkeypatch):
    well(monkeypatch)


@pytest.fixture
def with_targets(serve):
    """Serve a page with targets at places east and north of the middle, m, of some kinds."""

    def begin(*places, kinds=("person",), names=("",)):
        page = serve()
        for k, (east_m, north_m) in enumerate(places):
            at = LATITUDE + north_m / NORTH_M, LONGITUDE + east_m / EAST_M
            texts = {"kind": kinds[k % len(kinds)], "name": names[k % len(names)]}
            click = Located(k + 1, *at, GROUND_M, COVARIANCE)
            page.backend.targets.add(click, now_ns=k + 1, **texts)
        page.stop()
        page.start()  # which tells pages of all targets
        return page

    return begin


def test_a_status_is_set_on_the_card_and_the_list_is_filtered_and_says_so(with_targets, tablet):
    page = with_targets((0, 0), (9, 0), (18, 0), kinds=("person", "fire", "fire"))
    screen = tablet(page.url)
    screen.reads("#target-list h2", "3 targets")
    screen.expected = "status of 404"  # these have no picture
    screen.tap_on(".row[data-target]", has_text="Person")
    screen.tap_on("#target-card .kind[data-status=found]")
    screen.reads("#toast", "changed")
    assert page.targets[0].status == "found"
    screen.tap_on("#target-card .plain")
    screen.tap_on("#filter")
    screen.tap_on(".filter [data-status=found]")
    screen.reads("#target-list h2", "1 of 3 targets")
    screen.tap_on(".filter [data-kind=fire]")
    screen.reads("#target-list h2", "0 of 3 targets")
    screen.reads(".nothing", "No target passes the filter: it hides 3.")
    screen.reload()
    screen.reads("#target-list h2", "0 of 3 targets")
    screen.tap_on(".nothing button", has_text="Show all")
    screen.reads("#target-list h2", "3 targets")


def test_a_target_that_the_filter_hides_says_so_when_it_is_set(serve, tablet):
    screen = tablet(serve().url)
    screen.tap_on("#filter")
    screen.tap_on(".filter [data-kind=fire]")
    screen.tap(*screen.on_screen(*corner_in(screen.hold_still())))
    screen.reads("#toast", "filter hides it")


def test_a_second_press_on_a_place_may_be_the_same_target(serve, tablet):
    page = serve()
    screen = tablet(page.url)
    place = screen.on_screen(*corner_in(screen.hold_still()))
    screen.tap(*place)
    screen.reads("#toast", "Target 1 set")
    screen.tap(*place)
    screen.tap_on(".answer .same", has_text="Same as 1 Person?")
    screen.reads("#toast", "Target 2 is now part of 1.")
    (target,) = page.targets
    assert (target.number, len(target.clicks)) == (1, 2)
    screen.tap_on("#toast .primary", has_text="Undo")
    screen.wait("() => document.querySelectorAll('.rows .row').length === 2")
    assert [len(one.clicks) for one in page.targets] == [1, 1]


def test_a_press_again_on_something_else_says_that_the_presses_disagree(serve, tablet):
    """It was said to be averaged, in green; the card's own words are often out of sight."""
    screen = tablet(serve().url)
    screen.hold_still()
    screen.tap(*screen.on_screen(100, 300))
    screen.tap_on(".row")
    screen.tap_on("#refine")
    screen.one(".refining").wait_for()
    screen.tap(*screen.on_screen(500, 300))
    screen.reads("#toast", "Target 1 averaged over 2 presses. Their presses disagree.")


def test_a_card_merges_with_another_target_of_a_list_nearest_first(with_targets, tablet):
    page = with_targets((0, 0), (90, 0), (30, 0), names=("Anna", "far", "near"))
    screen = tablet(page.url)
    screen.expected = "status of 404"
    screen.tap_on(".row[data-target]", has_text="Anna")
    screen.tap_on(".merge > button")
    screen.shows(".merge-rows .row", 2)
    offered = screen.page.locator(".merge-rows .row").all_inner_texts()
    assert [text.split()[1] for text in offered] == ["near", "far"]
    screen.tap_on(".merge-rows .row", has_text="near")
    screen.reads("#toast", "Target 1 is now part of 3. Their presses disagree.")
    assert [(one.number, len(one.clicks)) for one in page.targets] == [(2, 1), (3, 2)]


def test_a_card_whose_target_another_one_takes_away_says_so(with_targets, tablet):
    """Press again ends with it, also if the target comes back."""
    page = with_targets((0, 0))
    screen = tablet(page.url)
    screen.expected = "status of 404"
    screen.tap_on(".row[data-target]")
    screen.tap_on("#refine")
    screen.reads(".refining", "Press on 1 Person again")
    page.backend.targets.delete(page.targets[0].id, now_ns=9)
    page.server.targets_changed()
    screen.reads("#toast", "Target 1 is no longer in the list")
    page.backend.targets.undo()
    page.server.targets_changed()
    screen.shows(".row[data-target]", 1)
    screen.shows(".refining", 0)


def test_a_text_that_was_refused_stays_while_others_are_saved(with_targets, tablet, monkeypatch):
    async def edit(actions, id, was, **words):  # noqa: A002 as sent
        if "note" in words:
            raise RequestError("too many requests at once: wait a moment")
        return await all_edits(actions, id, was, **words)

    all_edits = Actions._edit
    monkeypatch.setattr(Actions, "_edit", edit)
    page = with_targets((0, 0))
    screen = tablet(page.url)
    screen.expected = "status of 404"
    screen.tap_on(".row[data-target]")
    note, name = screen.one("textarea"), screen.one("#target-card input")
    note.fill("at the old mill")
    note.blur()
    screen.reads(".texts .said", "Not saved: too many requests")
    name.press_sequentially("Anna")
    name.blur()
    screen.reads("#toast", "Target 1 changed")
    assert [target.name for target in page.targets] == ["Anna"]
    assert note.input_value() == "at the old mill"
    screen.reads(".texts .said", "Not saved: too many requests")
    monkeypatch.setattr(Actions, "_edit", all_edits)
    note.fill("at the new mill")
    note.blur()
    screen.wait("() => document.querySelector('.texts .said').hidden")
    assert [target.note for target in page.targets] == ["at the new mill"]


def test_the_code_on_the_card_is_of_the_place_that_the_card_shows(with_targets, tablet):
    """Also after one press was taken back and another came: there are two presses as before."""
    page = with_targets((0, 0))
    screen = tablet(page.url)
    screen.expected = "status of 404"
    screen.tap_on(".row[data-target]")
    (target,) = page.targets
    for north_m in (5, 50):
        click = Located(9, LATITUDE + north_m / NORTH_M, LONGITUDE, GROUND_M, COVARIANCE)
        page.backend.targets.refine(target.id, click, now_ns=9)
        with screen.page.expect_response(lambda answer: "/qr?" in answer.url):
            page.server.targets_changed()
        page.backend.targets.undo()


def test_a_long_name_covers_nothing_beside_it(with_targets, tablet):
    page = with_targets((0, 0), (30, 0), names=("Feuerwehrgeraetehaus" * 5,))
    screen = tablet(page.url, PHONE)
    screen.expected = "status of 404"
    screen.tap_on(".row[data-target]")
    screen.tap_on(".merge > button")
    name = screen.one(".merge-rows strong").bounding_box()
    away = screen.one(".merge-rows .mono", has_text="30.0 m").bounding_box()
    assert name["x"] + name["width"] <= away["x"]
    screen.tap_on("#refine")
    name = screen.one(".refining strong").bounding_box()
    assert name["x"] + name["width"] <= screen.one(".refining button").bounding_box()["x"]
    assert name["height"] < 2 * FINGER_PX
    assert screen.faults() == []


def test_targets_too_near_on_the_map_are_a_number_that_comes_nearer(with_targets, tablet):
    page = with_targets((0, 0), (3, 0), (0, 3), (300, 0), names=NAMES)
    screen = tablet(page.url, LEVEL)
    screen.tap_on("#swap")
    screen.tap_on("[aria-label='Show everything']")
    screen.reads(".map-cluster", "3")
    screen.tap_on(".map-cluster")
    screen.wait("() => document.querySelectorAll('.map-target .badge').length >= 3")
    screen.shows(".map-cluster", 0)
    screen.wait("() => document.querySelectorAll('.map-label .of-target').length >= 1")
    assert set(screen.page.locator(".of-target").all_inner_texts()) <= set(NAMES)


def test_a_target_that_is_to_be_shown_while_the_map_zooms_is_shown(with_targets, tablet):
    page = with_targets((400, 0))
    screen = tablet(page.url, DESK)
    screen.page.evaluate(_SHOW_WHILE_ZOOMING, page.targets[0].id)
    screen.wait(_IS_IN_THE_MIDDLE)


_SHOW_WHILE_ZOOMING = """async (id) => {
  const { store } = await import("/static/js/store.js");
  const pane = document.querySelector(".leaflet-map-pane");
  await new Promise((done) => {
    const watch = new MutationObserver(() => {
      if (!pane.matches(".leaflet-zoom-anim")) return;
      watch.disconnect();
      done(store.set({ shown: { id } }));
    });
    watch.observe(pane, { attributes: true });
    document.querySelector("[aria-label='Zoom out']").click();
  });
}"""
_IS_IN_THE_MIDDLE = """() => {
  const middleOf = (part) => {
    const box = document.querySelector(part)?.getBoundingClientRect();
    return box ? [box.x + box.width / 2, box.y + box.height / 2] : [NaN, NaN];
  };
  const [map, target] = ["#map", ".map-target"].map(middleOf);
  return Math.hypot(map[0] - target[0], map[1] - target[1]) < 30;
}"""


def test_names_on_the_map_are_text_as_typed_and_do_not_cover_each_other(with_targets, tablet):
    places = [(40 * k - 80, 0) for k in range(5)]
    screen = tablet(with_targets(*places, names=NAMES).url, LEVEL)
    screen.tap_on("#swap")
    screen.tap_on("[aria-label='Show everything']")
    labels = screen.wait(f"() => ((all) => all.length === 5 && all)(({_NAMES_ON_THE_MAP})())")
    assert sorted(text for text, *_ in labels) == sorted(NAMES)
    sides = sorted((left, right) for _, left, right in labels)
    assert all(right <= other for (_, right), (other, _) in pairwise(sides))


_NAMES_ON_THE_MAP = """() => [...document.querySelectorAll(".of-target")].map((label) => {
  const { left, right } = label.getBoundingClientRect();
  return [label.innerText, left, right];
})"""


def test_the_map_can_be_the_large_one_and_stays_so(serve, tablet):
    screen = tablet(serve().url, LEVEL)
    screen.await_picture()
    boxes = "() => ['map-area', 'stages'].map((id) => document.getElementById(id).clientWidth)"
    map_px, video_px = screen.page.evaluate(boxes)
    assert map_px < video_px
    screen.tap_on("#swap")
    screen.wait(f"() => (([map, video]) => map > video)(({boxes})())")
    screen.reload()
    screen.await_picture()
    map_px, video_px = screen.page.evaluate(boxes)
    assert map_px > video_px
    assert screen.faults() == []
    screen.page.keyboard.press("s")
    screen.wait(f"() => (([map, video]) => map < video)(({boxes})())")


def test_a_measurement_is_in_the_screens_units_and_ends_with_its_button(
    serve, tablet, monkeypatch
):
    """Also on a slow link, where its answer comes when it is over."""
    waiting = queue.SimpleQueue()

    async def measure(actions, from_, to):
        await asyncio.to_thread(waiting.get)
        return await answered(actions, from_, to)

    answered = Actions._measure
    monkeypatch.setattr(Actions, "_measure", measure)
    well(monkeypatch, position=[LATITUDE, LONGITUDE, GROUND_M + 40])  # the map stays where it is
    screen = tablet(serve().url, LEVEL)
    screen.await_picture()
    screen.tap_on("#measure")
    for _ in range(2):
        for place in (90, 150):
            screen.one("#map").tap(position={"x": place, "y": place})
        waiting.put("")
        screen.reads(".map-said", " m at 135°")
    screen.set(units="feet")
    screen.reads(".map-said", " ft at 135°")
    for place in (90, 150):
        screen.one("#map").tap(position={"x": place, "y": place})
    screen.tap_on("#measure")
    waiting.put("")
    screen.page.wait_for_timeout(500)
    screen.shows(".map-said", 0)


def test_the_map_follows_the_aircraft_but_while_something_is_measured(serve, tablet, monkeypatch):
    """It moved between two presses, and under the second finger."""
    position = [LATITUDE, LONGITUDE, GROUND_M + 40]
    well(monkeypatch, position=position)
    screen = tablet(serve().url, LEVEL)
    screen.await_picture()
    top = screen.wait(_AIRCRAFT_TOP)
    screen.tap_on("#measure")
    position[0] += 400 / NORTH_M
    screen.wait(f"(top) => ({_AIRCRAFT_TOP})() < top - 100", top)
    screen.tap_on("#measure")
    screen.wait(f"(top) => ({_AIRCRAFT_TOP})() > top - 100", top)


_AIRCRAFT_TOP = "() => document.querySelector('.map-aircraft')?.getBoundingClientRect().top"


def test_a_layer_that_is_off_is_not_drawn_and_the_map_says_so(with_targets, tablet):
    page = with_targets((0, 0))
    features = json.loads(page.backend._map)
    for k, feature in enumerate(features["features"]):
        feature["properties"]["layer"] = "even" if k % 2 == 0 else "<i>odd</i>"
    page.backend._map = json.dumps(features).encode()
    screen = tablet(page.url, TABLET)
    screen.expected = "willReadFrequently"
    whole = screen.wait(f"() => ({_PAINTED})()")
    screen.tap_on("#layers")
    screen.tap_on(".map-layers button", has_text="<i>odd</i>")
    screen.wait(f"(whole) => ((n) => n > 0 && n < 0.7 * whole)(({_PAINTED})())", whole)
    screen.tap_on(".map-layers button", has_text="even")
    screen.reads(".map-words", "The map\N{RIGHT SINGLE QUOTATION MARK}s layers are off")
    assert screen.wait(f"() => ({_PAINTED})() === 0")
    screen.tap_on(".map-layers button", has_text="Targets")
    screen.reads(".map-words", "Targets are off")
    screen.shows(".map-target", 0)
    assert screen.faults() == []


def test_the_button_of_the_layers_shows_only_what_is_off_on_this_map(serve, tablet):
    screen = tablet(serve().url)
    screen.set(layersOff=["of another map"])
    screen.tap_on("#layers")
    screen.one(".map-layers [data-layer=labels]").wait_for()
    screen.shows("#layers:not(.active)", 1)
    screen.tap_on(".map-layers [data-layer=labels]")
    screen.shows("#layers.active", 1)


def test_a_map_that_is_not_there_or_not_here_says_so(serve, tablet):
    page = serve()
    whole, page.backend._map = page.backend._map, b""
    screen = tablet(page.url)
    screen.reads(".map-words", "There is no map: only aircraft and targets")
    page.backend._map = whole.replace(b"16.3", b"17.3")
    screen.reload()
    screen.reads(".map-words", "The map does not reach here")


def test_clusters_hold_each_target_once_and_the_chosen_one_is_alone(serve, tablet):
    screen = tablet(serve().url)
    rng = np.random.default_rng(5)
    places = rng.normal((LATITUDE, LONGITUDE), 1e-3, (300, 2))
    targets = [
        {"id": str(k), "latitude_deg": float(lat), "longitude_deg": float(lon)}
        for k, (lat, lon) in enumerate(places)
    ]
    for zoom in (3, 14, 17.5, 19.5, 20):
        groups = screen.page.evaluate(_CLUSTERS, [targets, zoom, "7"])
        assert sorted(int(k) for group in groups for k in group) == list(range(300))
        assert ["7"] in groups
        assert (len(groups) == 300) == (zoom >= 20)
        if zoom == 3:
            assert len(groups) == 2
