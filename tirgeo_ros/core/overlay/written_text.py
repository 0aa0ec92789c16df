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
"""Render text in any script as small bitmaps, each rendered once and then copied to pictures.

OpenCV 5 writes UTF-8 with its own typeface, each letter by itself and from left to right. Pillow
writes all other text, and all text with OpenCV 4, with a typeface of the system. Text that neither
can write is left out; question marks or reversed words are never drawn.

The status line at the bottom shows the checks' verdict, the filter, the height and the video. The
filter's state is shown, with its duration and reason, unless it is ``running``. Notices are at the
top.
"""

from __future__ import annotations

import math
import re
import unicodedata
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont, features

from tirgeo_ros.core.map.vector_map import Colour
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import cut
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus

TEXT_BGR: Colour = (255, 255, 255)
LONGEST = 60  # characters
_CACHED, _PASSING = 1024, 24  # number of texts
#: The text size is these fractions of a picture's width and height: 9 px on a phone 360 px wide.
_WIDTH_PARTS, _HEIGHT_PARTS = 42, 24
_SMALLEST_PX, _LARGEST_PX = 12, 64  # smaller is not legible, whatever the picture
_LEAST_HALO_PX, _HALO_PART = 2, 1 / 8  # of the text's size, on each side
_WEIGHT = 500  # of OpenCV's typeface: 400 is regular, 700 bold
_OPENCV = "sans"
_SYSTEM = "DejaVuSans NotoSans-Regular LiberationSans-Regular FreeSans NotoSansDevanagari-Regular"
#: In order of preference; DejaVu Sans has Hebrew and Arabic, FreeSans Indic scripts and Thai.
_TYPEFACES = ([_OPENCV] if hasattr(cv2, "FontFace") else []) + _SYSTEM.split()
_LETTERS = 4096  # number of letters for which it is cached whether a typeface has them
_JOINERS = "\u200c\u200d\u200e\u200f"  # invisible; they control how their neighbours join
_VARIATIONS = re.compile("[\ufe00-\ufe0f]")  # a choice between an emoji and a plain symbol
_NOT_ASCII = re.compile("[^ -~]+")
_NO_LETTER = "\U0010ffff"  # never assigned
# Notices, and the layout of the status line.
NOTICE_BGR: Colour = (80, 200, 255)
LONGEST_NOTICE = 300  # characters; more would cover a small picture with text
_NOTICE_TIMES = 1.25  # size of a large notice, relative to plain text
#: Brightness that remains under the status line: low enough that every colour of its text has a
#: contrast of 4.5 to 1 even on a white picture (WCAG 2, relative luminance).
_STRIP_LIGHT = 0.14
_GAP_PARTS, _EDGE_PARTS = 0.7, 0.4  # in sizes of the status line's text
_LEAST_DETAIL = 6  # characters; a detail cut shorter than this is useless
# The contents of the status line.
_METHODS = {
    "raw": "autopilot alone",
    "rtk": "RTK, autopilot's attitude",
    "ekf": "filter without heading",
    "ekf_heading": "filter",
}
_ORANGE_BGR: Colour = (60, 140, 255)
_RED_BGR: Colour = (100, 100, 255)
_COLOURS = {FilterState.DEAD_RECKONING: _ORANGE_BGR, FilterState.LOST: _RED_BGR}
#: Colour by the checks' verdict, in the status line and in the notice.
VERDICT_BGR = {Severity.NOTE: TEXT_BGR, Severity.CAUTION: NOTICE_BGR, Severity.STOP: _ORANGE_BGR}
_VERDICTS = {Severity.CAUTION: "CAUTION", Severity.STOP: "NO GO"}
_CLOCK_STEP_S = 0.02
_BELOW_M = 2.0  # tolerance: the camera is on the landing gear, the ground known to a metre


def text_px(image: Pixels) -> int:
    """Return the size of plain text on a picture (h, w, ...), px."""
    height, width = image.shape[:2]
    fits = round(min(width / _WIDTH_PARTS, height / _HEIGHT_PARTS))
    return int(min(max(fits, _SMALLEST_PX), _LARGEST_PX))


def line_px(size_px: int) -> int:
    """Return the height, px, of a line of text with its halo; a tall letter may need more."""
    return size_px + size_px // 3 + 2 * _halo_px(size_px)


def _halo_px(size_px: int) -> int:
    return max(round(size_px * _HALO_PART), _LEAST_HALO_PX)


@lru_cache(maxsize=8)
def _disc(radius_px: int) -> Pixels:
    side = 2 * radius_px + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


class Box(NamedTuple):
    """Hold a rectangle of pixels; ``right`` and ``bottom`` are the first pixels outside."""

    left: int
    top: int
    right: int
    bottom: int

    def meets(self, other: Box) -> bool:
        """Return whether the boxes overlap."""
        beside = self.left >= other.right or other.left >= self.right
        return not (beside or self.top >= other.bottom or other.top >= self.bottom)


@dataclass(frozen=True, slots=True)
class TextBitmap:
    """Hold a text ready to be drawn on a picture: ``picture * keep / 255 + ink``."""

    keep: Pixels  # (h, w, 3)
    ink: Pixels  # (h, w, 3)

    @classmethod
    def of(cls, alpha: cv2.typing.MatLike, halo: cv2.typing.MatLike, colour: Colour) -> TextBitmap:
        """Return the bitmap of a coverage by ink and by halo, both (h, w), 0 to 255."""
        ink = np.rint(alpha[:, :, None] * (np.array(colour) / 255)).astype(np.uint8)
        keep = np.asarray(cv2.cvtColor(cv2.bitwise_not(halo), cv2.COLOR_GRAY2BGR), np.uint8)
        return cls(keep, ink)

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height in pixels."""
        return self.ink.shape[1], self.ink.shape[0]

    def draw(self, image: Pixels, left: int, top: int) -> None:
        """Draw on a picture (h, w, 3) with the upper left corner at (left, top); clip at edges."""
        keep, ink = self.keep, self.ink
        if left < 0 or top < 0:
            part = slice(max(-top, 0), None), slice(max(-left, 0), None)
            keep, ink, left, top = keep[part], ink[part], max(left, 0), max(top, 0)
        height, width = ink.shape[:2]
        below = image[top : top + height, left : left + width]
        if not below.size:
            return
        if below.shape != ink.shape:
            part = slice(below.shape[0]), slice(below.shape[1])
            keep, ink = keep[part], ink[part]
        cv2.multiply(below, keep, dst=below, scale=1 / 255)
        cv2.add(below, ink, dst=below)


@lru_cache(maxsize=_CACHED)
def stamp(text: str, size_px: int, colour: Colour) -> TextBitmap:
    """Render the ``writable`` part of a text in a BGR colour with a dark halo."""
    return _rendered(writable(text), size_px, colour)


# Without its own cache, reasons with a running time in seconds (60 characters each) would fill
# the large one with 70 MB.
@lru_cache(maxsize=_PASSING)
def passing_stamp(text: str, size_px: int, colour: Colour) -> TextBitmap:
    """Render a text that is not needed for long, with a small cache of its own.

    Letters that cannot be written, such as those of a file's name in a message, leave a gap.
    """
    return _rendered(writable(text) or _NOT_ASCII.sub(" ", cut(text, LONGEST)), size_px, colour)


def _rendered(text: str, size_px: int, colour: Colour) -> TextBitmap:
    alpha = coverage(text, size_px)
    return TextBitmap.of(alpha, cv2.dilate(alpha, _disc(_halo_px(size_px))), colour)


def composed(width: int, height: int, parts: Sequence[tuple[TextBitmap, int, int]]) -> TextBitmap:
    """Combine bitmaps into one; each has its upper left corner at its (left, top)."""
    keep = np.full((height, width, 3), 255, np.uint8)
    ink = np.zeros_like(keep)
    for part, left, top in parts:
        part.draw(ink, left, top)
        TextBitmap(part.keep, np.zeros_like(part.ink)).draw(keep, left, top)
    return TextBitmap(keep, ink)


def writable(text: str) -> str:
    """Return the part of a text that can be written, cut at ``LONGEST``.

    Control characters become spaces. Symbols that no typeface has are left out. The result is
    empty if a letter cannot be written.
    """
    text = cut(text, LONGEST)
    if text.isascii() and text.isprintable():
        return text
    text = unicodedata.normalize("NFC", _VARIATIONS.sub("", text))
    shown = (c if c.isprintable() or c in _JOINERS else " " for c in text)
    kept = "".join(c for c in shown if unicodedata.category(c)[0] in "LMN" or typeface(c)).strip()
    return kept if typeface(kept) else ""


def typeface(text: str) -> str:
    """Return the first typeface that can write a whole text; empty if none can."""
    return next((name for name in _TYPEFACES if all(_has(name, c) for c in text)), "")


def can_shape() -> bool:
    """Return whether Pillow can lay out right-to-left and joined letters here."""
    return all(map(features.check_feature, ("raqm", "fribidi")))


@lru_cache(maxsize=_LETTERS)
def _has(name: str, letter: str) -> bool:
    """Return whether a typeface has a letter and can lay it out.

    Letters that run from right to left or are set above others need Pillow's Raqm layout, which
    takes FriBiDi from the system; OpenCV writes them in the wrong order or place.
    """
    if letter.isascii() or letter.isspace() or letter in _JOINERS:
        return True
    is_mark = unicodedata.category(letter)[0] == "M"
    shaped = is_mark or unicodedata.bidirectional(letter) in {"R", "AL"}
    if shaped and (name == _OPENCV or not can_shape()):
        return False
    drawn, absent = (coverage(c, _SMALLEST_PX, name) for c in (letter, _NO_LETTER))
    return not np.array_equal(drawn, absent)


def coverage(text: str, size_px: int, name: str | None = None) -> Pixels:
    """Return the coverage of a text by ink, (h, w), 0 to 255, with a margin for the halo.

    The typeface is the first that can write the text, unless its ``name`` is given. Texts of one
    size have the same line height.
    """
    name = typeface(text) if name is None else name
    cv: Any = cv2  # of version 5
    pad = _halo_px(size_px)
    font = _font(name, size_px)
    if name == _OPENCV:
        left, top, width, height = cv.getTextSize((0, 0), text, (0, 0), font, size_px, _WEIGHT)
        bottom = top + height
    else:
        left, top, right, bottom = map(round, font.getbbox(text, anchor="ls"))
        width = right - left
    above, below = max(size_px, -top), max(size_px // 3, bottom)
    sheet = np.zeros((above + below + 2 * pad, width + 2 * pad), np.uint8)
    at = pad - left, above + pad
    if name == _OPENCV:
        cv.putText(sheet, text, at, (255,), font, size_px, _WEIGHT)
        return sheet
    image = Image.fromarray(sheet)
    ImageDraw.Draw(image).text(at, text, fill=255, font=font, anchor="ls")
    return np.array(image)


@lru_cache(maxsize=64)
def _font(name: str, size_px: int) -> Any:
    """Return a typeface; if it is absent, Pillow's own, which has few letters beyond ASCII."""
    if name == _OPENCV:
        face: Any = cv2
        return face.FontFace(name)
    try:
        return ImageFont.truetype(name, size_px)
    except OSError:
        return ImageFont.load_default(size_px)


@dataclass(frozen=True, slots=True)
class Field:
    """Hold one text of the status line."""

    text: str
    colour: Colour = TEXT_BGR
    detail: str = ""  # follows the text; cut if the line is too long
    spare: bool = False  # left out first if the line is too long; spare fields come last


def status_box(image: Pixels) -> Box:
    """Return the strip at the bottom of a picture (h, w, ...) for the status line."""
    height, width = image.shape[:2]
    return Box(0, max(height - line_px(text_px(image)), 0), width, height)


def paint_status(image: Pixels, fields: Sequence[Field]) -> None:
    """Darken a strip at the bottom of the picture and write the fields in it, left to right."""
    top, size_px = status_box(image).top, text_px(image)
    _darken(image[top:])
    left = round(_EDGE_PARTS * size_px)
    for field in fitted(fields, image.shape[1], size_px):
        text = _written(field, size_px)
        text.draw(image, left, image.shape[0] - line_px(size_px))
        left += text.size[0] + round(_GAP_PARTS * size_px)


def _darken(part: Pixels) -> None:
    part[:] = cv2.convertScaleAbs(part, alpha=_STRIP_LIGHT)


def fitted(fields: Sequence[Field], width_px: int, size_px: int) -> list[Field]:
    """Return the fields that fit into one line of the picture's width, in text of this size.

    Spare fields are removed first, then details are cut, then fields are removed from the right.
    The first field stays.
    """
    kept = list(fields)

    def excess_px() -> int:
        gaps = round(_GAP_PARTS * size_px) * (len(kept) - 1) + 2 * round(_EDGE_PARTS * size_px)
        return sum(_written(each, size_px).size[0] for each in kept) + gaps - width_px

    while excess_px() > 0 and kept[-1].spare:
        kept.pop()
    for number, field in enumerate(kept):
        if field.detail and excess_px() > 0:
            width = _written(field, size_px).size[0] - excess_px()
            lengths = range(_LEAST_DETAIL, min(len(field.detail), LONGEST))
            details = [field.detail[:n].rstrip(" ,:") + "\u2026" for n in lengths]
            cuts = [replace(field, detail=detail) for detail in details]
            fits = bisect_right(cuts, width, key=lambda each: _written(each, size_px).size[0])
            kept[number] = cuts[fits - 1] if fits else replace(field, detail="")
    while len(kept) > 1 and excess_px() > 0:
        kept.pop()
    return kept


def _written(field: Field, size_px: int) -> TextBitmap:
    return passing_stamp(field.text + field.detail, size_px, field.colour)


@dataclass(frozen=True, slots=True)
class PlacedText:
    """Hold bitmaps, one below the other, and their box in the picture."""

    lines: tuple[TextBitmap, ...]
    box: Box
    strip: bool = False  # whether the picture is darkened behind them

    def paint(self, image: Pixels) -> None:
        """Draw the bitmaps, each centred, on the picture (h, w, 3) for which they were placed."""
        left, top, right, bottom = self.box
        if self.strip:
            _darken(image[top:bottom, left:right])
        for text in self.lines:
            text.draw(image, (left + right - text.size[0]) // 2, top)
            top += text.size[1]


def place_notice(
    image: Pixels,
    notice: str,
    colour: Colour = NOTICE_BGR,
    *,
    top: int = 0,
    beside: Box | None = None,
    most_lines: int = 3,
    large: bool = False,
) -> PlacedText:
    """Place a notice across a picture (h, w, ...), from row ``top`` down, left of ``beside``.

    Text beyond ``most_lines`` is cut. A ``large`` notice is for a part of the picture where
    nothing else is written; behind any other notice the picture is darkened.
    """
    width = beside.left if beside else image.shape[1]
    size_px = round(_NOTICE_TIMES * text_px(image)) if large else text_px(image)
    lines = _notice_lines(cut(notice, LONGEST_NOTICE), size_px, colour, width, most_lines)
    bottom = min(top + sum(line.size[1] for line in lines), image.shape[0])
    return PlacedText(lines, Box(0, top, width, bottom), strip=not large)


def paint_notice(image: Pixels, notice: str, least_top: int = 0) -> None:
    """Write a notice of up to ``LONGEST_NOTICE`` characters across the picture's upper part."""
    top = max(image.shape[0] // 8, least_top)
    place_notice(image, notice, top=top, most_lines=LONGEST_NOTICE, large=True).paint(image)


@lru_cache(maxsize=4)  # a notice stays for seconds, and measuring text is slow
def _notice_lines(
    text: str, size_px: int, colour: Colour, width_px: int, most: int
) -> tuple[TextBitmap, ...]:
    """Return the text in lines of whole words; line number ``most`` is cut with an ellipsis."""

    def width_of(line: str) -> int:
        return passing_stamp(line, size_px, NOTICE_BGR).size[0]

    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and (len(longer) > LONGEST or width_of(longer) > width_px):
            lines.append(word)
        else:
            lines[-1] = longer
    if len(lines) > most:
        rest = " ".join(lines[most - 1 :])
        lengths = range(1, min(len(rest), LONGEST))
        fits = bisect_right(lengths, width_px, key=lambda n: width_of(cut(rest, n)))
        lines = [*lines[: most - 1], cut(rest, lengths[max(fits - 1, 0)])]
    return tuple(passing_stamp(line, size_px, colour) for line in lines)


def status_line(
    status: NavigationStatus | None,
    age_s: float,
    rate_hz: float,
    predicted_s: float = 0.0,
    dropped: int = 0,
    above_m: float = math.nan,
    verdict: Severity = Severity.NOTE,
) -> list[Field]:
    """Return the fields, left to right, for a frame of this age; ``rate_hz`` may be nan.

    ``predicted_s`` is how far the frame's pose was extrapolated, ``dropped`` the number of lost
    frames, ``above_m`` the camera's height above the ground, nan if unknown, and ``verdict`` the
    verdict of the checks.
    """
    fields = [Field(_VERDICTS[verdict], VERDICT_BGR[verdict])] if verdict else []
    if predicted_s:
        fields.append(Field(f"predicted {predicted_s * 1e3:.0f} ms", _ORANGE_BGR))
    if status is None:
        fields.append(Field("no filter status"))
    else:
        if status.state is not FilterState.RUNNING:  # first: a small picture keeps the first
            state, seconds = status.state.value.replace("_", " "), status.state_s
            span = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
            detail = f": {status.reason}" if status.reason else ""
            colour = _COLOURS.get(status.state, NOTICE_BGR)
            fields.append(Field(f"{state} {span}", colour, detail=detail))
        fields.append(Field(_METHODS.get(status.method, status.method)))
        fields.append(Field(f"RTK {status.rtk_status.name.lower()}"))
    if above_m < -_BELOW_M:
        fields.append(Field(f"{-above_m:.0f} m below ground", _ORANGE_BGR))
    elif not math.isnan(above_m):
        fields.append(Field(f"{above_m:.0f} m above ground"))
    if status is not None and not math.isnan(status.heading_sigma_rad):
        fields.append(Field(f"heading sigma {math.degrees(status.heading_sigma_rad):.2f} deg"))
    if -_CLOCK_STEP_S < age_s < 0:  # a bag's clock moves in steps and may be behind the frame
        age_s = 0.0
    age = f"age {age_s * 1e3:.0f} ms" if abs(age_s) < 10 else f"age {age_s:.0f} s"
    rate = "video starts" if math.isnan(rate_hz) else f"video {rate_hz:.1f} Hz"
    video = [age, rate, *([f"dropped {dropped}"] if dropped else [])]
    return [*fields, *(Field(text, spare=True) for text in video)]
