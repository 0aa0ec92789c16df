"""Ink on the thermal picture: lines with a dark halo, marks, labels, the status line, a notice."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.polylines import BoolArray, IntArray, Polylines
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.text import Colour, Pixels, stamp

LINE_BGR: Colour = (0, 255, 255)
TEXT_BGR: Colour = (255, 255, 255)
NOTICE_BGR: Colour = (80, 200, 255)

_SHIFT = 4  # cv2 takes coordinates in sixteenths of a pixel
_HALO = np.ones((3, 3), np.uint8)
_MARK = np.array([[0, -4], [4, 0], [0, 4], [-4, 0]])  # a small open diamond, px
_LABEL_PX, _STATUS_PX, _NOTICE_PX = 12, 12, 20
_SMALLEST_PX = 8
_MOST_LABELS = 40
_CELL_PX = 8  # labels keep each other out of squares of this size
_STATUS_HEIGHT_PX = 18
_STATUS_GAP_PX = 14


def coloured(pixels: Pixels) -> Pixels:
    """A BGR copy of a (h, w) or (h, w, 3) picture."""
    return (
        np.array(cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)) if pixels.ndim == 2 else pixels.copy()
    )


def paint_lines(image: Pixels, lines: Polylines, marks_uv: Array) -> Pixels:
    """The picture with lines (2, V) and marks (N, 2), in pixels, drawn on it.

    The ink is gathered on one mask and the halo grown from it: half the time of drawing every
    line twice.
    """
    mask = np.zeros(image.shape[:2], np.uint8)
    _draw(mask, lines.split_rows(_fixed_point(lines.points.T)), closed=False)
    _draw(mask, list(_fixed_point(marks_uv[:, None, :] + _MARK)), closed=True)
    halo = cv2.cvtColor(cv2.dilate(mask, _HALO), cv2.COLOR_GRAY2BGR)
    ink = cv2.merge([cv2.convertScaleAbs(mask, alpha=level / 255) for level in LINE_BGR])
    return np.asarray(cv2.add(cv2.subtract(image, halo), ink), np.uint8)


def _draw(mask: Pixels, runs: list[npt.NDArray[np.int32]], *, closed: bool) -> None:
    cv2.polylines(mask, runs, closed, (255,), 1, cv2.LINE_AA, _SHIFT)


def _fixed_point(uv: Array) -> npt.NDArray[np.int32]:
    return np.rint(uv * (1 << _SHIFT)).astype(np.int32)


def paint_labels(image: Pixels, uv: Array, owner: IntArray, labels: Sequence[str]) -> None:
    """Write each owner's label once, at the middle of its points (N, 2) within the picture.

    The features with most points come first; a label that would cover another is left out.
    """
    count = np.bincount(owner, minlength=len(labels))
    middle = [np.bincount(owner, axis, len(labels)) / np.maximum(count, 1) for axis in uv.T]
    height, width = image.shape[:2]
    taken = np.zeros((height // _CELL_PX + 1, width // _CELL_PX + 1), bool)
    first = [i for i in np.argsort(-count, kind="stable")[: np.count_nonzero(count)] if labels[i]]
    for feature in first[:_MOST_LABELS]:
        _place(image, taken, labels[feature], middle[0][feature], middle[1][feature])


def _place(
    image: Pixels,
    taken: BoolArray,
    label: str,
    u: float,
    v: float,
) -> None:
    text = stamp(label, _LABEL_PX, TEXT_BGR)
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


def paint_status(image: Pixels, fields: Sequence[str]) -> None:
    """Darken a strip at the bottom of the picture and write the fields in it, left to right."""
    strip = image[-_STATUS_HEIGHT_PX:]
    strip[:] = cv2.convertScaleAbs(strip, alpha=0.35)
    left = 6
    for field in fields:
        text = stamp(field, _STATUS_PX, TEXT_BGR)
        text.lay(image, left, image.shape[0] - (_STATUS_HEIGHT_PX + text.size[1]) // 2)
        left += text.size[0] + _STATUS_GAP_PX


def paint_notice(image: Pixels, notice: str) -> None:
    """Write a notice across the upper part of the picture, smaller if it would not fit."""
    text = stamp(notice, _NOTICE_PX, NOTICE_BGR)
    if text.size[0] > image.shape[1]:
        size_px = max(_NOTICE_PX * image.shape[1] // text.size[0], _SMALLEST_PX)
        text = stamp(notice, size_px, NOTICE_BGR)
    text.lay(image, (image.shape[1] - text.size[0]) // 2, image.shape[0] // 8)
