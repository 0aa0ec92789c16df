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
"""Still pictures at full size, and going back through the last two minutes."""

from __future__ import annotations

import re

import numpy as np
import pytest
from browser import DESK, LEVEL, PHONE, TABLET
from page_backend import GO, LOST, place_at
from served_page import ELLIPSE, corner_in, off_corner, press, well

from tirgeo_ros.page.server import PageServer

SIDE = (844, 390)  # a phone on its side
BAR = "#rewind [aria-label='{}']"


@pytest.fixture(autouse=True)
def all_is_well(monkeypatch):
    well(monkeypatch)


def shown_after(screen, stamp_ns, *, later=False):
    """Wait for another picture, before or after a stamp; return its stamp."""
    return int(screen.until(_OTHER, str(stamp_ns), later))


_OTHER = """async ([stamp, later]) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { held, frame } = stageOf("");
  if (held.fetching || held.words) return false;
  const step = BigInt(frame.stampNs) - BigInt(stamp);
  return (later ? step > 0n : step < 0n) && frame.stampNs;
}"""


def settle(screen):
    """Wait until the still picture has come at full size."""
    screen.until(_SETTLED)


_SETTLED = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { held, frame } = stageOf("");
  return held.stamps.length && !held.fetching && frame.bitmap.width === frame.width;
}"""


def held_after(screen, seconds):
    """Hold a picture still that comes so long after the first one; return its stamp."""
    first_ns = screen.await_picture()
    screen.await_picture(first_ns + seconds * 10**9)
    still_ns = screen.hold_still()
    settle(screen)
    return still_ns


def kept_ns(screen):
    """Return the stamps to go back to that the page knows."""
    return [int(stamp) for stamp in screen.page.evaluate(_KEPT)]


_KEPT = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  return stageOf("").held.stamps;
}"""


def test_a_still_picture_comes_at_full_size_and_time_goes_back_and_forward(serve, tablet):
    page = serve()
    screen = tablet(page.url)
    still_ns = held_after(screen, 3)
    assert screen.stamp_ns() == still_ns
    kept = kept_ns(screen)
    screen.tap_on(BAR.format("One second back"))
    back_ns = shown_after(screen, still_ns)
    assert back_ns == min(kept, key=lambda stamp_ns: abs(still_ns - stamp_ns - 10**9))
    screen.tap_on(BAR.format("One picture back"))
    before_ns = shown_after(screen, back_ns)
    assert before_ns == kept[kept.index(back_ns) - 1]
    screen.page.keyboard.press(".")
    assert shown_after(screen, before_ns, later=True) == back_ns
    screen.reads("#rewind", "back")
    screen.tap_on("#still")
    assert screen.await_picture(still_ns) > still_ns


def test_a_press_on_a_rewound_picture_is_of_its_moment(serve, tablet):
    page = serve()
    screen = tablet(page.url)
    still_ns = held_after(screen, 4)
    for _ in range(3):
        screen.tap_on(BAR.format("One second back"))
    screen.until(_OTHER, str(still_ns - 2_500_000_000), False)
    rewound_ns = screen.stamp_ns()
    screen.tap(*screen.on_screen(*corner_in(rewound_ns)))
    screen.reads(".row", "1")
    (target,) = page.targets
    off_m, chi_square = off_corner(target)
    assert chi_square < ELLIPSE
    assert off_m < 0.2


def test_the_cross_of_a_press_stays_on_the_picture_that_was_pressed(serve, tablet):
    """A kept picture does not have the new target, so the cross had stayed where it was."""
    screen = tablet(serve().url, DESK)
    still_ns = held_after(screen, 2)
    screen.tap(*screen.on_screen(*corner_in(still_ns)))
    screen.reads(".answer", "95 %")
    screen.wait(_HAS_CROSS, True)
    screen.page.keyboard.press("<")
    shown_after(screen, still_ns)
    screen.wait(_HAS_CROSS, False)


_HAS_CROSS = "(wanted) => document.querySelector('.cross').hidden !== wanted"


def test_a_rewound_picture_that_stays_without_a_link_has_its_own_age(serve, tablet):
    """It had that of the last live one: it seemed newer than it was."""
    screen = tablet(serve().url, DESK)
    still_ns = held_after(screen, 6)
    for _ in range(5):
        screen.page.keyboard.press("<")
    screen.until(_OTHER, str(still_ns - 4_500_000_000), False)
    screen.page.evaluate("() => (window.WebSocket = class { close() {} })")
    screen.tap_on("#still")
    screen.one(".stage[data-tone=old]").wait_for()
    screen.until(_IS_OLDER_THAN_FEED, 3)


#: Whether the words over the picture say that it is so many seconds older than the last live one.
_IS_OLDER_THAN_FEED = """async (seconds) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const words = document.querySelector(".words-over strong").innerText;
  return Number(words.split(" ")[1]) > stageOf("").feed.ageS + seconds;
}"""


def test_a_picture_that_is_gone_is_said_in_words(serve, tablet):
    screen = tablet(serve().url, DESK)
    screen.expected = "404"
    screen.hold_still()
    settle(screen)
    screen.page.evaluate(_WANT_GONE)
    screen.reads("#rewind", "No longer kept")
    screen.page.keyboard.press(",")
    screen.reads("#rewind", "back")


_WANT_GONE = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  stageOf("").held.want("1");
}"""


def test_a_damaged_picture_is_said_in_words(serve, tablet):
    screen = tablet(serve().url, DESK)
    screen.page.route("**/frame/**", lambda route: route.fulfill(body=b"no picture"))
    screen.hold_still()
    screen.reads("#rewind", "damaged")


def test_a_connection_that_ends_within_a_picture_is_said_and_the_next_one_comes(serve, tablet):
    """The page had waited for the rest for ever."""
    screen = tablet(serve().url, DESK)
    screen.await_picture()
    screen.page.evaluate(_CUT_THE_NEXT_PICTURE)
    still_ns = screen.hold_still()
    screen.reads("#rewind", "No connection")
    screen.page.keyboard.press(",")
    assert shown_after(screen, still_ns) < still_ns


_CUT_THE_NEXT_PICTURE = """() => {
  const whole = window.fetch;
  window.fetch = async (path, options) => {
    if (!path.startsWith("/frame/")) return whole(path, options);
    window.fetch = whole;
    const start = (body) => body.error(new Error("cut"));
    return new Response(new ReadableStream({ start }));
  };
}"""


def test_a_still_picture_that_is_ended_takes_no_more_of_the_link(serve, tablet):
    """On a thin link the next one had waited until the whole of the first was there."""
    screen = tablet(serve().url, DESK)
    first_ns = screen.await_picture()
    screen.page.route("**/frame/**", lambda _: None, times=1)  # is never answered
    with screen.page.expect_request("**/frame/**"):
        screen.hold_still()
    screen.reads("#rewind", "Fetching")
    screen.tap_on("#still")
    screen.await_picture(first_ns + 1_000_000_000)
    still_ns = screen.hold_still()
    settle(screen)
    assert screen.stamp_ns() == still_ns


def test_a_still_picture_that_a_dead_link_does_not_bring_comes_over_the_next_one(serve, tablet):
    screen = tablet(serve().url, DESK)
    screen.await_picture()
    screen.page.route("**/frame/**", lambda _: None, times=1)  # is never answered
    with screen.page.expect_request("**/frame/**"):
        screen.hold_still()
    screen.reads("#rewind", "Fetching")
    for phase in ("lost", "open"):
        screen.set(link={"phase": phase, "retryAt": 0})
    settle(screen)


def test_units_and_colours_of_a_still_picture_change_at_once(serve, tablet):
    """They had changed with the next picture, and there is none."""
    page = serve()
    screen = tablet(page.url, DESK)
    screen.await_picture()
    screen.tap(*screen.on_screen(320, 256))
    screen.until(_HAS_TARGET)
    screen.hold_still()
    settle(screen)
    screen.reads(".status-line", "40 m above")
    screen.set(units="feet")
    screen.reads(".status-line", "131 ft above")
    assert "#ffe14d" not in screen.page.evaluate(_STROKES, "dark")
    assert "#ffe14d" in screen.page.evaluate(_STROKES, "red")


_HAS_TARGET = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  return stageOf("").frame.shapes.targets.length > 0;
}"""


#: Returns the colours of the lines that a change of the theme draws.
_STROKES = """async (theme) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { store } = await import("/static/js/store.js");
  const { context } = stageOf("").painter;
  const seen = [];
  context.stroke = (...path) => {
    seen.push(context.strokeStyle);
    CanvasRenderingContext2D.prototype.stroke.apply(context, path);
  };
  store.set({ theme });
  delete context.stroke;
  return seen;
}"""


def test_a_press_on_the_map_blinks_not_on_a_still_picture(serve, tablet):
    """The ring had been where the place is in the live picture: on other ground."""
    screen = tablet(serve().url, DESK)
    stamp_ns = screen.hold_still()
    screen.page.wait_for_timeout(1000)
    screen.page.evaluate(_WHERE, [*place_at(stamp_ns, 320, 256)])
    screen.reads("#toast", "Not in the video: still picture")
    assert screen.page.locator(".ring").is_hidden()


_WHERE = """async (place) => {
  const { where } = await import("/static/js/map/where.js");
  await where(...place);
}"""


def test_another_aircraft_ends_the_still_picture(serve, tablet):
    """On a phone the first one's video is hidden then: it asks for no more stamps."""
    screen = tablet(serve("a", "b").url, PHONE)
    screen.until(_HAS_PICTURE, "a")
    screen.tap_on("#still")
    screen.until(_IS_HELD, "a")
    screen.tap_on("#aircraft [aria-checked=false]")
    screen.until(_HAS_PICTURE, "b")
    screen.awaits(lambda: not screen.page.evaluate(_IS_HELD, "a"))


_HAS_PICTURE = """async (aircraft) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  return Boolean(stageOf(aircraft)?.frame);
}"""
_IS_HELD = """async (aircraft) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  return stageOf(aircraft).held.on;
}"""


def test_a_picture_that_is_to_be_still_before_one_came_is_the_first(serve, tablet, monkeypatch):
    """None came at all: NO VIDEO became GO, beside words that one was waited for."""
    with monkeypatch.context() as before_any:
        before_any.setattr(PageServer, "show", lambda *_, **__: None)
        screen = tablet(serve().url)
        screen.reads("#verdict", "NO VIDEO")
        screen.tap_on("#still")
        screen.page.wait_for_timeout(500)
        screen.reads("#verdict", "NO VIDEO")
    screen.one(".stage[data-tone=still]").wait_for()
    screen.one("#rewind").wait_for()
    settle(screen)
    screen.reads("#verdict", "GO")


def test_a_tablet_on_its_side_goes_back_in_all_its_videos(serve, tablet):
    """The one that was hidden had no bar until the next still picture."""
    screen = tablet(serve("a", "b").url, LEVEL)
    for aircraft in "ab":
        screen.until(_HAS_PICTURE, aircraft)
    screen.page.set_viewport_size(dict(zip(("width", "height"), TABLET, strict=True)))
    screen.tap_on("#still")
    screen.until(_IS_HELD, "a")
    screen.page.set_viewport_size(dict(zip(("width", "height"), LEVEL, strict=True)))
    screen.until(_IS_HELD, "b")


def test_aircraft_that_come_and_go_while_the_picture_is_still_are_still_too(serve, tablet):
    """A new one gave an alarm for its video, and one that had gone was asked for stamps."""
    screen = tablet(serve("a", "b").url, DESK)
    for aircraft in "ab":
        screen.until(_HAS_PICTURE, aircraft)
    screen.tap_on("#still")
    screen.until(_IS_HELD, "b")
    screen.page.evaluate(_KEEP, "b")
    listed = [{"id": name, "name": name} for name in "ab"]
    screen.set(aircraft=listed[:1])
    assert not screen.page.evaluate("() => window.kept.held.on")
    screen.set(aircraft=listed)
    screen.page.wait_for_timeout(2000)
    screen.shows("#banner", 0)


_KEEP = """async (aircraft) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  window.kept = stageOf(aircraft);
}"""


@pytest.mark.parametrize(("size", "aircraft"), [(PHONE, [""]), (DESK, [""]), (DESK, [*"abcd"])])
def test_the_bar_covers_no_answer(serve, tablet, size, aircraft):
    """Neither one that comes later nor one that is there when the picture becomes still."""
    screen = tablet(serve(*aircraft).url, size)
    last = aircraft[-1]  # of four tiles one that is low, and not the chosen one
    screen.until(_HAS_PICTURE, last)
    assert screen.page.evaluate(_ROOM, [last, 0.97]) is None  # there is no bar
    screen.tap_on("#still")
    screen.one("#rewind").wait_for()
    for share in [None, *np.linspace(0.5, 1.0, 9).tolist()]:
        screen.until(_HAS_ROOM, last, share)


#: Answers a press at a share of the picture's height, if given; returns the room above the bar.
_ROOM = """async ([aircraft, share]) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { marks, frame } = stageOf(aircraft);
  if (share !== null) marks.refused(frame.width / 2, share * frame.height, "Some words");
  const bar = document.querySelector("#rewind").getBoundingClientRect();
  return bar.height ? bar.top - marks.answer.getBoundingClientRect().bottom : null;
}"""
_HAS_ROOM = f"async (all) => (await ({_ROOM})(all)) >= 0"


@pytest.mark.parametrize("size", [PHONE, TABLET])
def test_no_banner_covers_the_bar(serve, tablet, monkeypatch, size):
    """While one lasted, a phone could go back to no earlier picture."""
    well(monkeypatch, verdict=LOST)
    screen = tablet(serve().url, size)
    screen.reads("#banner", LOST["text"])
    screen.hold_still()
    screen.wait(_IS_ABOVE, "#banner", "#rewind")


def test_the_banner_of_a_phone_on_its_side_is_beside_the_video_and_hides_nothing(
    serve, tablet, monkeypatch
):
    """It covered half of a video that is 170 pixels high."""
    well(monkeypatch, verdict=LOST | {"alarm": True})
    screen = tablet(serve().url, SIDE)
    for _ in range(3):
        press(screen)
    screen.reads("#banner", "Silence")
    screen.one("#panel").evaluate("(panel) => panel.scrollTo(0, panel.scrollHeight)")
    parts = "#videos", "#banner", "#toast", ".row"
    video, banner, toast, row = (screen.one(f"{part} >> nth=-1").bounding_box() for part in parts)
    assert video["x"] + video["width"] <= banner["x"]
    screen.tap_on("#tabs [data-tab=map]")
    tools = screen.one(".map-tools").bounding_box()
    assert max(box["y"] + box["height"] for box in (toast, row, tools)) <= banner["y"]


@pytest.mark.parametrize("size", [PHONE, SIDE])
def test_nothing_covers_the_answer_to_a_press(serve, tablet, monkeypatch, size):
    """The words over a picture, the banner and the temperature under the finger covered it."""
    well(monkeypatch, verdict=LOST)
    page = serve(token="operator-token-1", viewer_token="viewer-token-123")
    screen = tablet(page.server.viewer_url, size)  # a viewer's presses are answered at once
    screen.reads("#banner", LOST["text"])
    screen.await_picture()
    for still in (False, True):
        screen.set(still=still)
        screen.shows(".stage[data-tone=still]", int(still))
        over = screen.one(".over").bounding_box()
        for share in (0.2, 0.3, 0.4):
            screen.page.evaluate("() => document.querySelector('.answer')?.replaceChildren()")
            screen.tap(over["x"] + over["width"] / 2, over["y"] + share * over["height"])
            screen.one(".answer", has_text=re.compile(".")).wait_for()
            assert screen.page.evaluate(_COVERING) == [], (still, share)


#: What is over the answer, also where it lets presses through.
_COVERING = """() => {
  for (const node of document.querySelectorAll(".stage *")) node.style.pointerEvents = "auto";
  const { left, top, width, height } = document.querySelector(".answer").getBoundingClientRect();
  const found = [0.1, 0.3, 0.5, 0.7, 0.9].flatMap((x) =>
    [0.1, 0.5, 0.9].map((y) => document.elementFromPoint(left + x * width, top + y * height)),
  );
  for (const node of document.querySelectorAll(".stage *")) node.style.pointerEvents = "";
  return found.filter((node) => !node.closest(".answer")).map((node) => node.outerHTML);
}"""


@pytest.mark.parametrize("size", [PHONE, SIDE, (667, 375)])
def test_an_answer_with_its_button_leaves_its_cross_to_be_seen(serve, tablet, size):
    screen = tablet(serve().url, size)
    place = screen.on_screen(*corner_in(screen.hold_still()))
    screen.tap(*place)
    screen.reads("#toast", "Target 1 set")
    screen.tap(*place)
    screen.one(".answer .same").wait_for()
    answer = screen.one(".answer").bounding_box()
    assert not 0 <= place[1] - answer["y"] <= answer["height"]


def test_a_banner_that_comes_later_covers_no_answer(serve, tablet, monkeypatch):
    verdict = dict(GO)
    well(monkeypatch, verdict=verdict)
    page = serve(token="operator-token-1", viewer_token="viewer-token-123")
    screen = tablet(page.server.viewer_url, PHONE)
    screen.await_picture()
    over = screen.one(".over").bounding_box()
    screen.tap(over["x"] + over["width"] / 2, over["y"] + 0.7 * over["height"])
    screen.one(".answer").evaluate("(node) => { node.dataset.turn = 'stays'; }")
    verdict.update(LOST)
    screen.reads("#banner", LOST["text"])
    screen.wait(_IS_ABOVE, ".answer", "#banner")


_IS_ABOVE = """(parts) => {
  const [upper, lower] = parts.map((part) => document.querySelector(part).getBoundingClientRect());
  return upper.height && upper.bottom <= lower.top;
}"""


def test_the_cross_of_a_press_moves_with_the_ground(serve, tablet):
    page = serve()
    screen = tablet(page.url, DESK)
    screen.await_picture()
    _, left, top = screen.video()
    screen.tap(left + 500, top + 500)
    screen.reads(".answer", "95 %")
    places = screen.page.evaluate(_FOLLOWED, 10)
    (target,) = page.targets
    assert len(places) == 10
    for cross, mark, id_ in places:
        assert id_ == target.id
        assert cross == pytest.approx(mark)
    assert len({tuple(cross) for cross, _, _ in places}) > 5


_FOLLOWED = """async (count) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { marks } = stageOf("");
  const seen = [];
  const follow = marks.follow.bind(marks);
  await new Promise((done) => {
    marks.follow = (targets) => {
      follow(targets);
      if (!targets.length) return;
      const { u, v } = marks.places.get(marks.cross);
      seen.push([[u, v], [targets[0][2], targets[0][3]], targets[0][0]]);
      if (seen.length === count) done();
    };
  });
  return seen;
}"""


def test_a_cross_whose_ground_has_left_the_picture_is_gone(serve, tablet):
    screen = tablet(serve().url, DESK)
    screen.await_picture()
    assert screen.page.evaluate(_CROSS_AFTER) == [False, False, True, True, False]


_CROSS_AFTER = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { Marks } = await import("/static/js/video/marks.js");
  const marks = new Marks(document.body, stageOf("").view);
  const mark = ["a", "1", 100, 100, 5, 5, 0];
  const hidden = [];
  const after = (...targets) => hidden.push((marks.follow(targets), marks.cross.hidden));
  marks.locating(90, 90);
  marks.located(90, 90, "1", "a");
  after(); // a frame that was made before the press was answered
  after(mark);
  after();
  after(mark); // the words of the press belong to the ground that was lost
  marks.locating(50, 50);
  after();
  return hidden;
}"""
