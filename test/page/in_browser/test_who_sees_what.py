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
"""In a real browser: tokens and roles, two viewers, alarms, a press on the map."""

from __future__ import annotations

from itertools import pairwise

import pytest
from browser import DESK
from page_backend import GO
from served_page import corner_in, well

TOKEN, VIEWER_TOKEN = "operator-token-1", "viewer-token-123"


@pytest.fixture
def guarded(serve, monkeypatch):
    """A page that wants a token."""
    well(monkeypatch)
    return serve(token=TOKEN, viewer_token=VIEWER_TOKEN)


def press(screen):
    """Touch the corner of a plot in a still picture."""
    screen.tap(*screen.on_screen(*corner_in(screen.hold_still())))


def test_without_the_token_nothing_is_shown_and_with_it_all(guarded, tablet):
    screen = tablet(guarded.url.partition("?")[0], expected="401|403|429")
    screen.reads("#enter", "needs a token")
    for _ in range(3):  # a browser lets a page refuse the first one alone
        screen.page.keyboard.press("Escape")
        screen.page.wait_for_timeout(100)
    screen.one("#enter input").fill("not-the-token")
    screen.tap_on("#enter button")
    screen.reads("#enter", "Wrong token")
    assert screen.faults() == []
    assert screen.page.locator(".stage").count() == 0
    screen.one("#enter input").fill(guarded.url)
    button = screen.page.locator("#enter button")
    while not screen.page.locator(".stage").count():  # a wrong one costs some seconds
        button.evaluate("(button) => button.click()")  # also while the dialog closes
        screen.page.wait_for_timeout(500)
    screen.await_picture()


@pytest.mark.slow
def test_the_token_leaves_the_address_and_the_script_cannot_read_the_session(guarded, tablet):
    screen = tablet(guarded.url)
    screen.await_picture()
    assert TOKEN not in screen.page.url
    assert screen.page.evaluate("() => document.cookie") == ""
    (cookie,) = screen.context.cookies()
    assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
    screen.reload()
    screen.await_picture()


def test_a_viewer_sees_what_operators_set_and_cannot_change_it(guarded, tablet):
    operator, viewer = tablet(guarded.url), tablet(guarded.server.viewer_url, DESK)
    viewer.await_picture()
    press(operator)
    operator.reads(".row .badge", "1")
    viewer.reads(".row .badge", "1")
    press(viewer)
    viewer.reads(".answer", "viewer")
    assert len(guarded.targets) == 1
    viewer.tap_on(".row")
    assert not viewer.page.locator(".operator-only").locator("visible=true").count()
    viewer.reads("#target-card", "95 %")
    assert viewer.faults() == []
    fields = viewer.page.locator("#target-card :is(input, textarea)").locator("visible=true")
    assert all(field.get_attribute("readonly") is not None for field in fields.all())
    refusal = viewer.page.evaluate(
        """async (id) => {
          const { ask } = await import("/static/js/link/state_link.js");
          return ask("delete", { id, was: {} });
        }""",
        guarded.targets[0].id,
    )
    assert not refusal["ok"]
    assert len(guarded.targets) == 1


@pytest.mark.slow
def test_a_busy_server_is_asked_again_instead_of_a_token(guarded, tablet):
    screen = tablet(guarded.url)
    screen.await_picture()
    screen.expected = "429"
    busy = {"status": 429, "json": {"reason": "too many requests: wait a moment"}}
    screen.page.route("**/enter", lambda route: route.fulfill(**busy), times=1)
    screen.reload()
    screen.await_picture()
    assert not screen.page.locator("#enter").is_visible()


class Alarming:
    """A page whose verdict a test sets; ``sounded`` counts the alarms that a tablet gave."""

    def __init__(self, monkeypatch, serve, tablet, **first):
        self.said = dict(GO, **first)
        well(monkeypatch, verdict=self.said)
        self.page = serve()
        self.screen = tablet(self.page.url)
        self.screen.await_picture()
        self.screen.page.evaluate(
            """() => {
              window.sounded = [];
              const value = () => window.sounded.push(performance.now());
              Object.defineProperty(navigator, "vibrate", { value });
            }"""
        )
        self.screen.tap_on("[data-tab=checks][role=tab]")  # the press that allows sound

    def says(self, **verdict):
        self.said.update(verdict)
        self.screen.reads("#verdict", self.said["word"])

    def sounds_for(self, seconds):
        """Let the words count seconds; return when an alarm sounded, in seconds."""
        before = self.screen.page.evaluate("() => window.sounded.length")
        for count in range(seconds):
            self.said["text"] = f"The gimbal is silent for {count} s"
            self.screen.page.wait_for_timeout(1000)
        return [ms / 1000 for ms in self.screen.page.evaluate("() => window.sounded")][before:]


@pytest.fixture
def alarming(serve, tablet, monkeypatch):
    return Alarming(monkeypatch, serve, tablet)


@pytest.mark.slow
def test_an_alarm_sounds_each_four_seconds_and_silence_is_for_it_alone(alarming):
    """It began anew each second as its words counted, and Silence was for ever."""
    alarming.says(word="NO DATA", tone="bad", kind="camera pose", alarm=True, more="gimbal/joint")
    times = alarming.sounds_for(9)
    assert 2 <= len(times) <= 3
    assert min(later - earlier for earlier, later in pairwise(times)) > 3.9
    alarming.screen.reads("#banner", "The gimbal is silent for 8 s")
    assert not alarming.screen.page.get_by_text("gimbal/joint").is_visible()  # under: more
    alarming.screen.tap_on("#banner summary")
    alarming.screen.page.get_by_text("gimbal/joint").wait_for()
    alarming.screen.tap_on("#banner button")
    alarming.screen.reads("#banner", "silenced")
    assert alarming.sounds_for(5) == []
    alarming.says(word="LOST", kind="position")
    assert alarming.sounds_for(5)
    assert alarming.screen.page.evaluate(
        "async () => (await import('/static/js/store.js')).store.get('sound')"
    )


@pytest.mark.parametrize("way", ["press", "alarm"])
def test_a_tablet_whose_screen_was_off_sounds_again(serve, tablet, way):
    """Its browser has interrupted the sound: the page must ask for it (iOS)."""
    screen = tablet(serve().url)
    screen.await_picture()
    screen.page.evaluate(_INTERRUPTED)
    screen.tap_on("[data-tab=checks][role=tab]")
    screen.page.evaluate("() => (AudioContext.now = 'interrupted')")
    if way == "press":
        screen.tap_on("[data-tab=targets][role=tab]")
    else:
        screen.page.evaluate("async () => (await import('/static/js/checks/alarm.js')).beep()")
    screen.wait("() => AudioContext.now === 'running'")


_INTERRUPTED = """() => {
  window.AudioContext = class {
    static now = "running";
    get state() {
      return AudioContext.now;
    }
    async resume() {
      await null;
      AudioContext.now = "running";
    }
  };
}"""


def test_nothing_is_good_beside_a_verdict_that_is_not(alarming):
    alarming.screen.reads(".finding[data-tone=good]", "Nothing is wrong")
    notice = "NO MAP: no pose for 2.0 s"
    alarming.says(word="NO GO", tone="bad", kind="map", text=notice, alarm=True)
    alarming.screen.reads("#banner", notice)
    alarming.screen.shows(".finding[data-tone=good]", 0)
    # The picture has the words itself: the page says them once, but while it is frozen.
    alarming.screen.shows(":text('NO MAP')", 1)


@pytest.mark.parametrize(
    ("silent", "word"), [(("report", "show"), "NO DATA"), (("show",), "NO VIDEO")]
)
def test_what_does_not_reach_this_screen_has_one_reason(alarming, silent, word):
    """States, and pictures, or pictures alone: banner and video said different things."""
    for name in silent:
        setattr(alarming.page.server, name, lambda *_, **__: None)
    alarming.screen.reads("#verdict", word)
    alarming.screen.reads(".words-over", "FROZEN")
    alarming.screen.wait(
        """() => document.querySelector("#banner strong").textContent.length > 10
          && document.querySelector("#banner strong").textContent
          === document.querySelector(".words-over span").textContent"""
    )


def test_a_video_that_is_open_and_silent_is_not_said_to_be_connecting(alarming):
    """After each later welcome of the server the engineer had read so."""
    alarming.screen.set(aircraft=[{"id": "", "name": "aircraft"}])
    alarming.page.server.show = lambda *_, **__: None
    alarming.screen.reads("#verdict", "NO VIDEO")
    alarming.screen.tap_on("#banner summary")
    alarming.screen.reads("#banner p", "/video: open")


@pytest.mark.slow
def test_a_press_on_the_map_blinks_in_the_video_where_it_is(guarded, tablet):
    screen = tablet(guarded.url, DESK)
    screen.await_picture()
    place = screen.one("#map").bounding_box()
    screen.wait("() => document.querySelector('#map canvas, #map path') !== null")
    # The map follows the aircraft, which is in the middle of what the camera sees.
    screen.tap(place["x"] + place["width"] / 2 + 30, place["y"] + place["height"] / 2 + 20)
    screen.wait("() => !document.querySelector('.ring').hidden")
    across, down = screen.page.evaluate(
        """() => {
          const ring = document.querySelector(".ring").getBoundingClientRect();
          const video = document.querySelector(".stage canvas").getBoundingClientRect();
          const middle = (box) => [box.x + box.width / 2, box.y + box.height / 2];
          return middle(ring).map((at, k) => 2 * (at - middle(video)[k]) / video.height);
        }"""
    )
    assert 0 < across < 1
    assert 0 < down < 1
