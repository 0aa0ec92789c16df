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
"""In a real browser: four languages without a cut text, units, the form of coordinates, help."""

from __future__ import annotations

import re

import pytest
from browser import DESK, LEVEL, PHONE
from page_backend import GO, LOST
from served_page import corner_in, press, well

LOCALES = {"en": "en-GB", "de": "de-DE", "fr": "fr-FR", "es": "es-ES"}
WORDS = ["GO", "NO GO", "NO DATA", "NO VIDEO", "WAIT", "CAUTION", "LOST"]
#: The page's words for a text of the server.
SAID = """async (text) => (await import("/static/js/shell/language.js")).said(text)"""
#: Buttons and labels whose text is wider or higher than they are, or stands out of its button.
CUT = """() => {
  const found = [];
  const rooms = "#bar, #tools, #rewind, #look, #tabs, #panel, #menu, #help, #toast, #banner";
  const labels = ":is(button, .button, h2, h3, dt, dd, small, label, option, b, strong, span)";
  for (const node of document.querySelectorAll(`:is(${rooms}) ${labels}`)) {
    if (!node.checkVisibility({ visibilityProperty: true })) continue;
    if (node.matches(".badge, .badge *, :has(> .badge)")) continue; // its number stands out
    const { display, clipPath } = getComputedStyle(node);
    if (clipPath !== "none") continue; // read aloud alone
    const { left, right } = node.getBoundingClientRect();
    const button = node.closest("button, body").getBoundingClientRect();
    const isWide = display !== "inline" && node.scrollWidth > node.clientWidth;
    const isHigh = node.tagName === "BUTTON" && node.scrollHeight > node.clientHeight;
    const isOut = right - left > 1 && (left < button.left - 0.5 || right > button.right + 0.5);
    if (isWide || isHigh || isOut) found.push(node.outerHTML.slice(0, 120));
  }
  return found;
}"""


def seen_parts(screen):
    """Open each part of the page in turn."""
    yield "list"
    for tap in ("#still", "#still", "#look-button", "#look-button", "#export", ".row", "#refine"):
        screen.tap_on(tap)
        yield tap
    screen.tap_on("[role=tab][data-tab=checks]")
    yield "checks"
    screen.tap_on("#menu-button")
    screen.one("#menu").wait_for()
    yield "menu"
    screen.page.keyboard.press("Escape")
    screen.tap_on("#help-button")
    for mode in ("video", "still", "picture", "map", "targets", "checks", "keys"):
        screen.tap_on(f"#help [data-mode={mode}]")
        yield mode
    screen.page.keyboard.press("Escape")


@pytest.mark.parametrize(
    ("language", "size"),
    [
        pytest.param(language, size, marks=[] if language == "de" else [pytest.mark.slow])
        for language in LOCALES
        for size in (PHONE, LEVEL, DESK)
    ],
)
def test_no_text_is_cut(serve, tablet, monkeypatch, language, size):
    said = dict(GO)
    well(monkeypatch, verdict=said)
    screen = tablet(serve().url, size, locale=LOCALES[language])
    assert screen.page.locator("html").get_attribute("lang") == language
    press(screen)
    for part in seen_parts(screen):
        assert screen.page.evaluate(CUT) == [], part
    words = [screen.page.evaluate(SAID, word) for word in WORDS]
    assert len(set(words)) == len(WORDS)
    for word, own in zip(WORDS, words, strict=True):
        said["word"] = word
        screen.wait("(own) => document.querySelector('#verdict').innerText === own", own)
        assert screen.page.evaluate(CUT) == [], word


@pytest.mark.parametrize("language", LOCALES)
def test_no_phone_lacks_a_button_or_cuts_its_words(serve, tablet, language):
    """The menu was beside the screen of phones that are 430 to 450 wide."""
    screen = tablet(serve().url, PHONE, locale=LOCALES[language])
    screen.await_picture()
    for wide, high in PHONES:
        screen.page.set_viewport_size({"width": wide, "height": high})
        found = [*screen.too_wide(), *screen.page.evaluate(CUT)]
        assert found == [], (wide, high)


PHONES = [(360, 740), (412, 915), (430, 932), (440, 956), (519, 900), (520, 900), (699, 1000)]
PHONES += [(high, wide) for wide, high in PHONES if high < 1000] + [(667, 375), (960, 600)]


@pytest.mark.parametrize("language", LOCALES)
def test_a_phone_on_its_side_shows_the_numbers_on_its_tabs(serve, tablet, monkeypatch, language):
    finding = {"severity": "NOTE", "subject": "", "evidence": "", "parameter": "", "remedy": ""}
    well(monkeypatch, findings=[finding] * 12)
    screen = tablet(serve().url, (844, 390), locale=LOCALES[language])
    press(screen)
    screen.reads("[data-tab=targets] .count", "1")
    screen.reads("[data-tab=checks] .count", "12")
    assert screen.page.evaluate(CUT) == []


@pytest.mark.parametrize("language", LOCALES)
@pytest.mark.parametrize("size", [PHONE, (844, 390)])
def test_a_phones_banner_says_all_of_it(serve, tablet, monkeypatch, size, language):
    """The line that sound comes after a press was cut."""
    well(monkeypatch, verdict=LOST | {"alarm": True})
    screen = tablet(serve("B1", "B2").url, size, locale=LOCALES[language])
    screen.one("#banner .hint", has_text=re.compile("[a-z]")).wait_for()
    assert screen.page.locator("#banner .grow").evaluate(_IS_WHOLE)


_IS_WHOLE = "({ scrollHeight, clientHeight }) => scrollHeight <= clientHeight"


@pytest.mark.parametrize("language", LOCALES)
def test_a_message_of_a_small_phone_is_beside_its_button(serve, tablet, language):
    screen = tablet(serve().url, (667, 375), locale=LOCALES[language])
    screen.tap(*screen.on_screen(*corner_in(screen.hold_still())))
    screen.reads("#toast", "1")
    assert screen.page.locator("#toast .grow").evaluate(
        "({ scrollWidth, clientWidth }) => scrollWidth <= clientWidth"
    )


@pytest.mark.parametrize("language", LOCALES)
def test_no_text_of_a_viewer_is_cut(serve, tablet, monkeypatch, language):
    well(monkeypatch, verdict=GO | {"word": "CAUTION", "tone": "caution"})
    page = serve(token="operator-token-1", viewer_token="viewer-token-123")
    screen = tablet(page.server.viewer_url, PHONE, locale=LOCALES[language])
    screen.await_picture()
    assert screen.page.evaluate(CUT) == []


def test_language_units_and_form_are_chosen_in_the_menu_and_remembered(serve, tablet, monkeypatch):
    well(monkeypatch)
    screen = tablet(serve().url, DESK)
    press(screen)
    screen.tap_on("#menu-button")
    screen.one("[data-setting=units]").select_option("feet")
    screen.one("[data-setting=form]").select_option("utm")
    screen.one("[data-setting=language]").select_option("fr")
    for _ in range(2):  # the second time after another load
        screen.reads("#tabs", "Cibles")
        assert screen.page.locator("html").get_attribute("lang") == "fr"
        screen.reads("#readings", "131 ft")
        screen.reads("#readings", "kn")
        screen.reads(".leaflet-control-scale", "ft")
        screen.reads(".row", "33U")
        screen.tap_on(".row")
        screen.reads(".coordinate:first-child", "UTM")
        screen.reads("#target-card .facts", " ft")
        screen.reload()
        screen.await_picture()


def test_a_fixed_text_of_the_server_is_read_in_the_screens_language(serve, tablet, monkeypatch):
    text = "The gimbal is silent for 8 s"
    well(monkeypatch, verdict=GO | {"word": "NO DATA", "tone": "bad", "text": text})
    screen = tablet(serve().url, locale="de-DE")
    screen.reads("#verdict", "OHNE DATEN")
    screen.reads("#banner", "Der Gimbal schweigt seit 8 s")
    for english, german in {
        "recording to bags/1": "Aufnahme in bags/1",
        "NO MAP: no pose at this frame": "KEINE KARTE: keine Pose zu diesem Bild",
        "NO MAP: <b>{0}</b>; 3 of 4": "KEINE KARTE: <b>{0}</b>; 3 of 4",
        "constructor": "constructor",
    }.items():
        assert screen.page.evaluate(SAID, english) == german
