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
"""Chromium for the tests of the operator's page: what a page says, asks for and shows."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar
from urllib.parse import urlsplit

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, ConsoleMessage, Locator, Page, expect, sync_playwright

T = TypeVar("T")
NAMES = ("chromium", "chromium-browser", "google-chrome")
PHONE, TABLET, LEVEL, DESK = (390, 844), (820, 1180), (1180, 820), (1920, 1080)
#: A limit, not a wait: a busy machine takes long to draw a first page.
LIMIT_S = 30.0
expect.set_options(timeout=LIMIT_S * 1000)
#: So late has the page each press and each message: `make test-late` finds tests that do not wait.
LATE_MS = int(os.environ.get("TIRGEO_LATE_MS", "0"))
#: Complaints of Chromium's own: of a connection that it opened ahead and that has ended, where the
#: page asks again; of the video's connection when a picture becomes still before it is open.
ALWAYS = "ERR_SOCKET_NOT_CONNECTED|WebSocket is closed before"
#: What a finger in a glove hits (WCAG 2.2, target size enhanced), CSS pixels.
FINGER_PX = 44


def browser_path() -> str:
    """Return the installed Chromium; skips without one, and fails where one must be there."""
    result = next(filter(None, map(shutil.which, NAMES)), None)
    if result:
        return result
    words = "no Chromium: install the package chromium to test the operator's page in a browser"
    if os.environ.get("TIRGEO_NEED_BROWSER"):
        pytest.fail(words)
    pytest.skip(words)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Run Chromium; while it runs, this thread has an asyncio loop of Playwright's."""
    path = browser_path()
    with sync_playwright() as driver:
        options = ["--no-sandbox", "--disable-dev-shm-usage", "--mute-audio"]
        browser = driver.chromium.launch(executable_path=path, args=options)
        yield browser
        browser.close()


class Screen:
    """Be one tablet: a page of its own, whose complaints and requests are written down."""

    def __init__(self, browser: Browser, size: tuple[int, int] = TABLET, **more: object):
        width, height = size
        self.context = browser.new_context(
            viewport={"width": width, "height": height}, has_touch=True, **more
        )
        self.context.set_default_timeout(LIMIT_S * 1000)
        self.complaints: list[str] = []
        self.taps = 0
        self.expected = ""  # a pattern of complaints that a test provokes
        self.hosts: set[str] = set()
        self.page: Page = self.context.new_page()
        if LATE_MS:
            self.page.add_init_script(_LATE.replace("LATE_MS", str(LATE_MS)))
        self.page.on("console", self._console)
        self.page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        self.page.on("request", lambda asked: self.hosts.add(urlsplit(asked.url).netloc))

    def _console(self, message: ConsoleMessage) -> None:
        expected = "|".join(filter(None, (ALWAYS, self.expected)))
        if message.type in {"error", "warning"} and not re.search(expected, message.text):
            self.complaints.append(f"{message.type}: {message.text} {message.location}")

    def open(self, url: str) -> Screen:
        """Go to a page."""
        self.page.goto(url)
        return self

    def enter(self, url: str) -> Screen:
        """Go to the operator's page, and wait until it is built and knows its aircraft's state.

        Or until it asks for a token, or says that there is no connection.
        """
        self.open(url)
        self.until(_BEGAN)
        return self

    def reload(self) -> None:
        """Load the operator's page again, and wait as in ``enter``."""
        self.page.reload()
        self.until(_BEGAN)

    def tap(self, x: float, y: float) -> None:
        """Touch a place of the screen, CSS pixels."""
        self.taps += 1
        self.page.touchscreen.tap(x, y)

    def tap_on(self, selector: str, **filters: object) -> None:
        """Touch the first visible element."""
        self.taps += 1
        self.one(selector, **filters).tap()

    def reads(self, selector: str, words: str) -> None:
        """Wait until an element shows words."""
        expect(self.page.locator(selector).locator("visible=true").first).to_contain_text(
            words, ignore_case=True
        )

    def shows(self, selector: str, count: int) -> None:
        """Wait until so many elements are visible."""
        found = self.page.locator(selector).locator("visible=true")
        expect(found).to_have_count(count)

    def stamp_ns(self, aircraft: str = "") -> int:
        """Return the stamp of the picture that is on the screen; 0 before the first."""
        return int(self.page.evaluate(_STAMP, aircraft))

    def hold_still(self) -> int:
        """Keep the picture that is on the screen, and return its stamp."""
        self.await_picture()
        self.tap_on("#still")
        self.one(".stage[data-tone=still]").wait_for()  # in any language
        return self.stamp_ns()

    def await_picture(self, after_ns: int = 0) -> int:
        """Wait for a picture later than a stamp; return its stamp."""
        self.awaits(lambda: self.stamp_ns() > after_ns, f"no picture after {after_ns}")
        return self.stamp_ns()

    def awaits(self, check: Callable[[], T], words: str = "") -> T:
        """Return what a function returns as soon as that is true."""
        end_s = time.monotonic() + LIMIT_S
        while not (result := check()):
            assert time.monotonic() < end_s, words
            self.page.wait_for_timeout(50)
        return result

    def on_screen(self, u: float, v: float, aircraft: str = "") -> tuple[float, float]:
        """Return where a pixel of the picture is on the screen."""
        return tuple(self.page.evaluate(_ON_SCREEN, [aircraft, u, v]))

    def shown_pixel(self) -> float:
        """Return the size of a pixel of the picture on the screen, in the full picture's pixels.

        It is above one while the connection is slow, or this machine busy.
        """
        return float(self.page.evaluate(_SHOWN_PIXEL))

    def video(self) -> tuple[bytes, float, float]:
        """Return the video as it is on the screen (PNG), and the screen place of its corner."""
        stage = self.one(".stage canvas")
        box = stage.bounding_box()
        assert box is not None
        return stage.screenshot(), box["x"], box["y"]

    def wait(self, script: str, *arguments: object) -> object:
        """Return what a JavaScript function returns as soon as that is true."""
        argument = arguments[0] if len(arguments) == 1 else list(arguments)
        handle = self.page.wait_for_function(script, arg=argument, polling=50)
        return handle.json_value()

    def until(self, script: str, *arguments: object) -> object:
        """Return what an asynchronous JavaScript function gives as soon as that is true."""
        argument = arguments[0] if len(arguments) == 1 else list(arguments)
        return self.awaits(lambda: self.page.evaluate(script, argument), script)

    def one(self, selector: str, **filters: object) -> Locator:
        """Return the first visible element."""
        return self.page.locator(selector, **filters).locator("visible=true").first

    def download(self, press: Callable[[], object], folder: Path) -> Path:
        """Return the file that a press brings."""
        with self.page.expect_download() as waiting:
            press()
        path = folder / waiting.value.suggested_filename
        waiting.value.save_as(path)
        return path

    def set(self, **changes: object) -> None:
        """Change values of the page's store."""
        self.page.evaluate(_SET, changes)

    def too_wide(self) -> list[str]:
        """Return what stands out sideways."""
        return list(self.page.evaluate(_TOO_WIDE))

    def faults(self) -> list[str]:
        """Return what stands out sideways, is too small for a finger, or a fault to axe-core.

        Day and night colours are both looked at, with all rules of axe's.
        """
        result = self.too_wide() + self.page.evaluate(_TOO_SMALL, FINGER_PX)
        for theme in ("red", "dark"):
            self.set(theme=theme)
            rules = Axe().run(self.page).response["violations"]
            result += [
                f"{theme}: {rule['id']}: {node['html'][:90]}: {node['failureSummary'][-200:]}"
                for rule in rules
                for node in rule["nodes"]
            ]
        return result

    def close(self) -> None:
        """Close the page and all of it."""
        self.context.close()


_LATE = """(() => {
  const late = (run) => setTimeout(run, LATE_MS);
  const pressed = ({ target, clientX, clientY }) =>
    target.isConnected ? target : document.elementFromPoint(clientX, clientY); // was drawn anew
  const again = (event) => {
    if (!event.isTrusted || event.target.closest("select, input")) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    late(() => pressed(event).dispatchEvent(new MouseEvent("click", event)));
  };
  window.addEventListener("click", again, true);
  const { WebSocket, fetch } = window;
  window.WebSocket = class extends WebSocket {
    get onmessage() {
      return this.listener;
    }
    set onmessage(listener) {
      this.listener = listener;
      super.onmessage = listener && ((event) => late(() => this.listener?.(event)));
    }
  };
  window.fetch = (...request) => new Promise(late).then(() => fetch(...request));
})();"""
_BEGAN = """async () => {
  const { store } = await import("/static/js/store.js");
  const { phase } = store.get("link");
  const isOpen = phase === "open" && Object.keys(store.get("states")).length > 0;
  return isOpen || phase === "lost" || document.querySelector("#enter").open;
}"""
_STAMP = """async (aircraft) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  return stageOf(aircraft)?.frame?.stampNs ?? "0";
}"""
_SET = """async (changes) => {
  const { store } = await import("/static/js/store.js");
  store.set(changes);
}"""
_SHOWN_PIXEL = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { frame } = stageOf("");
  return frame.width / frame.bitmap.width;
}"""
_ON_SCREEN = """async ([aircraft, u, v]) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { view, over } = stageOf(aircraft);
  const { x, y } = view.toScreen(u, v);
  const box = over.getBoundingClientRect();
  return [box.x + x, box.y + y];
}"""
_TOO_WIDE = """() => {
  const width = document.documentElement.clientWidth;
  const found = document.documentElement.scrollWidth > width ? ["the page scrolls sideways"] : [];
  const inMap = (node) => node.closest(".leaflet-container") !== null;
  for (const node of document.querySelectorAll("body *")) {
    if (inMap(node) || node.closest("svg") || !node.checkVisibility()) continue;
    const { left, right, width: own } = node.getBoundingClientRect();
    if (own && (right > width + 0.5 || left < -0.5)) found.push(node.outerHTML.slice(0, 90));
  }
  return found;
}"""
_TOO_SMALL = """(least) => {
  const found = [];
  const pressed = "button, a[href], input, select, textarea, summary, [role=button]";
  for (const node of document.querySelectorAll(pressed)) {
    if (!node.checkVisibility({ visibilityProperty: true })) continue;
    const { width, height } = node.getBoundingClientRect();
    if (width && (width < least - 0.5 || height < least - 0.5))
      found.push(`${width.toFixed(0)} x ${height.toFixed(0)}: ${node.outerHTML.slice(0, 90)}`);
  }
  return found;
}"""
