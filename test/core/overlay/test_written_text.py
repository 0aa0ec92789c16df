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
"""The text on the picture: for every state of the filter, cut to fit, legible, any script."""

import dataclasses
import math
import time
import tracemalloc

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st
from overlays import PLANE, SQUARE_N, geo, luminance
from PIL import Image, ImageDraw, ImageFont

from tirgeo_ros.core.map.vector_map import MapLayer
from tirgeo_ros.core.overlay import written_text as text
from tirgeo_ros.core.overlay.map_shapes import drape_layers
from tirgeo_ros.core.overlay.written_text import (
    TEXT_BGR,
    Field,
    coverage,
    fitted,
    paint_notice,
    paint_status,
    passing_stamp,
    stamp,
    status_line,
)
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus

PLAIN = NavigationStatus("ekf_heading", FilterState.RUNNING, "", FixStatus.FIXED, 0.002, {}, {})


def status(**changes):
    return dataclasses.replace(PLAIN, **changes)


def texts(fields):
    return [field.text + field.detail for field in fields]


@pytest.mark.parametrize(
    ("state", "reason", "state_s", "words"),
    [
        (FilterState.DEGRADED, "rtk/heading", 12.4, "degraded 12 s: rtk/heading"),
        (FilterState.WAITING, "no rtk/fix", 250.0, "waiting 4 min: no rtk/fix"),
        (FilterState.LOST, "position sigma 11 m", 99.0, "lost 99 s: position sigma 11 m"),
    ],
)
def test_a_state_that_is_not_running_comes_first(state, reason, state_s, words):
    fields = status_line(status(state=state, reason=reason, state_s=state_s), 0.083, 8.0)
    assert texts(fields)[:2] == [words, "filter"]
    assert fields[0].colour != TEXT_BGR


def test_what_is_known_is_shown():
    assert texts(status_line(None, 0.05, 9.0)) == ["no filter status", "age 50 ms", "video 9.0 Hz"]
    assert texts(status_line(PLAIN, 0.083, math.nan, above_m=46.6, dropped=2)) == [
        "filter",
        "RTK fixed",
        "47 m above ground",
        "heading sigma 0.11 deg",
        "age 83 ms",
        "video starts",
        "dropped 2",
    ]
    below = status_line(PLAIN, 0.083, 29.97, above_m=-46.0)
    assert "46 m below ground" in texts(below)
    assert {field.colour for field in below} != {TEXT_BGR}


@pytest.mark.parametrize("state", list(FilterState))
def test_state_method_and_fix_are_whole_on_a_thermal_picture(state):
    """640 px and the text as large as it is there: the words that matter stay."""
    reports = status(
        state=state,
        reason="rtk/fix, rtk/vel, rtk/heading, gps/fix",
        state_s=5999.0,
        heading_sigma_rad=0.17,
    )
    kept = texts(fitted(status_line(reports, 9.999, 60.0), 640, 15))
    assert {"filter", "RTK fixed", "heading sigma 9.74 deg"} <= set(kept)


LINE = [
    Field("degraded 12 s", detail=": no rtk/fix, no rtk/vel, no rtk/heading"),
    Field("ekf_heading"),
    Field("RTK none"),
    Field("heading sigma 0.11 deg"),
    Field("frame age 83 ms", spare=True),
    Field("video 9.0 Hz", spare=True),
]


@pytest.mark.parametrize(("width", "shown"), [(1280, 6), (560, 4), (320, 3), (120, 1), (8, 1)])
def test_the_status_line_fits_the_picture(width, shown):
    kept = fitted(LINE, width, 12)
    assert [field.text for field in kept] == [field.text for field in LINE[:shown]]
    image = np.full((20, width, 3), 128, np.uint8)
    paint_status(image, LINE)
    assert width < 100 or not (image[:, -2:] > 240).all(axis=2).any()


def test_a_long_notice_takes_several_lines():
    notice = "NO MAP: lost: position sigma 10.2 m, heading sigma 11.3 deg, and nothing to measure"
    for width in (640, 320, 160):
        rows = []
        for words in (notice, "NO MAP:"):
            image = np.full((512, width, 3), 128, np.uint8)
            paint_notice(image, words)
            changed = (image != 128).any(axis=2)
            assert not changed[:, [0, -1]].any()
            rows.append(np.flatnonzero(changed.any(axis=1)).size)
        assert rows[0] > rows[1]


@pytest.mark.parametrize("ground", [(255, 255, 255), (0, 255, 255), (0, 0, 0)])
def test_every_colour_of_the_text_stands_out_from_its_strip(ground):
    """4.5 to 1: level AA of WCAG 2 for small text."""
    image = np.full((512, 640, 3), ground, np.uint8)
    paint_status(image, [])
    under = luminance(image[-1, 320])
    states = [status_line(status(state=state), 0.0, 8.0, 0.1) for state in FilterState]
    for colour in {field.colour for fields in states for field in fields}:
        assert (luminance(colour) + 0.05) / (under + 0.05) >= 4.5


@pytest.mark.parametrize("letters", ["x" * 20_000, "word " * 4_000])
def test_a_text_from_outside_is_cut_before_it_is_measured(letters):
    """It took a second for every few hundred letters; now a frame's time and no more."""
    image = np.zeros((512, 640, 3), np.uint8)
    begin_s = time.monotonic()
    reports = status(method=letters, state=FilterState.LOST, reason=letters, state_s=1.0)
    paint_status(image, status_line(reports, 0.1, 8.0))
    paint_notice(image, f"NO MAP: {letters}")
    assert time.monotonic() - begin_s < 5.0
    assert image.any()


def paint(seconds):
    reason = ": rtk/fix refused: older than max_delay_s or the alignment, rtk/vel refused as well"
    for second in seconds:
        picture = np.zeros((512, 640, 3), np.uint8)
        paint_status(picture, [Field(f"degraded {second} s", detail=reason), Field("RTK fixed")])
        paint_notice(picture, f"NO MAP: pose {second / 10:.1f} s old, and rtk/fix is missing")


def test_an_hour_of_seconds_is_not_remembered():
    paint(range(100))
    tracemalloc.start()
    try:
        paint(range(100, 130))
        before, _ = tracemalloc.get_traced_memory()
        paint(range(130, 400))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # The texts that were remembered before change for newer ones, of other lengths at the most.
    assert after - before < 1_000_000


HERE = [name for name in text._TYPEFACES if text._has(name, "\u00fc")]  # on this machine


@pytest.mark.parametrize("name", HERE[:2])
def test_accents_are_letters_and_not_boxes(name):
    """The accented letter is the plain one and something above it."""
    plain, accented = (text.coverage(letter, 24, name) for letter in "u\u00fc")
    assert plain.shape[0] == accented.shape[0]
    body = np.flatnonzero(plain.max(axis=1) > 60)[[0, -1]]
    same = plain[body[0] + 1 : body[1]].astype(int) - accented[body[0] + 1 : body[1]]
    assert np.abs(same).max() <= 60
    assert accented[: body[0] - 1].max() > 120


@pytest.mark.skipif(not hasattr(cv2, "FontFace"), reason="OpenCV 4 has no typeface of its own")
def test_chinese():
    one, other = coverage("\u82b1", 24), coverage("\u575b", 24)
    assert one.shape != other.shape or np.abs(one.astype(int) - other).max() > 200


def ink(bitmap):
    """Where there is ink, in a sheet around the middle of all."""
    bitmap = np.pad(np.asarray(bitmap) > 100, 200)
    rows, columns = np.nonzero(bitmap)
    middle = (rows.min() + rows.max()) // 2, (columns.min() + columns.max()) // 2
    return bitmap[middle[0] - 40 : middle[0] + 40, middle[1] - 150 : middle[1] + 150]


def is_within_a_pixel(one, other):
    """The layouts round each letter's place in their own way."""
    near = cv2.dilate(other.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return not (one & ~near).any()


DEJAVU = text._font("DejaVuSans", 40).getname()[0] == "DejaVu Sans"


@pytest.mark.skipif(not (text.can_shape() and DEJAVU), reason="no libfribidi0 or no DejaVu Sans")
@pytest.mark.parametrize(
    ("words", "glyphs"),
    [
        ("\u05e9\u05dc\u05d5\u05dd", "\u05dd\u05d5\u05dc\u05e9"),  # shalom
        ("\u05d1\u05d9\u05ea 12", "12 \u05ea\u05d9\u05d1"),
        # A hospital; to the right its letters' initial, medial and final forms.
        ("\u0645\u0633\u062a\u0634\u0641\u0649", "\ufef0\ufed4\ufeb8\ufe98\ufeb4\ufee3"),
    ],
)
def test_right_to_left_is_written_so_and_joined(words, glyphs):
    """As the same glyphs from left to right, in a layout that leaves them as they are."""
    font = ImageFont.truetype("DejaVuSans.ttf", 40, layout_engine=ImageFont.Layout.BASIC)
    sheet = Image.new("L", (600, 100))
    ImageDraw.Draw(sheet).text((9, 9), glyphs, fill=255, font=font)
    assert text.writable(words) == words
    drawn, wanted = ink(coverage(words, 40)), ink(sheet)
    assert is_within_a_pixel(drawn, wanted)
    assert is_within_a_pixel(wanted, drawn)


@pytest.mark.parametrize(
    ("words", "written"),
    [
        ("\U0001f6e9 Rose \ufe0f", "Rose"),  # an aeroplane, and a selector without its emoji
        ("u\u0308ber a\u200db", "\u00fcber a\u200db"),
        ("\U00012000 4", ""),  # cuneiform: no typeface has it
        ("\u05d1\u05d9\u05ea 4", ""),  # Hebrew, without FriBiDi
    ],
)
def test_what_cannot_be_written_is_left_out(monkeypatch, words, written):
    """And a message that has it keeps the rest."""
    monkeypatch.setattr(text, "can_shape", lambda: False)
    monkeypatch.setattr(text, "_has", text._has.__wrapped__)
    stamp.cache_clear()
    assert text.writable(words) == written
    assert stamp(words, 24, TEXT_BGR).ink.any() == bool(written)
    assert passing_stamp(f"NO MAP: {words}", 24, TEXT_BGR).size[0] > 90
    layer = MapLayer("m", [geo(SQUARE_N, words), geo(SQUARE_N, "plain")])
    draped = drape_layers([layer], PLANE, 25.0).map
    assert draped.labelled.tolist() == [bool(written), True]
    assert ("map: labels not drawn: 1, such as" in str(draped.notes)) is not bool(written)


def test_control_characters_and_length():
    np.testing.assert_array_equal(stamp("a\nb", 12, TEXT_BGR).ink, stamp("a b", 12, TEXT_BGR).ink)
    assert stamp("m" * 500, 12, TEXT_BGR).size[0] < stamp("m" * 61, 12, TEXT_BGR).size[0] + 1
    assert stamp("", 12, TEXT_BGR).ink.max() == 0


@given(left=st.integers(-80, 80), top=st.integers(-40, 60))
def test_a_bitmap_drawn_anywhere_changes_only_its_place(left, top):
    rng = np.random.default_rng(1)
    image = rng.integers(0, 255, (40, 60, 3), np.uint8)
    bitmap = stamp("Abc", 12, TEXT_BGR)
    assert (bitmap.keep.astype(int) + bitmap.ink <= 255).all()  # no overflow on any picture
    width, height = bitmap.size
    canvas = np.zeros((200, 300, 3), np.uint8)
    canvas[100:140, 100:160] = image
    place = np.s_[100 + top : 100 + top + height, 100 + left : 100 + left + width]
    wanted = canvas.astype(float)
    wanted[place] = canvas[place] * (bitmap.keep / 255) + bitmap.ink
    bitmap.draw(image, left, top)
    np.testing.assert_allclose(image, wanted[100:140, 100:160], atol=0.5 + 1e-9)  # rounding
