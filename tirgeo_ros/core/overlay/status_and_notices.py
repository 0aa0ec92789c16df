"""Write on the picture: the status line at the bottom, and notices at the top.

The status line has the checks' verdict, the filter, the height and the video. The filter's state
is shown, with its duration and reason, unless it is ``running``.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2

from tirgeo_ros.core.map.map_layers import Colour
from tirgeo_ros.core.overlay.text_rendering import (
    LONGEST,
    TEXT_BGR,
    Box,
    TextBitmap,
    line_px,
    passing_stamp,
    text_px,
)
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import cut
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus

NOTICE_BGR: Colour = (80, 200, 255)
LONGEST_NOTICE = 300  # characters; more would cover a small picture with text

_NOTICE_TIMES = 1.25  # size of a large notice, relative to plain text
#: Brightness that remains under the status line: low enough that every colour of its text has a
#: contrast of 4.5 to 1 even on a white picture (WCAG 2, relative luminance).
_STRIP_LIGHT = 0.14
_GAP_PARTS, _EDGE_PARTS = 0.7, 0.4  # in sizes of the status line's text
_LEAST_DETAIL = 6  # characters; a shorter rest of a detail is useless


@dataclass(frozen=True, slots=True)
class Field:
    """Hold one text of the status line."""

    text: str
    colour: Colour = TEXT_BGR
    detail: str = ""  # follows the text; cut if the line is too long
    spare: bool = False  # left out first if the line is too long; they are the last fields


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
        text.lay(image, left, image.shape[0] - line_px(size_px))
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
    """Hold bitmaps, one below the other, and their place."""

    lines: tuple[TextBitmap, ...]
    box: Box
    strip: bool = False  # whether the picture is darkened behind them

    def paint(self, image: Pixels) -> None:
        """Draw them on the picture (h, w, 3) for which they were placed, each centred."""
        left, top, right, bottom = self.box
        if self.strip:
            _darken(image[top:bottom, left:right])
        for text in self.lines:
            text.lay(image, (left + right - text.size[0]) // 2, top)
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

    Text beyond ``most_lines`` is cut. A ``large`` notice is for a place where nothing else is
    written; behind any other the picture is darkened.
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
    """Return the text in lines of whole words, the last of ``most`` cut with an ellipsis."""

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
_BELOW_M = 2.0  # tolerance: a camera on the landing gear, a ground height known to a metre


def status_line(
    status: NavigationStatus | None,
    age_s: float,
    rate_hz: float,
    predicted_s: float = 0.0,
    dropped: int = 0,
    above_m: float = math.nan,
    verdict: Severity = Severity.NOTE,
) -> list[Field]:
    """Return the fields, left to right, for a frame of ``age_s``; ``rate_hz`` may be nan.

    ``predicted_s`` is how far the frame's pose was extrapolated, ``dropped`` the number of lost
    frames, ``above_m`` the camera's height above the ground, nan if unknown, and ``verdict`` that
    of the checks.
    """
    fields = [Field(_VERDICTS[verdict], VERDICT_BGR[verdict])] if verdict else []
    if predicted_s:
        fields.append(Field(f"predicted {predicted_s * 1e3:.0f} ms", _ORANGE_BGR))
    if status is None:
        fields.append(Field("no filter status"))
    else:
        if status.state is not FilterState.RUNNING:  # first: the first stay on a small picture
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
