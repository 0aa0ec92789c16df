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
"""The operator's own picture: palettes, tones, isotherm, and the panel that sets them."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from browser import DESK
from page_backend import CELSIUS
from painted_map import looked
from playwright.sync_api import expect
from served_page import well

from tirgeo_ros.core.config.overlay_parameters import PALETTES, PictureConfig
from tirgeo_ros.core.overlay.picture_painter import ToneMapper

RAMP = np.arange(256, dtype=np.uint8)[None].repeat(4, axis=0)
#: Sixteen colours, with straight lines between them, against all 256: at most, and rms.
MOST_OFF, MOST_RMS = 11, 2.0


@pytest.mark.parametrize("palette", PALETTES)
def test_palettes_are_those_of_the_overlay(screen, palette):
    wanted = ToneMapper(PictureConfig(), palette).tone(RAMP, 0).astype(float)
    off = looked(screen, RAMP, palette=palette) - wanted
    assert np.abs(off).max() <= MOST_OFF
    assert np.sqrt((off**2).mean()) <= MOST_RMS


def test_brightness_and_contrast_move_the_tones(screen):
    grey = RAMP[0].astype(float)
    brighter = looked(screen, RAMP, brightness=40)[0, :, 0]
    assert brighter == pytest.approx(np.clip(grey + 51, 0, 255), abs=1)
    harder = looked(screen, RAMP, contrast=50)[0, :, 0]
    assert harder == pytest.approx(np.clip(127.5 + 2 * (grey - 127.5), 0, 255), abs=1)


def test_local_contrast_enlarges_what_is_small_alone(screen):
    large = np.tile(np.linspace(60, 180, 320), (256, 1))
    small = 6 * np.sign(np.sin(np.arange(320) * np.pi / 3))
    shown = looked(screen, np.rint(large + small).astype(np.uint8), local=50)[128, 60:-60, 0]
    large_shown = cv2.blur(shown[None].astype(np.float32), (6, 1))[0]
    assert large_shown == pytest.approx(large[128, 60:-60], abs=10)
    assert np.ptp(shown[120:126]) > 1.8 * 2 * 6


@pytest.mark.parametrize(
    ("celsius", "wish", "first"),
    [
        ((10.0, 61.0), {"degrees": 30.0}, 100),
        (None, {"percent": 80.0}, 204),
        ((10.0, 61.0), {"degrees": 300.0}, 256),
        ((10.0, 61.0), {"degrees": -9.0}, 0),
    ],
)
def test_all_above_the_isotherm_has_a_colour(screen, celsius, wish, first):
    shown = looked(screen, RAMP, celsius, isotherm=True, **wish)[0].astype(int)
    coloured = np.ptp(shown, axis=1) > 60
    assert np.array_equal(coloured, np.arange(256) >= first)


def test_a_hot_spot_beyond_the_scale_is_never_said_to_be_just_as_hot(screen):
    """The JPEG makes a clipped 255 a little less: a fire had read as 43 degrees."""
    heat = np.full((128, 160), 110.0)
    for k in range(8):
        heat[16 * k + 3 : 16 * k + 12, 19 * k : 19 * k + 9] = 1000
    grey = np.clip(cv2.GaussianBlur(heat, (0, 0), 0.8), 0, 255).astype(np.uint8)
    coded = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
    inside = cv2.erode(grey, np.ones((5, 5), np.uint8)) == 255
    spots = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)[inside]
    assert (spots < 255).any()
    words = screen.page.evaluate(_DEGREES, [[*spots.tolist(), 110], [10.0, 44.0]])
    assert all(word.startswith("≥ ") for word in words[:-1])
    assert words[-1] == "24.7 °C"


_DEGREES = """async ([greys, celsius]) => {
  const { degreesWords } = await import("/static/js/video/thermometer.js");
  return greys.map((grey) => degreesWords(grey, celsius));
}"""


def test_a_still_picture_has_its_palette_at_its_own_quality(screen):
    """It had stayed as coarse as the live one that came before, of the same stamp and size."""
    assert screen.page.evaluate(_TWO_OF_ONE_STAMP) == [200, 60]


_TWO_OF_ONE_STAMP = """async () => {
  const { Picture } = await import("/static/js/video/picture.js");
  const { PLAIN } = await import("/static/js/video/look_values.js");
  const picture = new Picture();
  const look = { ...PLAIN, palette: "black_hot" };
  const shown = [];
  for (const grey of [55, 195]) {
    const pixel = Uint8ClampedArray.of(grey, grey, grey, 255);
    const bitmap = await createImageBitmap(new ImageData(pixel, 1));
    const frame = { stampNs: "1", width: 1, height: 1, bitmap, shapes: { grey: true } };
    const canvas = picture.of(frame, look);
    shown.push(canvas.getContext("2d").getImageData(0, 0, 1, 1).data[0]);
  }
  return shown;
}"""


def test_a_colour_picture_has_no_palette_and_no_isotherm(screen):
    shown = looked(screen, RAMP, thermal=False, palette="iron", isotherm=True, percent=10)
    assert np.array_equal(shown[:, :, 0], RAMP)
    assert np.ptp(shown, axis=2).max() == 0
    assert looked(screen, RAMP, thermal=False, brightness=100)[0, 200, 0] == 255


def test_the_panel_changes_the_picture_at_once_and_the_screen_remembers_it(
    serve, tablet, monkeypatch
):
    well(monkeypatch)
    screen = tablet(serve().url, DESK)
    screen.await_picture()
    screen.tap_on("#look-button")
    screen.tap_on(".palettes button:has-text('Lava')")
    _, left, top = screen.video()
    screen.page.mouse.move(left + 300, top + 300)
    screen.reads(".degrees", "°C")
    degrees = float(screen.one(".degrees").inner_text().split()[-2])
    assert CELSIUS[0] <= degrees <= CELSIUS[1]
    screen.hold_still()
    becomes_red(screen)
    screen.tap_on(".palettes button:has-text('White hot')")  # also on a still picture
    becomes_grey(screen)
    screen.tap_on(".palettes button:has-text('Lava')")
    becomes_red(screen)
    screen.reload()
    becomes_red(screen)
    screen.tap_on("#look-button")
    screen.tap_on("#look-plain")
    becomes_grey(screen)


def test_an_isotherm_above_the_scale_says_why_nothing_has_its_colour(serve, tablet, monkeypatch):
    """Of a picture's hottest hundredth no temperature is known: a fire was as white as a roof."""
    well(monkeypatch)
    screen = tablet(serve().url, DESK)
    screen.await_picture()
    screen.tap_on("#look-button")
    screen.tap_on("#look .switch[aria-label=Isotherm]")
    words = screen.page.locator("#look .quiet", has_text=f"ends at {CELSIUS[1]:.1f} °C")
    for degrees, shown in ((CELSIUS[1] + 1, 1), (CELSIUS[1] - 1, 0)):
        look = screen.page.evaluate(_LOOK_OF_STORE)
        screen.set(look={**look, "degrees": degrees})
        expect(words.locator("visible=true")).to_have_count(shown)


_LOOK_OF_STORE = """async () => {
  const { store } = await import("/static/js/store.js");
  return store.get("look");
}"""


def becomes_red(screen):
    screen.awaits(lambda: reddish(screen) > 30)


def becomes_grey(screen):
    screen.awaits(lambda: reddish(screen) < 5)


def reddish(screen):
    """Return how much redder than blue the median pixel of the video is."""
    image = cv2.imdecode(np.frombuffer(screen.video()[0], np.uint8), cv2.IMREAD_COLOR)
    blue, _, red = np.moveaxis(image.astype(int), 2, 0)
    return np.median((red - blue)[100:-100])


@pytest.mark.parametrize(
    "kept",
    [
        {"layersOff": None},
        {"mapOff": 5, "filter": {"kinds": "fire"}},
        {"look": {"contrast": "much"}, "kind": 7, "units": None, "theme": {}, "form": []},
    ],
    ids=str,
)
def test_settings_of_another_form_are_not_taken(serve, tablet, kept):
    """As of another version: one wrong list had left the screen without video for ever."""
    screen = tablet(serve().url, DESK)
    screen.page.evaluate("(kept) => localStorage.setItem('tirgeo', kept)", json.dumps(kept))
    screen.reload()
    screen.await_picture()
    screen.tap_on("#look-button")
    screen.reads(".layer-row", "plots")
    screen.awaits(lambda: 40 < screen.page.evaluate(_MEDIAN) < 110)


_MEDIAN = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { canvas, context } = stageOf("").painter;
  const { data } = context.getImageData(0, canvas.height / 3, canvas.width, canvas.height / 3);
  return data.filter((_, k) => k % 4 === 1).sort()[data.length / 8];
}"""
