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
"""Write what is drawn on a picture as bytes for a browser, read them, and make them fewer.

The bytes are a zlib stream: the length (u32, little-endian) of a JSON object, the object, and
varints (LEB128). docs/page.md has the fields. Varints have the columns of the rings of areas, of
lines and of marks, then all of their vertices, in quarters of a pixel, each relative to the one
before, zigzag-coded: mostly one byte for each coordinate.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.map.polylines import Polylines, runs
from tirgeo_ros.core.map.vector_map import Colour, LayerStyle
from tirgeo_ros.core.overlay.clicks import MarkerShapes
from tirgeo_ros.core.overlay.frame_shapes import FrameShapes
from tirgeo_ros.core.overlay.label_placement import MOST
from tirgeo_ros.core.overlay.map_shapes import MapShapes
from tirgeo_ros.core.overlay.uncertainty_rendering import with_ellipses
from tirgeo_ros.core.overlay.written_text import LONGEST, NOTICE_BGR, TEXT_BGR
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray, Pixels
from tirgeo_ros.core.types.errors import MessageError, cut

SHAPES_FORMAT = "tirgeo shapes 1"  # of the message that holds them
_VERSION = 1
_PARTS = 4  # of a pixel: coordinates are off by 0.07 px, root mean square
_LEAST_ELLIPSE_PX = 1.0  # a smaller one is hidden by its mark, however large the picture is seen
_MOST_ELLIPSE_PX = 2000.0
_QUARTERS = 4  # steps of opacity
_QUICK = 1  # zlib's level: a frame has no time for more
#: Tolerances of the coarser shapes. What is smaller than the tolerance is left out.
_TOLERANCES_PX = (0.5, 1.0, 2.0, 4.0, 8.0, 20.0, 40.0)
_BYTES_A_VERTEX = 1.2  # at least, of all shapes tried: fewer are not worth an attempt to write
_FEW_LABELS = 24
_LARGEST_MESSAGE = 1 << 22
_LENGTH = struct.Struct("<I")
_NO_LINES = Polylines(np.empty((2, 0)), np.zeros(1, np.int64), np.empty(0, np.int64))


class Strokes(NamedTuple):
    """Hold lines, rings or marks in the order in which they are drawn."""

    points: IntArray  # (2, V) quarters of a pixel
    starts: IntArray  # (N + 1,) as in Polylines
    layer: IntArray  # (N,)
    #: (N,) of a line its opacity in quarters, of a ring 1 if it is of the same area as the one
    #: before, of a mark 0.
    extra: IntArray

    @property
    def counts(self) -> IntArray:
        """Return the number of vertices of each (N,)."""
        return np.diff(self.starts)


@dataclass(frozen=True, slots=True)
class WrittenShapes:
    """Hold shapes as they are written."""

    words: dict[str, Any]  # the JSON object
    rings: Strokes
    lines: Strokes
    marks: Strokes

    @property
    def vertices(self) -> int:
        """Return the number of vertices."""
        return sum(each.points.shape[1] for each in (self.rings, self.lines, self.marks))

    def segments(self) -> tuple[Array, IntArray]:
        """Return the ends (2 S, 2), px, of all segments of lines, and their layers (S,)."""
        points, starts, layer, _ = self.lines
        begins = np.ones(points.shape[1], bool)
        begins[starts[1:] - 1] = False
        first = np.flatnonzero(begins)
        ends = np.stack([first, first + 1], axis=-1).ravel()
        line = np.searchsorted(starts, first, side="right") - 1
        return points.T[ends] / _PARTS, layer[line]

    def to_bytes(self) -> bytes:
        """Return the zlib stream."""
        text = json.dumps(self.words, ensure_ascii=False, separators=(",", ":"))
        head = text.encode(errors="replace")  # half of an emoji, as another program cut a name
        numbers = [
            *_columns(self.rings, self.rings.layer, self.rings.extra, self.rings.counts),
            *_columns(self.lines, self.lines.layer, self.lines.extra, self.lines.counts),
            *_columns(self.marks, self.marks.layer),
            _steps(np.concatenate([s.points for s in (self.rings, self.lines, self.marks)], 1)),
        ]
        body = _varints(np.concatenate(numbers))
        return zlib.compress(_LENGTH.pack(len(head)) + head + body, _QUICK)


def written_shapes(
    shapes: FrameShapes, picture: Pixels, celsius: tuple[float, float] | None
) -> WrittenShapes:
    """Return the shapes of a clean picture (h, w) grey or (h, w, 3) BGR, ready to be written.

    ``celsius`` are the temperatures of grey 0 and 255, None if unknown.
    """
    height, width = picture.shape[:2]
    notices = [[shapes.verdict.words, int(shapes.verdict.severity)]] if shapes.verdict[0] else []
    bar, heading = shapes.bar, math.degrees(shapes.heading_rad)
    words: dict[str, Any] = {
        "v": _VERSION,
        "size": [width, height],
        "grey": picture.ndim == 2,
        "celsius": None if celsius is None else [round(value, 3) for value in celsius],
        "notices": [*notices, *([[shapes.notice, 1]] if shapes.notice else [])],
        "status": [[f.text + f.detail, _severity(f.colour)] for f in shapes.status],
        "bar": bar and [*_rounded(bar.left, bar.right, bar.row), bar.length_m],
        "heading_deg": None if math.isnan(heading) else round(heading, 1),
        "targets": _targets(shapes.markers) if shapes.markers else [],
        "layers": [],
        "labels": [],
        "ellipses": [],
    }
    seen = shapes.map
    if seen is None:
        nothing = _strokes(_NO_LINES, np.empty(0, np.int64))
        return WrittenShapes(words, nothing, nothing, nothing)
    words["layers"] = [_layer(layer.name, layer.style) for layer in seen.map.layers]
    words["labels"], words["ellipses"] = _labels(seen), _ellipses(seen)
    of, lines = seen.map.layer, seen.marked.lines
    areas = seen.areas.select(np.argsort(seen.areas.owner, kind="stable"))  # cut ones come last
    same_area = np.diff(areas.owner, prepend=-1) == 0
    order = np.argsort(of[lines.owner], kind="stable")  # as they are drawn
    opacity = np.rint(np.clip(seen.marked.opacity, 0, 1) * _QUARTERS).astype(np.int64)
    return WrittenShapes(
        words,
        _strokes(areas, of[areas.owner], same_area.astype(np.int64)),
        _strokes(lines.select(order), of[lines.owner[order]], opacity[order]),
        _strokes(seen.marks, of[seen.marks.owner]),
    )


def read_shapes(data: bytes) -> WrittenShapes:
    """Read a zlib stream of ``to_bytes``. Raises MessageError if it is damaged."""
    try:
        return _read(zlib.decompressobj().decompress(data, _LARGEST_MESSAGE))
    except (zlib.error, struct.error, ValueError, TypeError, RecursionError) as error:
        raise MessageError(f"tirgeo/overlay/shapes: {error}") from None


def _read(unpacked: bytes) -> WrittenShapes:
    (length,) = _LENGTH.unpack_from(unpacked)
    words = json.loads(unpacked[_LENGTH.size : _LENGTH.size + length])
    if not isinstance(words, dict) or not isinstance(words.get("labels"), list):
        raise TypeError("the words have no labels")
    numbers = _Numbers(_read_varints(unpacked[_LENGTH.size + length :]))
    rings, lines, marks = (numbers.columns(n) for n in (3, 3, 1))
    counts = rings[2], lines[2], np.ones(len(marks[0]), np.int64)
    if not all(each.all() for each in counts):
        raise ValueError("a line has no vertex")
    points = numbers.points(sum(int(each.sum()) for each in counts))
    parts, first = [], 0
    extras = rings[1], lines[1], np.zeros(len(marks[0]), np.int64)
    for own, extra, layer in zip(counts, extras, (rings[0], lines[0], marks[0]), strict=True):
        starts = np.append(0, np.cumsum(own))
        parts.append(Strokes(points[:, first : first + starts[-1]], starts, layer, extra))
        first += int(starts[-1])
    return WrittenShapes(words, *parts)


def coarser(data: bytes, most_bytes: int) -> bytes:
    """Return shapes with fewer vertices and labels, in ``most_bytes`` if their shape allows it.

    Lines move by up to some pixels; what is smaller than that is left out, and of marks nearer to
    each other all but one. Raises MessageError as ``read_shapes``.
    """
    if len(data) <= most_bytes:
        return data
    shapes = read_shapes(data)
    shapes = replace(shapes, lines=_chained(shapes.lines))
    words = shapes.words | {"labels": shapes.words["labels"][:_FEW_LABELS]}
    for tolerance_px in _TOLERANCES_PX:
        tolerance = tolerance_px * _PARTS
        areas = shapes.rings._replace(extra=np.cumsum(1 - shapes.rings.extra))
        rings, lines = (_thinned(part, tolerance) for part in (areas, shapes.lines))
        rings = rings._replace(extra=(np.diff(rings.extra, prepend=0) == 0).astype(np.int64))
        marks = _apart(shapes.marks, tolerance)
        labels = [label for label in words["labels"] if _is_marked(label, marks)]
        shapes = WrittenShapes(words | {"labels": labels}, rings, lines, marks)
        if shapes.vertices * _BYTES_A_VERTEX <= most_bytes:
            data = shapes.to_bytes()
        if len(data) <= most_bytes:
            break
    return data


def _chained(lines: Strokes) -> Strokes:
    """Join lines of which one begins where another ends: a long one comes in many pieces."""
    points, starts, layer, extra = lines
    first, last = (
        [*zip(layer.tolist(), extra.tolist(), *points[:, at].tolist(), strict=True)]
        for at in (starts[:-1], starts[1:] - 1)
    )
    begins = {place: line for line, place in enumerate(first)}
    following = [begins.pop(place, -1) for place in last]
    left, parts = {*range(len(layer))}, list[tuple[int, int]]()
    for head in [*sorted(left - {*following}), *range(len(layer))]:  # the latter: of rings
        line, joined = head, 0
        while line in left:
            left.remove(line)
            parts.append((line, joined))
            line, joined = following[line], 1
    which, joint = np.array(parts, np.int64).reshape(-1, 2).T
    index, ends = runs(starts[which] + joint, lines.counts[which] - joint)
    heads = np.flatnonzero(joint == 0)
    pens = layer[which[heads]], extra[which[heads]]
    return Strokes(points[:, index], np.append(ends[heads], ends[-1]), *pens)


def _thinned(strokes: Strokes, tolerance: float) -> Strokes:
    """Drop vertices nearer than the tolerance to the chord of their neighbours, and small parts.

    Each pass looks at every second vertex, so that no two neighbours are dropped at once.
    """
    points, starts, layer, extra = strokes
    line = np.repeat(np.arange(len(layer)), np.diff(starts))
    for _ in range(3):
        place = np.arange(len(line)) - starts[line]
        inner = (place % 2 == 1) & (place < np.diff(starts)[line] - 1)
        near = np.flatnonzero(inner)
        before, at, after = (points[:, near + k].astype(float) for k in (-1, 0, 1))
        chord, off = after - before, at - before
        share = np.clip((chord * off).sum(0) / np.maximum((chord * chord).sum(0), 1.0), 0.0, 1.0)
        dropped = np.hypot(*(off - share * chord)) <= tolerance
        keep = np.ones(len(line), bool)
        keep[near[dropped]] = False
        points, line = points[:, keep], line[keep]
        starts = np.searchsorted(line, np.arange(len(layer) + 1))
    return _large(Strokes(points, starts, layer, extra), tolerance)


def _apart(marks: Strokes, side: float) -> Strokes:
    """Keep one mark of each layer in each square of this side."""
    column, row = marks.points // round(side)
    squares = (column << 40) + (row << 16) + marks.layer
    kept = np.sort(np.unique(squares, return_index=True)[1])
    at = marks.points[:, kept]
    return Strokes(at, np.arange(len(kept) + 1), marks.layer[kept], marks.extra[kept])


def _is_marked(label: object, marks: Strokes) -> bool:
    """Return False if a label's mark is left out: it would seem to be of another one near it."""
    match label:
        case [_, float() | int() as u, float() | int() as v, _, 1, *_]:
            off = np.abs(marks.points / _PARTS - [[u], [v]])  # both are rounded
            return bool((off < 1 / _PARTS).all(axis=0).any())
    return True


def _large(strokes: Strokes, least: float) -> Strokes:
    """Leave out what is smaller than ``least``."""
    points, starts, layer, extra = strokes
    if not len(layer):
        return strokes
    low, high = (f.reduceat(points, starts[:-1], axis=1) for f in (np.minimum, np.maximum))
    kept = np.flatnonzero((high - low).max(axis=0) > least)
    index, ends = runs(starts[kept], strokes.counts[kept])
    return Strokes(points[:, index], ends, layer[kept], extra[kept])


def _strokes(lines: Polylines, layer: IntArray, extra: IntArray | None = None) -> Strokes:
    points = np.rint(lines.points[:2] * _PARTS).astype(np.int64)
    extra = np.zeros(len(layer), np.int64) if extra is None else extra
    return Strokes(points, lines.starts, layer, extra)


def _layer(name: str, style: LayerStyle) -> dict[str, Any]:
    fill = {"fill": style.fill_bgr and _hex(style.fill_bgr), "fill_opacity": style.fill_opacity}
    return {"name": name, "line": _hex(style.line_bgr), "width": style.width_px} | fill


def _labels(seen: MapShapes) -> list[list[Any]]:
    """Return text, place, layer, kind, half extents and doubt of each label's candidate."""
    labelled, of = seen.labelled, seen.map.layer
    texts = [cut(seen.map.labels[feature], LONGEST) for feature in labelled.feature.tolist()]
    kinds = np.where(labelled.mark, 1, np.where(labelled.inside, 2, 0)).tolist()
    half, uv = np.rint(labelled.half).astype(int).T.tolist(), labelled.uv.T.tolist()
    uncertain = seen.marked.uncertain.tolist()
    return [
        [texts[k], *_rounded(*uv[k]), int(of[feature]), kinds[k], *half[k], uncertain[k]]
        for k, feature in enumerate(labelled.feature.tolist())
    ]


def _ellipses(seen: MapShapes) -> list[list[Any]]:
    if not seen.ellipses:
        return []
    anchors, marked = seen.anchors, seen.marked
    rows = with_ellipses(anchors, np.flatnonzero(seen.labelled.mark)[:MOST])
    rows = rows[marked.semi_px[rows, 0] >= _LEAST_ELLIPSE_PX]  # nan: none
    return [
        [
            *_rounded(*anchors.uv[:, row].tolist(), *marked.semi_px[row].tolist()),
            round(float(marked.angle[row]), 3),
            int(seen.map.layer[anchors.owner[row]]),
            bool(marked.uncertain[row]),
        ]
        for row in rows.tolist()
    ]


def _targets(markers: MarkerShapes) -> list[list[Any]]:
    semi_px = np.nan_to_num(np.minimum(markers.semi_px, _MOST_ELLIPSE_PX), nan=0.0).tolist()
    places = zip(
        markers.markers, markers.uv.tolist(), semi_px, markers.angle.tolist(), strict=True
    )
    return [
        [marker.id, marker.label, *_rounded(*uv, *semi), round(angle, 3) if semi[0] else 0.0]
        for marker, uv, semi, angle in places
    ]


def _severity(colour: Colour) -> int:
    return 0 if colour == TEXT_BGR else 1 if colour == NOTICE_BGR else 2


def _rounded(*values: float) -> list[float]:
    return [round(value, 1) for value in values]


def _hex(bgr: Colour) -> str:
    blue, green, red = bgr
    return f"#{red:02x}{green:02x}{blue:02x}"


def _columns(strokes: Strokes, *columns: IntArray) -> list[IntArray]:
    return [np.array([len(strokes.layer)]), *columns]


def _steps(points: IntArray) -> IntArray:
    """Return zigzag codes (2 V,) of the steps from point to point, the first one from zero."""
    steps = np.diff(points, axis=1, prepend=0).T.ravel()
    return np.asarray((steps << 1) ^ (steps >> 63))


def _varints(values: IntArray) -> bytes:
    """Write non-negative numbers with seven bits in each byte, the lowest first."""
    if not len(values):
        return b""
    longest = max((int(values.max()).bit_length() + 6) // 7, 1)
    sizes = np.ones(len(values), np.int64)
    for k in range(1, longest):
        sizes += values >= 1 << 7 * k
    first = np.cumsum(sizes) - sizes
    out = np.empty(int(sizes.sum()), np.uint8)
    for k in range(longest):
        has = slice(None) if k == 0 else np.flatnonzero(sizes > k)
        more = np.where(sizes[has] > k + 1, 128, 0)
        out[first[has] + k] = (values[has] >> 7 * k & 127) | more
    return out.tobytes()


def _read_varints(data: bytes) -> IntArray:
    """Read all numbers. Raises ValueError for one that is not whole or has over 35 bits."""
    units = np.frombuffer(data, np.uint8)
    if not len(units):
        return np.empty(0, np.int64)
    last: BoolArray = units < 128
    first = np.flatnonzero(np.append(True, last[:-1]))
    sizes = np.diff(np.append(first, len(units)))
    if not last[-1] or sizes.max() > 5:
        raise ValueError("a number is not whole")
    place, _ = runs(np.zeros_like(sizes), sizes)
    parts = (units & 127).astype(np.int64) << 7 * place
    return np.asarray(np.add.reduceat(parts, first))


class _Numbers:
    """Take columns from a block of numbers. Raises ValueError at its end."""

    def __init__(self, numbers: IntArray) -> None:
        self._numbers, self._at = numbers, 0

    def _take(self, count: int) -> IntArray:
        part = self._numbers[self._at : self._at + count]
        if len(part) < count:
            raise ValueError("numbers are missing")
        self._at += count
        return part

    def columns(self, number: int) -> list[IntArray]:
        count = int(self._take(1)[0])
        return [self._take(count) for _ in range(number)]

    def points(self, count: int) -> IntArray:
        codes = self._take(2 * count).reshape(-1, 2).T
        return np.asarray(np.cumsum((codes >> 1) ^ -(codes & 1), axis=1))
