"""Render text in any script as small bitmaps, each rendered once and then copied to pictures.

OpenCV 5 writes UTF-8 with its own typeface, each letter by itself and from left to right. Other
letters, and all of them where there is OpenCV 4, are written by Pillow with a typeface of the
system. What nobody can write is left out: never a question mark or a reversed word.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont, features

from tirgeo_ros.core.map.map_layers import Colour
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import cut

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
_LETTERS = 4096  # that are remembered
_JOINERS = "\u200c\u200d\u200e\u200f"  # without ink of their own; they decide how others join
_VARIATIONS = re.compile("[\ufe00-\ufe0f]")  # a choice between an emoji and a plain symbol
_NOT_ASCII = re.compile("[^ -~]+")
_NO_LETTER = "\U0010ffff"  # never assigned


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
    """Hold a rectangle of pixels; right and bottom are the first ones outside."""

    left: int
    top: int
    right: int
    bottom: int

    def meets(self, other: Box, room: int = 0) -> bool:
        """Return whether the boxes overlap, or have less than ``room`` px between them."""
        return (
            self.left - room < other.right
            and other.left < self.right + room
            and self.top - room < other.bottom
            and other.top < self.bottom + room
        )


@dataclass(frozen=True, slots=True)
class TextBitmap:
    """Hold a text ready to be drawn on a picture: ``picture * keep / 255 + ink``."""

    keep: Pixels  # (h, w, 3)
    ink: Pixels  # (h, w, 3)

    @classmethod
    def of(cls, alpha: cv2.typing.MatLike, halo: cv2.typing.MatLike, colour: Colour) -> TextBitmap:
        """Return the stamp of the coverage by ink and by halo, both (h, w), 0 to 255."""
        ink = np.rint(alpha[:, :, None] * (np.array(colour) / 255)).astype(np.uint8)
        keep = np.asarray(cv2.cvtColor(cv2.bitwise_not(halo), cv2.COLOR_GRAY2BGR), np.uint8)
        return cls(keep, ink)

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height in pixels."""
        return self.ink.shape[1], self.ink.shape[0]

    def lay(self, image: Pixels, left: int, top: int) -> None:
        """Draw on a (h, w, 3) picture with the upper left corner here; clip at the edges."""
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
    """Return what is ``writable`` of a text in a BGR colour with a dark halo."""
    return _rendered(writable(text), size_px, colour)


# Without its own cache, reasons with a running time in seconds (60 characters each) would fill
# the large one with 70 MB.
@lru_cache(maxsize=_PASSING)
def passing_stamp(text: str, size_px: int, colour: Colour) -> TextBitmap:
    """Return the stamp of a text that will not come again, from a small cache of its own.

    It is a message of ours: letters that cannot be written, as of a file's name, leave a gap.
    """
    return _rendered(writable(text) or _NOT_ASCII.sub(" ", cut(text, LONGEST)), size_px, colour)


def _rendered(text: str, size_px: int, colour: Colour) -> TextBitmap:
    alpha = coverage(text, size_px)
    return TextBitmap.of(alpha, cv2.dilate(alpha, _disc(_halo_px(size_px))), colour)


def composed(width: int, height: int, parts: Sequence[tuple[TextBitmap, int, int]]) -> TextBitmap:
    """Combine stamps into one; each has its upper left corner at (left, top) in the whole."""
    keep = np.full((height, width, 3), 255, np.uint8)
    ink = np.zeros_like(keep)
    for part, left, top in parts:
        part.lay(ink, left, top)
        TextBitmap(part.keep, np.zeros_like(part.ink)).lay(keep, left, top)
    return TextBitmap(keep, ink)


def coverage(text: str, size_px: int) -> Pixels:
    """Return the coverage of a text by ink, (h, w), 0 to 255, with a margin for the halo."""
    return _drawn(text, size_px, typeface(text))


def writable(text: str) -> str:
    """Return what can be written of a text, cut at ``LONGEST``; controls become spaces.

    Symbols that no typeface has are left out. It is empty if letters cannot be written.
    """
    text = cut(text, LONGEST)
    if text.isascii() and text.isprintable():
        return text
    text = unicodedata.normalize("NFC", _VARIATIONS.sub("", text))
    shown = (c if c.isprintable() or c in _JOINERS else " " for c in text)
    kept = "".join(c for c in shown if unicodedata.category(c)[0] in "LMN" or typeface(c)).strip()
    return kept if typeface(kept) else ""


def typeface(text: str) -> str:
    """Return the first typeface that has, and can lay out, all of a text; empty if none can."""
    return next((name for name in _TYPEFACES if all(_has(name, c) for c in text)), "")


def can_shape() -> bool:
    """Return whether Pillow can lay out right-to-left and joined letters here."""
    return all(map(features.check_feature, ("raqm", "fribidi")))


@lru_cache(maxsize=_LETTERS)
def _has(name: str, letter: str) -> bool:
    """Return whether a typeface has a letter and can lay it out.

    What runs from right to left or is set above another letter needs Pillow's Raqm layout, which
    takes FriBiDi from the system; OpenCV writes it in the wrong order or place.
    """
    if letter.isascii() or letter.isspace() or letter in _JOINERS:
        return True
    is_mark = unicodedata.category(letter)[0] == "M"
    shaped = is_mark or unicodedata.bidirectional(letter) in {"R", "AL"}
    if shaped and (name == _OPENCV or not can_shape()):
        return False
    drawn, absent = (_drawn(character, _SMALLEST_PX, name) for character in (letter, _NO_LETTER))
    return not np.array_equal(drawn, absent)


def _drawn(text: str, size_px: int, name: str) -> Pixels:
    """Return the coverage by a typeface; texts of one size have one line height."""
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
    """Return a typeface; of an absent one Pillow's own, which has few letters beyond ASCII."""
    if name == _OPENCV:
        face: Any = cv2
        return face.FontFace(name)
    try:
        return ImageFont.truetype(name, size_px)
    except OSError:
        return ImageFont.load_default(size_px)
