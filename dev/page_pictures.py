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
"""Take the pictures of docs/operator.md and of the README from the running page.

``python -m dev.page_pictures docs`` starts ``tirgeo demo --page`` at half speed, presses on it as
an operator would, and leaves operator_*.jpg and page.webp in the folder. Needs Playwright and
Chromium, which the tests use too. A busy computer shows NO MAP; then wait and run it again.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page

from dev.graphs import chromium, end_demo, listening_team, shown_demo

_RATE = 0.5
_LIMIT_S = 120.0
_WIDE, _PHONE, _TABLET, _HIGH = (1280, 800), (390, 844), (820, 1180), (1200, 1500)
_FILM_S, _FILM_PX, _FILM_QUALITY = 20.0, (720, 450), 28
_QUALITY = 72
#: Where to press in the picture of 640 x 512: on the ground, and into its upper edge.
_PLACES = ((330, 300), (200, 380), (470, 260))


def main() -> int:
    """Take all pictures."""
    parser = argparse.ArgumentParser(prog="page_pictures", description=__doc__)
    parser.add_argument("folder", type=Path)
    asked = parser.parse_args()
    with (
        listening_team() as team,
        tempfile.TemporaryDirectory() as name,
        shown_demo(Path(name), "--cot", team, "--rate", str(_RATE)) as (url, demo),
        chromium() as page,
    ):
        Pictures(page, url, asked.folder).take(partial(end_demo, demo))
    return 0


class Pictures:
    """Press on the page and take pictures of it."""

    def __init__(self, page: Page, url: str, folder: Path) -> None:
        assert page.context.browser is not None
        self._browser, self._url, self._folder = page.context.browser, url, folder

    def take(self, stop: Callable[[], None]) -> None:
        """Take all; ``stop`` ends the demo, for the picture of a lost connection."""
        wide = self._open(_WIDE)
        self._film(wide)
        self._save(wide, "flight")
        wide.locator("#share").click()
        wide.locator("#share", has_text="Shared").wait_for()
        self._save(wide, "shared")
        wide.locator("#banner").wait_for()  # the flight begins again: there is no pose yet
        self._press(wide, *_PLACES[0])
        self._save(wide, "refused")
        high = self._open(_HIGH)
        high.locator(".row").last.click()
        self._well(high)
        self._save(high, "target", "#panel")
        high.locator("[role=tab][data-tab=checks]").click()
        high.wait_for_timeout(400)
        self._save(high, "checks", "#panel")
        phone = self._open(_PHONE)
        self._well(phone)
        self._save(phone, "phone")
        tablet = self._open(_TABLET)
        tablet.locator("#night").click()
        self._well(tablet)
        self._save(tablet, "red")
        stop()
        tablet.wait_for_timeout(4000)
        self._save(tablet, "lost")

    def _open(self, size: tuple[int, int]) -> Page:
        width, height = size
        context = self._browser.new_context(viewport={"width": width, "height": height})
        context.set_default_timeout(_LIMIT_S * 1000)
        page = context.new_page()
        page.goto(self._url)
        page.locator(".stage canvas").wait_for()
        return page

    def _well(self, page: Page) -> None:
        """Wait until nothing has been wrong for two seconds."""
        quiet_s, end_s = time.monotonic(), time.monotonic() + _LIMIT_S
        while time.monotonic() - quiet_s < 2.0 and time.monotonic() < end_s:
            if any(page.locator(part).is_visible() for part in ("#banner", ".words-over")):
                quiet_s = time.monotonic()
            page.wait_for_timeout(100)

    def _press(self, page: Page, u: float, v: float) -> None:
        """Press on a pixel of the video."""
        box = page.locator(".stage canvas").bounding_box()
        assert box is not None
        scale = min(box["width"] / 640, box["height"] / 512)
        left = box["x"] + (box["width"] - 640 * scale) / 2
        top = box["y"] + (box["height"] - 512 * scale) / 2
        page.mouse.click(left + u * scale, top + v * scale)
        page.wait_for_timeout(700)

    def _film(self, page: Page) -> None:
        """Film 20 s of flight with some presses, at the flight's own speed."""
        self._well(page)
        acts: dict[float, Callable[[], object]] = {
            2.0: lambda: self._press(page, *_PLACES[0]),
            6.0: page.locator(".kind[data-kind=fire]").first.click,
            7.0: lambda: self._press(page, *_PLACES[1]),
            11.0: lambda: self._press(page, *_PLACES[2]),
            14.0: page.locator(".row").first.click,
            18.0: page.get_by_text("List", exact=True).click,
        }
        frames, times_s = list[Image.Image](), list[float]()
        start_s = time.monotonic()
        while (now_s := (time.monotonic() - start_s) * _RATE) < _FILM_S:
            for due_s in [due_s for due_s in acts if due_s <= now_s]:
                acts.pop(due_s)()
            picture = Image.open(io.BytesIO(page.screenshot(type="jpeg", quality=90)))
            frames.append(picture.resize(_FILM_PX, Image.Resampling.LANCZOS))
            times_s.append(now_s)
            page.wait_for_timeout(430)  # some 70 pictures in all
        lasts_ms = np.rint(1000 * np.diff([*times_s, _FILM_S])).astype(int).tolist()
        film = {"save_all": True, "append_images": frames[1:], "duration": lasts_ms, "loop": 0}
        frames[0].save(self._folder / "page.webp", quality=_FILM_QUALITY, method=6, **film)

    def _save(self, page: Page, name: str, part: str = "body") -> None:
        page.locator(part).first.screenshot(
            path=self._folder / f"operator_{name}.jpg", type="jpeg", quality=_QUALITY
        )


if __name__ == "__main__":
    sys.exit(main())
