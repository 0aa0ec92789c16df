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
"""The operator's page in a real browser: a link that is lost, and a server that starts again."""

from __future__ import annotations

import asyncio

import pytest
from browser import DESK
from page_clients import tile_file
from served_page import corner_in, press, well

from tirgeo_ros.page.state_hub import StatePage


@pytest.fixture(autouse=True)
def all_is_well(monkeypatch):
    well(monkeypatch)


def test_a_finger_that_pans_while_the_link_comes_back_ends_no_later_press(serve, tablet):
    """The video was not told that it was lifted: each later press was that of a second finger."""
    screen = tablet(serve().url)
    x, y = screen.on_screen(*corner_in(screen.hold_still()))
    fingers = screen.context.new_cdp_session(screen.page)

    def touch(what, *at):
        points = [{"x": left, "y": top} for left, top in at]
        fingers.send("Input.dispatchTouchEvent", {"type": what, "touchPoints": points})

    touch("touchStart", (x, y))
    screen.set(aircraft=[{"id": "", "name": "aircraft"}])  # as each welcome of the server does
    touch("touchMove", (x, 20))  # off the video
    touch("touchEnd")
    screen.tap(x, y)
    screen.reads(".answer", "95 %")


def test_a_restart_of_the_server_loses_nothing(serve, tablet):
    page = serve()
    screen = tablet(page.url)
    screen.expected = "WebSocket connection|ERR_CONNECTION"
    press(screen)
    (before,) = page.targets
    page.stop()
    screen.reads("#banner", "Connection lost")
    page.start()
    stamp_ns = screen.stamp_ns()
    assert screen.await_picture(stamp_ns) > stamp_ns
    assert screen.one(".row").is_visible()
    screen.wait("() => document.querySelector('#banner').hidden")
    press(screen)
    assert [target.number for target in page.targets] == [1, 2]
    assert page.targets[0] == before


def test_a_welcome_that_comes_late_is_waited_for(serve, tablet, monkeypatch):
    """After a loss the page had given up each new connection within a second."""
    page = serve()
    screen = tablet(page.url)
    screen.expected = "WebSocket connection|ERR_CONNECTION"
    screen.await_picture()
    run = StatePage.run

    async def late(*all_):
        await asyncio.sleep(2)
        await run(*all_)

    monkeypatch.setattr(StatePage, "run", late)
    page.stop()
    screen.page.wait_for_timeout(5000)
    page.start()
    screen.wait("() => document.querySelector('#banner').hidden")


def test_a_page_that_was_never_welcomed_says_that_its_connection_is_lost(
    serve, tablet, monkeypatch
):
    """It had been empty, without a word why."""

    async def turn_away(state_page, *_):
        await state_page._socket.close()

    run = StatePage.run
    monkeypatch.setattr(StatePage, "run", turn_away)
    screen = tablet(serve().url)
    screen.reads("#banner", "Connection lost")
    monkeypatch.setattr(StatePage, "run", run)
    screen.await_picture()
    screen.wait("() => document.querySelector('#banner').hidden")


def test_an_aircraft_that_is_named_anew_has_that_name_over_its_video(serve, tablet):
    """It had the old one there, and the new one in the alarms and the switch."""
    screen = tablet(serve("a", "b").url, DESK)
    screen.reads(".stage[data-aircraft=b] .name", "b")
    named = [{"id": "a", "name": "North"}, {"id": "b", "name": "South"}]
    screen.set(aircraft=named)  # as the welcome of a server that was started again
    screen.reads(".stage[data-aircraft=b] .name", "South")
    assert "South" in screen.one(".stage[data-aircraft=b] .over").get_attribute("aria-label")


def test_a_page_that_is_turned_away_comes_back_after_growing_waits(serve, tablet, monkeypatch):
    """It had come forty times a second, as fast as its entrance was answered."""
    page = serve()
    screen = tablet(page.url)
    screen.expected = "WebSocket connection|ERR_CONNECTION"
    screen.await_picture()
    times = []

    async def turn_away(state_page, *_):
        times.append(1)
        await state_page._socket.close()

    monkeypatch.setattr(StatePage, "run", turn_away)
    page.stop()
    page.start()
    screen.awaits(lambda: times)
    screen.page.wait_for_timeout(5000)
    assert len(times) <= 6


def test_a_video_that_died_with_the_link_comes_back_with_it(serve, tablet):
    """A connection that only takes has no error when the network is gone."""
    screen = tablet(serve().url)
    screen.await_picture()
    screen.page.evaluate(_DIE)
    screen.reads(".words-over", "FROZEN")
    stamp_ns = screen.stamp_ns()
    for phase in ("lost", "open"):
        screen.set(link={"phase": phase, "retryAt": 0})
    assert screen.await_picture(stamp_ns) > stamp_ns


_DIE = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  stageOf("").feed.socket.socket.onmessage = null;
}"""


def test_a_connection_that_never_opens_is_given_up_for_a_new_one(screen):
    """One that began while the network was gone had lasted as long again as that."""
    assert screen.page.evaluate(_TRIES) > 1


#: A hundred times as fast: how many connections are tried in half a minute.
_TRIES = """async () => {
  const { RetryingSocket } = await import("/static/js/link/retrying_socket.js");
  const { WebSocket, setTimeout } = window;
  let tries = 0;
  window.setTimeout = (run, ms) => setTimeout(run, ms / 100);
  window.WebSocket = class {
    constructor() {
      tries += 1;
    }
    close() {}
  };
  const socket = new RetryingSocket("/state", { received() {} });
  socket.start();
  await new Promise((done) => setTimeout(done, 300));
  socket.stop();
  Object.assign(window, { WebSocket, setTimeout });
  return tries;
}"""


def test_a_server_that_starts_again_gives_its_map_and_the_tiles_that_were_missed(
    serve, tablet, tmp_path
):
    page = serve(tiles=str(tile_file(tmp_path / "a.mbtiles")))
    page.backend._map = b""
    screen = tablet(page.url, DESK)
    screen.expected = "WebSocket connection|ERR_"
    screen.tap_on("#layers")
    screen.tap_on(".map-layers [data-layer=tiles]")
    screen.reads(".map-words", "There is no map")
    screen.tap_on(".map-layers [data-layer=tiles]")
    page.stop()
    screen.reads("#banner", "Connection lost")
    screen.tap_on("[aria-label='Zoom out']")
    screen.page.wait_for_timeout(500)
    with screen.page.expect_request(lambda asked: "/tiles/" in asked.url):
        page.start()
    screen.shows(".map-layers [data-layer]:has-text('Map')", 1)


def test_an_aircraft_that_is_gone_after_a_restart_is_gone_from_the_map(serve, tablet):
    page = serve("one", "two")
    screen = tablet(page.url)
    screen.expected = "WebSocket connection|ERR_CONNECTION|404"  # its video is asked for once more
    screen.shows(".map-aircraft", 2)
    page.stop()
    del page.aircraft["two"]
    page.flying = ("one",)
    page.start()
    screen.shows(".map-aircraft", 1)
    screen.shows(".map-aircraft .stale", 0)


def with_target(serve, tablet):
    """Return a page with a target, and its screen, which may lose the link."""
    page = serve()
    screen = tablet(page.url)
    screen.expected = "WebSocket connection|ERR_"
    press(screen)
    return page, screen


def test_a_card_that_was_opened_without_a_connection_has_its_pictures_later(serve, tablet):
    page, screen = with_target(serve, tablet)
    page.stop()
    screen.reads("#banner", "Connection lost")
    screen.tap_on(".row")
    screen.shows("#target-card figure", 0)
    page.start()
    screen.shows("#target-card figure", 2)


def test_a_target_that_is_deleted_without_a_connection_goes_when_it_is_back(serve, tablet):
    page, screen = with_target(serve, tablet)
    screen.tap_on(".row")
    page.stop()
    screen.reads("#banner", "Connection lost")
    screen.tap_on("#delete")
    screen.reads("#toast", "Not saved yet")
    page.start()
    screen.reads("#toast", "Target 1 deleted")
    assert page.targets == []
