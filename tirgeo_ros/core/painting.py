"""Ink on the thermal picture: lines with a dark halo, marks, labels, the status line, a notice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.polylines import BoolArray, IntArray, Polylines
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.text import LONGEST, TEXT_BGR, Box, Colour, Pixels, Stamp, stamp, text_px

LINE_BGR: Colour = (0, 255, 255)  # each 0 or 255
NOTICE_BGR: Colour = (80, 200, 255)

_SHIFT = 4  # cv2 takes coordinates in sixteenths of a pixel
_HALO = np.ones((3, 3), np.uint8)
_MARK_PX = 4
_MARK = _MARK_PX * np.array([[0, -1], [1, 0], [0, 1], [-1, 0]])  # a small open diamond
_LABEL_PX = 12
_NOTICE_TIMES = 1.25  # the size of plain text
#: What is left of the picture under the status line: so little that every colour of its text has
#: a contrast of 4.5 to 1 on a white picture too (WCAG 2, relative luminance).
_STRIP_LIGHT = 0.14
_MOST_LABELS = 40
_CELL_PX = 8  # labels keep each other out of squares of this size
_STATUS_HEIGHT_PX = 20
_GAP_PARTS, _EDGE_PARTS = 0.8, 0.5  # of the size of the status line's text
_LEAST_DETAIL = 6  # characters; less of a detail says nothing


@dataclass(frozen=True, slots=True)
class Field:
    """A text of the status line."""

    text: str
    colour: Colour = TEXT_BGR
    detail: str = ""  # follows the text, cut where the line is too long
    spare: bool = False  # left out first where the line is too long


def coloured(pixels: Pixels) -> Pixels:
    """A BGR copy of a (h, w) or (h, w, 3) picture."""
    if pixels.ndim == 3:
        return np.array(pixels)
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR), np.uint8)


def paint_lines(image: Pixels, lines: Polylines, marks: Polylines) -> None:
    """Draw lines (2, V) and marks, lines of one point, given in pixels.

    The ink is gathered on one mask and the halo grown from it: half the time of drawing every
    line twice.
    """
    mask = np.zeros(image.shape[:2], np.uint8)
    _draw(mask, lines.split_rows(_fixed_point(lines.points.T)), closed=False)
    _draw(mask, list(_fixed_point(marks.points.T[:, None, :] + _MARK)), closed=True)
    layer = cv2.cvtColor(cv2.dilate(mask, _HALO), cv2.COLOR_GRAY2BGR)
    cv2.subtract(image, layer, dst=image)
    none = np.zeros_like(mask)
    cv2.merge([mask if level else none for level in LINE_BGR], dst=layer)
    cv2.add(image, layer, dst=image)


def _draw(mask: Pixels, runs: list[npt.NDArray[np.int32]], *, closed: bool) -> None:
    cv2.polylines(mask, runs, closed, (255,), 1, cv2.LINE_AA, _SHIFT)


def _fixed_point(uv: Array) -> npt.NDArray[np.int32]:
    return np.rint(uv * (1 << _SHIFT)).astype(np.int32)


def paint_labels(image: Pixels, uv: Array, owner: IntArray, labels: Sequence[str]) -> None:
    """Write each owner's label once, at the middle of its points (N, 2), all in the picture.

    A label larger than its feature stands under it. The features with most points come first; a
    label that would cover another is left out.
    """
    image = image[:-_STATUS_HEIGHT_PX]  # a view: the strip under it is the status line's
    count = np.bincount(owner, minlength=len(labels))
    u, v, vv = (
        np.bincount(owner, weight, len(labels)) / np.maximum(count, 1)
        for weight in (uv[:, 0], uv[:, 1], uv[:, 1] ** 2)
    )
    reach = 2 * np.sqrt(np.maximum(vv - v * v, 0.0))  # of the feature, up and down
    height, width = image.shape[:2]
    taken = np.zeros((height // _CELL_PX + 1, width // _CELL_PX + 1), bool)
    first = np.argsort(-count, kind="stable")[: np.count_nonzero(count)]
    for feature in first[:_MOST_LABELS]:
        text = stamp(labels[feature], _LABEL_PX, TEXT_BGR)
        half = text.size[1] / 2
        under = reach[feature] + half + _MARK_PX if reach[feature] < 2 * half else 0.0
        _place(image, taken, text, u[feature], v[feature] + under)


def _place(image: Pixels, taken: BoolArray, text: Stamp, u: float, v: float) -> None:
    """Lay a text centred here, moved into the picture, unless the place is taken."""
    width, height = text.size
    left = min(max(round(u) - width // 2, 0), max(image.shape[1] - width, 0))
    top = min(max(round(v) - height // 2, 0), max(image.shape[0] - height, 0))
    cells = np.s_[
        top // _CELL_PX : (top + height) // _CELL_PX + 1,
        left // _CELL_PX : (left + width) // _CELL_PX + 1,
    ]
    if not taken[cells].any():
        taken[cells] = True
        text.lay(image, left, top)


def status_box(image: Pixels) -> Box:
    """The strip at the bottom of a picture (h, w, ...) that the status line takes."""
    height, width = image.shape[:2]
    return Box(0, max(height - _strip_px(text_px(image)), 0), width, height)


def _strip_px(size_px: int) -> int:
    return size_px + size_px // 3 + 4


def paint_status(image: Pixels, fields: Sequence[Field]) -> None:
    """Darken a strip at the bottom of the picture and write the fields in it, left to right."""
    top, size_px = status_box(image).top, text_px(image)
    strip = image[top:]
    strip[:] = cv2.convertScaleAbs(strip, alpha=_STRIP_LIGHT)
    left = round(_EDGE_PARTS * size_px)
    for field in fitted(fields, image.shape[1], size_px):
        text = _written(field, size_px)
        text.lay(image, left, image.shape[0] - _strip_px(size_px))
        left += text.size[0] + round(_GAP_PARTS * size_px)


def fitted(fields: Sequence[Field], width_px: int, size_px: int) -> list[Field]:
    """As much of the fields as one line of the picture's width takes, in text of a size.

    Spare fields go first, then details are cut, then fields go from the right; the first stays.
    """
    kept = list(fields)
    for spare in [field for field in reversed(fields) if field.spare]:
        if _excess_px(kept, width_px, size_px) > 0:
            kept.remove(spare)
    for number, field in enumerate(kept):
        excess_px = _excess_px(kept, width_px, size_px)
        if excess_px > 0 and field.detail:
            kept[number] = _cut(field, _written(field, size_px).size[0] - excess_px, size_px)
    while len(kept) > 1 and _excess_px(kept, width_px, size_px) > 0:
        kept.pop()
    return kept


def _excess_px(fields: Sequence[Field], width_px: int, size_px: int) -> int:
    written = sum(_written(field, size_px).size[0] for field in fields)
    between = round(_GAP_PARTS * size_px) * (len(fields) - 1)
    return written + between + 2 * round(_EDGE_PARTS * size_px) - width_px


def _cut(field: Field, width_px: int, size_px: int) -> Field:
    """With as much of its detail as fits, or with none."""
    for length in range(len(field.detail) - 1, _LEAST_DETAIL - 1, -1):
        shorter = replace(field, detail=field.detail[:length].rstrip(" ,:") + "\u2026")
        if _written(shorter, size_px).size[0] <= width_px:
            return shorter
    return replace(field, detail="")


def _written(field: Field, size_px: int) -> Stamp:
    return stamp(field.text + field.detail, size_px, field.colour)


def paint_notice(image: Pixels, notice: str) -> None:
    """Write a notice across the upper part of the picture, in as many lines as it takes."""
    width = image.shape[1]
    size_px = round(_NOTICE_TIMES * text_px(image))
    top = image.shape[0] // 8
    for line in _wrapped(notice, size_px, width):
        text = stamp(line, size_px, NOTICE_BGR)
        text.lay(image, (width - text.size[0]) // 2, top)
        top += text.size[1]


def _wrapped(text: str, size_px: int, width_px: int) -> list[str]:
    """Lines of whole words."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        fits = len(longer) <= LONGEST and stamp(longer, size_px, NOTICE_BGR).size[0] <= width_px
        if lines[-1] and not fits:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
