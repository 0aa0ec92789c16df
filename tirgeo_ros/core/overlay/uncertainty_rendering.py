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
"""Draw the overlay's own uncertainty: lines that fade, and ellipses.

A faded line shows that a feature exists, but no longer where. The uncertainty changes slowly along
a line, so one value every few pixels is enough: a short line has one opacity, a longer one is cut
where its opacity changes. Ellipses are drawn only at points, dashed, in a colour of their own, and
left out if the mark is about as large. If an ellipse would be wrong (the projection is too
nonlinear), or is over half the picture long, it is dotted and its feature is ``uncertain``: the
feature's label is grey.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.projection_covariance import (
    FrameConfidence,
    ellipse_95,
    matrices,
    radius_95,
)
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.map.polylines import Polylines, joined, runs
from tirgeo_ros.core.map.visibility import VisibleLines
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

#: The uncertainty changes little over this length of a line.
STEP_PX = 48.0
#: Number of equal steps in which opacity falls from 1 to FAINTEST, at the configured radius.
FADE_STEPS = 3
FAINTEST = 0.25
#: An ellipse is drawn if its major semi-axis is at least this many times the mark's radius: with
#: about the same size the two could not be distinguished.
MARK_TIMES = 1.5
#: The largest number of ellipses, the same as that of labels.
MOST_ELLIPSES = 40
#: Not the default colour of any layer or click: an ellipse is an uncertainty, not a place.
ELLIPSE_BGR = (255, 175, 215)
# The polygon of an ellipse.
_CORNERS = 48
_TURN = np.linspace(0, 2 * np.pi, _CORNERS + 1)
_CIRCLE = np.array([np.cos(_TURN), np.sin(_TURN)])
_PERIOD, _DASH, _DOT = 6, 3, 1  # lengths in corners: from dash to dash, of a dash, of a dot
NO_DASHES = Polylines(np.empty((2, 0)), np.zeros(1, np.int64), np.empty(0, np.int64))


class Samples(NamedTuple):
    """Hold some vertices of lines, including the first and the last of each line."""

    vertex: IntArray  # (S,) index of the vertex
    line: IntArray  # (S,) index of the line

    def links(self) -> BoolArray:
        """Return (S - 1,): whether a sample and the next one are of the same line."""
        return np.asarray(self.line[1:] == self.line[:-1])


def short(lines: VisibleLines) -> BoolArray:
    """Return (lines,): whether the uncertainty changes little along the whole line."""
    way = np.empty(lines.points.shape[1])
    way[:-1] = _lengths(lines)
    way[lines.starts[1:] - 1] = 0.0
    return np.asarray(np.add.reduceat(way, lines.starts[:-1]) <= 2 * STEP_PX)


def sampled(lines: VisibleLines, step_px: float) -> tuple[VisibleLines, Samples]:
    """Return the lines, and the vertices at which a new step of ``step_px`` begins.

    Lengths are measured along the larger axis. Segments much longer than STEP_PX get more
    vertices, because the uncertainty may change along them. The points already contain the
    lens distortion.
    """
    length = _lengths(lines)
    long = np.flatnonzero((length > 2 * STEP_PX) & lines.links())
    if len(long):
        pieces = np.ones(len(length), np.int64)
        pieces[long] = np.ceil(length[long] / STEP_PX)
        both = np.concatenate([lines.points, lines.rays])
        finer = Polylines(both, lines.starts, lines.owner).subdivided(pieces)
        lines = VisibleLines(finer.points[:2], finer.starts, finer.owner, finer.points[2:])
        length = _lengths(lines)
    way = (np.cumsum(length) / step_px).astype(np.int64)
    chosen = np.zeros(lines.points.shape[1], bool)
    chosen[1:-1] = way[1:] != way[:-1]
    chosen[lines.starts[:-1]] = chosen[lines.starts[1:] - 1] = True
    vertex = np.flatnonzero(chosen)
    return lines, Samples(vertex, np.searchsorted(lines.starts, vertex, side="right") - 1)


def _lengths(lines: VisibleLines) -> Array:
    step = lines.points[:, 1:] - lines.points[:, :-1]
    np.abs(step, out=step)
    return np.asarray(np.maximum(step[0], step[1], out=step[0]))


def cut(lines: Polylines, samples: Samples, value: Array) -> tuple[Polylines, IntArray]:
    """Cut the lines where the value of the interval between two samples changes.

    ``value`` is (S - 1,). Return the parts and the first sample of each.
    """
    links = samples.links()
    changes = value[1:] != value[:-1]
    opens, closes = links.copy(), links.copy()
    opens[1:] &= changes | ~links[:-1]
    first = np.flatnonzero(opens)
    if len(first) == len(lines) and not (changes & links[1:] & links[:-1]).any():
        return lines, first
    closes[:-1] &= changes | ~links[1:]
    begin, end = samples.vertex[first], samples.vertex[np.flatnonzero(closes) + 1]
    index, starts = runs(begin, end - begin + 1)
    owner = lines.owner[samples.line[first]]
    return Polylines(lines.points[:2].take(index, axis=1), starts, owner), first


def fading(
    lines: VisibleLines,
) -> tuple[Array, IntArray, Callable[[Array], tuple[Polylines, Array]]]:
    """Choose the points of lines at which their opacity is needed: rays (3, N), features (N,).

    They are a middle vertex of each short line, then the middles of the longer lines' intervals.
    The third result is a function: from the opacities (N,) of the points it returns the lines, cut
    where their opacity changes, and the opacities of the parts.
    """
    whole = short(lines)
    few = lines if whole.all() else lines.select(np.flatnonzero(whole))
    half_way = few.rays.take((few.starts[:-1] + few.starts[1:]) // 2, axis=1)
    if whole.all():
        return half_way, few.owner, lambda opacity: (few, opacity)
    many, samples = sampled(lines.select(np.flatnonzero(~whole)), STEP_PX)
    ways = np.flatnonzero(samples.links())  # the sample at which each interval begins
    first, last = samples.vertex[ways], samples.vertex[ways + 1]
    middle = (many.rays.take(first, axis=1) + many.rays.take(last, axis=1)) / 2
    rays = np.concatenate([half_way, middle], axis=1)
    owner = np.concatenate([few.owner, many.owner[samples.line[ways]]])

    def cut_by(opacity: Array) -> tuple[Polylines, Array]:
        of_short, of_ways = np.split(opacity, [len(few)])
        along = np.ones(len(samples.line) - 1)
        along[ways] = of_ways
        parts, way = cut(many, samples, along)
        return joined(parts, few), np.concatenate([along[way], of_short])

    return rays, owner, cut_by


class Anchors(NamedTuple):
    """Hold the points of features at which the uncertainty is needed."""

    uv: Array  # (2, N) pixels
    rays: Array  # (3, N) as in VisibleLines
    owner: IntArray  # (N,) their features
    mark: BoolArray  # (N,) whether each is a point feature, which may have an ellipse


class Marked(NamedTuple):
    """Hold lines with their opacity, and the 95 % ellipses of anchors."""

    lines: Polylines  # cut where their opacity changes
    opacity: Array  # (lines,) 1/4 to 1
    semi_px: Array  # (anchors, 2) semi-axes, at most a quarter of the picture; nan if unknown
    angle: Array  # (anchors,) of the larger semi-axis, from u towards v
    uncertain: BoolArray  # (anchors,) the ellipse is over half the picture long, or unknown


def marked(
    config: ConfidenceConfig,
    frame: FrameConfidence,
    lines: VisibleLines,
    anchors: Anchors,
    sigma_m: Array | None = None,
) -> Marked:
    """Return faded lines, and the ellipses of anchors.

    ``sigma_m`` (features,) is the standard deviation of each feature's layer, nan if it has none.
    With ``lines: none`` the lines are returned unchanged.
    """
    fades = config.lines != "none" and len(lines)
    rays, owner, count = anchors.rays, anchors.owner, len(anchors.owner)
    if fades:
        of_lines, owners, cut_by = fading(lines)
        rays = np.concatenate([rays, of_lines], axis=1)
        owner = np.concatenate([owner, owners])
    # One call for all points: for so few, most of the time is call overhead.
    spread, linear = frame.spread(rays, None if sigma_m is None else sigma_m[owner], count)
    semi_px, angle = ellipse_95(matrices(spread[:, :count]))
    most_px = min(frame.camera.width, frame.camera.height) / 4
    uncertain = ~(linear & (semi_px[:, 0] <= most_px))
    plain = Marked(lines, np.ones(len(lines)), np.minimum(semi_px, most_px), angle, uncertain)
    if not fades:
        return plain
    radius_px = radius_95(spread[:, count:])
    # fmin turns nan, an unknown radius, into the faintest step.
    step = np.fmin(np.floor(radius_px * (FADE_STEPS / config.fade_px)), FADE_STEPS)
    parts, opacity = cut_by(1 - step * ((1 - FAINTEST) / FADE_STEPS))
    return plain._replace(lines=parts, opacity=opacity)


def with_marks(labelled: Anchors, marks: VisibleLines) -> Anchors:
    """Return the anchors of labels, then those of the nearest ``MOST_ELLIPSES`` other marks."""
    if not len(marks):
        return labelled
    others = np.flatnonzero(~np.isin(marks.owner, labelled.owner))
    if len(others) > MOST_ELLIPSES:
        others = np.sort(others[np.argsort(-marks.rays[2, others])[:MOST_ELLIPSES]])
    return Anchors(
        np.concatenate([labelled.uv, marks.points[:, others]], axis=1),
        np.concatenate([labelled.rays, marks.rays[:, others]], axis=1),
        np.concatenate([labelled.owner, marks.owner[others]]),
        np.concatenate([labelled.mark, np.ones(len(others), bool)]),
    )


def with_ellipses(anchors: Anchors, labelled: IntArray) -> IntArray:
    """Return the marks among the anchors that get an ellipse: at most ``MOST_ELLIPSES``.

    They are the ``labelled`` ones, indices of anchors, then the nearest.
    """
    others = anchors.mark.copy()
    others[labelled] = False
    rest = np.flatnonzero(others)
    most = max(MOST_ELLIPSES - len(labelled), 0)
    if len(rest) > most:
        rest = rest[np.argsort(-anchors.rays[2, rest])[:most]]
    return np.concatenate([labelled[anchors.mark[labelled]], rest])


def outlines(anchors: Anchors, shapes: Marked, rows: IntArray, mark_radius_px: float) -> Polylines:
    """Return the dashes (2, V) of the ellipses of some anchors that are larger than a mark."""
    large = shapes.semi_px[rows, 0] >= MARK_TIMES * mark_radius_px  # nan: not drawn
    rows = rows[large]
    ellipses = anchors.uv[:, rows], shapes.semi_px[rows], shapes.angle[rows]
    return ellipse_dashes(*ellipses, anchors.owner[rows], shapes.uncertain[rows])


def ellipse_dashes(
    uv: Array, semi_px: Array, angle: Array, owner: IntArray, dotted: BoolArray
) -> Polylines:
    """Return the dashes (2, V) of ellipses around uv (2, N).

    ``semi_px`` (N, 2) are the semi-axes and ``angle`` (N,) the angles of the larger ones, from
    ``ellipse_95``. ``owner`` (N,) are the features. ``dotted`` (N,) ellipses have shorter dashes.
    """
    if not len(owner):
        return NO_DASHES
    c, s = np.cos(angle), np.sin(angle)
    along, across = semi_px.T
    axes = np.array([[along * c, -across * s], [along * s, across * c]])
    # (2, N, corners + 1); the last corner of an ellipse equals the first.
    corners = axes.transpose(0, 2, 1) @ _CIRCLE + uv[:, :, None]
    dashes = _CORNERS // _PERIOD
    begins = _PERIOD * np.arange(dashes)
    which = np.repeat(np.arange(len(owner)), dashes)
    lengths = np.where(dotted[which], _DOT, _DASH) + 1
    begin = np.tile(begins, len(owner)) + which * (_CORNERS + 1)
    number, starts = runs(begin, lengths)
    return Polylines(corners.reshape(2, -1).take(number, axis=1), starts, owner[which])
