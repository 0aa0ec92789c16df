"""Text in any script as small bitmaps, each rendered once and then laid on the picture.

OpenCV 5 writes UTF-8 with a typeface of its own. OpenCV 4 writes ASCII alone, so there Pillow
does it, with a typeface of the system, or in ASCII where the system has none.
"""

from __future__ import annotations

import contextlib
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.quoted_text import cut

Colour = tuple[int, int, int]

TEXT_BGR: Colour = (255, 255, 255)
LONGEST = 60  # characters
_CACHED, _PASSING = 1024, 24  # texts
#: Of these parts of a picture's width and height is a text: 9 px on a phone 360 px wide.
_WIDTH_PARTS, _HEIGHT_PARTS = 42, 24
_SMALLEST_PX, _LARGEST_PX = 12, 64  # smaller is not legible, whatever the picture
_LEAST_HALO_PX, _HALO_PART = 2, 1 / 8  # of the text's size, on each side
_WEIGHT = 500  # of OpenCV's typeface: 400 is plain, 700 bold
_SYSTEM_FONTS = ("DejaVuSans.ttf", "NotoSans-Regular.ttf", "LiberationSans-Regular.ttf")


def text_px(image: Pixels) -> int:
    """The size of plain text on a picture (h, w, ...)."""
    height, width = image.shape[:2]
    fits = round(min(width / _WIDTH_PARTS, height / _HEIGHT_PARTS))
    return int(min(max(fits, _SMALLEST_PX), _LARGEST_PX))


def line_px(size_px: int) -> int:
    """The height of a line of text, with its halo, unless a letter is taller than others."""
    return size_px + size_px // 3 + 2 * _halo_px(size_px)


def _halo_px(size_px: int) -> int:
    return max(round(size_px * _HALO_PART), _LEAST_HALO_PX)


@lru_cache(maxsize=8)
def _disc(radius_px: int) -> Pixels:
    side = 2 * radius_px + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


class Box(NamedTuple):
    """A rectangle of pixels; right and bottom are the first ones outside."""

    left: int
    top: int
    right: int
    bottom: int

    def meets(self, other: Box, room: int = 0) -> bool:
        """Whether less than so much room is between them."""
        return (
            self.left - room < other.right
            and other.left < self.right + room
            and self.top - room < other.bottom
            and other.top < self.bottom + room
        )


@dataclass(frozen=True, slots=True)
class Stamp:
    """A text ready to be laid on a picture: ``picture * keep / 255 + ink``."""

    keep: Pixels  # (h, w, 3)
    ink: Pixels  # (h, w, 3)

    @classmethod
    def of(cls, alpha: cv2.typing.MatLike, halo: cv2.typing.MatLike, colour: Colour) -> Stamp:
        """Of how far ink, and darkness, cover each pixel: (h, w), 0 to 255."""
        ink = np.rint(alpha[:, :, None] * (np.array(colour) / 255)).astype(np.uint8)
        keep = np.asarray(cv2.cvtColor(cv2.bitwise_not(halo), cv2.COLOR_GRAY2BGR), np.uint8)
        return cls(keep, ink)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.ink.shape[1], self.ink.shape[0]

    def lay(self, image: Pixels, left: int, top: int) -> None:
        """Draw on a (h, w, 3) picture with the upper left corner here; cut at the edges."""
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


def stamp(text: str, size_px: int, colour: Colour) -> Stamp:
    """A text in a BGR colour with a dark halo, cut at ``LONGEST``. Controls become spaces."""
    return _stamp(cut(text, LONGEST), size_px, colour)


def passing_stamp(text: str, size_px: int, colour: Colour) -> Stamp:
    """The same of words of the moment, which will not come again: few are remembered."""
    return _kept_briefly(cut(text, LONGEST), size_px, colour)


def _rendered(text: str, size_px: int, colour: Colour) -> Stamp:
    alpha = coverage("".join(c if c.isprintable() else " " for c in text), size_px)
    return Stamp.of(alpha, cv2.dilate(alpha, _disc(_halo_px(size_px))), colour)


_stamp = lru_cache(maxsize=_CACHED)(_rendered)
#: Seconds that are counted, in a reason of 60 characters, would fill the other with 70 MB.
_kept_briefly = lru_cache(maxsize=_PASSING)(_rendered)


def composed(width: int, height: int, parts: Sequence[tuple[Stamp, int, int]]) -> Stamp:
    """Stamps in one, each with its upper left corner at a column and row of it."""
    keep = np.full((height, width, 3), 255, np.uint8)
    ink = np.zeros_like(keep)
    for part, left, top in parts:
        part.lay(ink, left, top)
        Stamp(part.keep, np.zeros_like(part.ink)).lay(keep, left, top)
    return Stamp(keep, ink)


def coverage(text: str, size_px: int) -> Pixels:
    """How far ink covers each pixel of a text, 0 to 255, (h, w), with the halo's margin.

    Raises ConfigError where neither OpenCV 5 nor Pillow is there.
    """
    if hasattr(cv2, "FontFace"):
        return _by_opencv(cv2, text, size_px)
    return _by_pillow(text, size_px)


def _by_opencv(cv: Any, text: str, size_px: int) -> Pixels:
    face = _opencv_face(cv)
    left, top, width, height = cv.getTextSize((0, 0), text, (0, 0), face, size_px, _WEIGHT)
    image, base = _sheet(size_px, width, top, top + height)
    cv.putText(image, text, (_halo_px(size_px) - left, base), (255,), face, size_px, _WEIGHT)
    return image


def _sheet(size_px: int, width: int, top: int, bottom: int) -> tuple[Pixels, int]:
    """An empty bitmap and the row of its base line; texts of a size get the same line height."""
    above, below = max(size_px, -top), max(size_px // 3, bottom)
    pad = _halo_px(size_px)
    return np.zeros((above + below + 2 * pad, width + 2 * pad), np.uint8), above + pad


@lru_cache(maxsize=1)
def _opencv_face(cv: Any) -> Any:
    return cv.FontFace("sans")


def _by_pillow(text: str, size_px: int) -> Pixels:
    try:
        from PIL import Image, ImageDraw  # noqa: PLC0415  # needed with OpenCV 4 alone
    except ImportError:
        raise ConfigError(
            "labels need OpenCV 5 or Pillow; install one: pip install pillow"
        ) from None
    font, universal = _pillow_font(size_px)
    text = text if universal else _plain(text)
    left, top, right, bottom = map(round, font.getbbox(text, anchor="ls"))
    sheet, base = _sheet(size_px, right - left, top, bottom)
    image = Image.fromarray(sheet)
    at = _halo_px(size_px) - left, base
    ImageDraw.Draw(image).text(at, text, fill=255, font=font, anchor="ls")
    return np.array(image)


@lru_cache(maxsize=8)
def _pillow_font(size_px: int) -> tuple[Any, bool]:
    """A typeface of the system, else Pillow's own, and whether it is more than ASCII."""
    from PIL import ImageFont  # noqa: PLC0415

    for name in _SYSTEM_FONTS:
        with contextlib.suppress(OSError):
            return ImageFont.truetype(name, size_px), True
    return ImageFont.load_default(size_px), False


def _plain(text: str) -> str:
    """ASCII: letters without their accents, a question mark for all others."""
    bare = (c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    return "".join(c if c.isascii() else "?" for c in bare)
