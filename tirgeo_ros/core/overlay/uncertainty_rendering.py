"""Draw the overlay's own uncertainty: lines that fade, and ellipses.

A faded line shows that a feature exists, but no longer where. Ellipses are drawn only at points,
dashed, in a colour of their own, and left out where the mark is about as large. Where an ellipse
would be wrong (the projection is too nonlinear), or is as large as the picture, it is dotted and
its feature is ``uncertain``: its label is grey.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.projection_covariance import (
    FrameConfidence,
    ellipse_95,
    matrices,
    radius_95,
)
from tirgeo_ros.core.config.overlay import ConfidenceConfig
from tirgeo_ros.core.map.polylines import Polylines, runs
from tirgeo_ros.core.map.visibility import VisibleLines
from tirgeo_ros.core.overlay.line_sampling import fading
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

#: Number of equal steps in which opacity falls from 1 to FAINTEST, at the configured radius.
FADE_STEPS = 3
FAINTEST = 0.25
#: An ellipse is drawn if its major semi-axis is at least this many times the mark's radius: of
#: about the same size the two could not be told apart.
MARK_TIMES = 1.5
#: The largest number of ellipses, the same as of labels.
MOST_ELLIPSES = 40

#: Not the default colour of any layer or click: an ellipse is an uncertainty, not a place.
ELLIPSE_BGR = (255, 175, 215)
_CORNERS = 48  # of an ellipse
_TURN = np.linspace(0, 2 * np.pi, _CORNERS + 1)
_CIRCLE = np.array([np.cos(_TURN), np.sin(_TURN)])
_PERIOD, _DASH, _DOT = 6, 3, 1  # in corners: from dash to dash, of a dash, of a dot
NO_DASHES = Polylines(np.empty((2, 0)), np.zeros(1, np.int64), np.empty(0, np.int64))


class Anchors(NamedTuple):
    """Hold points of features whose uncertainty is needed."""

    uv: Array  # (2, N) pixels
    rays: Array  # (3, N) as in Seen
    owner: IntArray  # (N,) their features
    mark: BoolArray  # (N,) whether each is a point feature, which may have an ellipse


class Marked(NamedTuple):
    """Hold what is drawn of some lines and points."""

    lines: Polylines  # cut where their opacity changes
    opacity: Array  # (lines,) 1/4 to 1
    outlines: Polylines  # (2, V) pixels, owned by features: dashes, or dots if uncertain
    uncertain: BoolArray  # (anchors,) the ellipse is over half the picture long, or not known


def marked(
    config: ConfidenceConfig,
    frame: FrameConfidence,
    lines: VisibleLines,
    anchors: Anchors,
    mark_radius_px: float,
    sigma_m: Array | None = None,
) -> Marked:
    """Return faded lines, and the ellipses of anchors that are clearly larger than a mark.

    ``sigma_m`` (features,) is the standard deviation of the map's layers, nan if not given.
    With ``lines: none`` they are returned unchanged. Without ``ellipses`` there are no outlines,
    but ``uncertain`` is still computed.
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
    drawn = anchors.mark & (semi_px[:, 0] >= MARK_TIMES * mark_radius_px)  # nan: not drawn
    chosen = np.flatnonzero(drawn & config.ellipses)
    dashes = ellipse_dashes(
        anchors.uv[:, chosen],
        np.minimum(semi_px[chosen], most_px),
        angle[chosen],
        anchors.owner[chosen],
        uncertain[chosen],
    )
    if not fades:
        return Marked(lines, np.ones(len(lines)), dashes, uncertain)
    radius_px = radius_95(spread[:, count:])
    # fmin turns nan, an unknown radius, into the faintest step.
    step = np.fmin(np.floor(radius_px * (FADE_STEPS / config.fade_px)), FADE_STEPS)
    return Marked(*cut_by(1 - step * ((1 - FAINTEST) / FADE_STEPS)), dashes, uncertain)


def with_marks(labelled: Anchors, marks: VisibleLines) -> Anchors:
    """Return the anchors of labels and those of the nearest other marks, ``MOST_ELLIPSES``."""
    if not len(marks):
        return labelled
    others = np.flatnonzero(~np.isin(marks.owner, labelled.owner))
    most = max(MOST_ELLIPSES - len(labelled.owner), 0)
    if len(others) > most:
        others = np.sort(others[np.argsort(-marks.rays[2, others])[:most]])
    return Anchors(
        np.concatenate([labelled.uv, marks.points[:, others]], axis=1),
        np.concatenate([labelled.rays, marks.rays[:, others]], axis=1),
        np.concatenate([labelled.owner, marks.owner[others]]),
        np.concatenate([labelled.mark, np.ones(len(others), bool)]),
    )


def ellipse_dashes(
    uv: Array, semi_px: Array, angle: Array, owner: IntArray, dotted: BoolArray
) -> Polylines:
    """Return the dashes (2, V) of ellipses around uv (2, N).

    ``semi_px`` (N, 2) are the semi-axes and ``angle`` (N,) those of the larger ones, as returned
    by ``ellipse_95``. ``owner`` (N,) are the features; ``dotted`` (N,) ones have shorter dashes.
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
