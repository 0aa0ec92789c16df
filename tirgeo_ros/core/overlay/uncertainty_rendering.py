"""What the picture shows of its own uncertainty: lines that fade or have a band, and ellipses.

    confidence = Confidence(config.confidence)
    frame = confidence.frame(camera, pose, rates)                      # once a picture
    confidence.paint_bands(image, frame, lines, layer, styles, sigma)  # under the lines
    marked = confidence.marked(frame, lines, anchors, radius_px, sigma)   # for Painter.strokes

A faded line says that there is something, no longer where. Ellipses are at points alone, dashed,
in a colour of their own, and left out where the mark is about as large. Where one would not tell
the truth, or is as large as the picture, it is dotted and its feature is ``uncertain``: the label
belongs in grey.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.camera.model import Camera
from tirgeo_ros.core.camera.projection_covariance import (
    CameraRates,
    FrameConfidence,
    ellipse_95,
    matrices,
    radius_95,
)
from tirgeo_ros.core.config.pictures import ConfidenceConfig
from tirgeo_ros.core.map.layers import LayerStyle
from tirgeo_ros.core.map.polylines import Polylines, runs
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.map.visibility import Seen
from tirgeo_ros.core.overlay.line_fading import Fading
from tirgeo_ros.core.overlay.line_sampling import each, ribbons, sampled
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray, Pixels
from tirgeo_ros.core.types.poses import CameraPose

#: Opacity falls in so many equal steps, from 1 to the faintest, at the configured radius.
FADE_STEPS = 3
FAINTEST = 0.25
#: An ellipse is drawn if its major semi-axis is so many times the mark's radius: of about the same
#: size the two could not be told apart.
MARK_TIMES = 1.5
#: As many ellipses as labels, at most.
MOST_ELLIPSES = 40

_BAND_STEP_PX = 16.0
_BAND_OPACITY = 0.25
#: No layer's by default, nor a click's: what is so drawn is no place but a doubt.
ELLIPSE_BGR = (255, 175, 215)
_CORNERS = 48  # of an ellipse
_TURN = np.linspace(0, 2 * np.pi, _CORNERS + 1)
_CIRCLE = np.array([np.cos(_TURN), np.sin(_TURN)])
_PERIOD, _DASH, _DOT = 6, 3, 1  # corners, from dash to dash and along one


class Anchors(NamedTuple):
    """Points of features whose uncertainty is asked for."""

    uv: Array  # (2, N) pixels
    rays: Array  # (3, N) as Seen has them
    owner: IntArray  # (N,) their features
    mark: BoolArray  # (N,) whether each is a point of the map: it may have an ellipse


@dataclass(frozen=True, slots=True)
class Ellipses:
    """Ellipses of 95 % for N anchors."""

    outlines: Polylines  # (2, V) pixels, owned by features: the dashes, or dots of a hint
    uncertain: BoolArray  # (N,) the ellipse is longer than half the picture, or nobody can tell


class Marked(NamedTuple):
    """What is drawn of some lines and points."""

    lines: Polylines  # cut where their opacity changes
    opacity: Array  # (lines,) 1/4 to 1
    ellipses: Ellipses


class Confidence:
    """Draws the overlay's uncertainty as the configuration says."""

    def __init__(self, config: ConfidenceConfig) -> None:
        self._config = config

    def frame(
        self, camera: Camera, pose: CameraPose, rates: CameraRates | None = None
    ) -> FrameConfidence:
        """The errors of one frame: pose and rates at its exposure."""
        return FrameConfidence(self._config, camera, pose, rates)

    def marked(
        self,
        frame: FrameConfidence,
        lines: Seen,
        anchors: Anchors,
        mark_radius_px: float,
        sigma_m: Array | None = None,
    ) -> Marked:
        """Lines that fade, and the ellipses of anchors that are clearly larger than a mark.

        ``sigma_m`` (features,) of the map's layers, nan where not told. Lines with a band fade
        too: a strong line in the middle of a broad band would still be believed. If nothing is to
        become of lines, they are returned as they are. Without ellipses in the configuration
        there are no outlines, but still the word on what is uncertain.
        """
        fades = self._config.lines != "none" and len(lines)
        fading = Fading.of(lines) if fades else None
        rays, owner, count = anchors.rays, anchors.owner, len(anchors.owner)
        if fading:
            rays = np.concatenate([rays, fading.rays], axis=1)
            owner = np.concatenate([owner, fading.owner])
        # All in one: for so few points most of the time goes into the calls.
        spread, linear = frame.spread(rays, each(sigma_m, owner), closely=count)
        ellipses = self._ellipses(frame.camera, anchors, spread[:, :count], linear, mark_radius_px)
        if not fading:
            return Marked(lines, np.ones(len(lines)), ellipses)
        return Marked(*fading.cut(self._opacity(radius_95(spread[:, count:]))), ellipses)

    def _opacity(self, radius_px: Array) -> Array:
        """For radii of 95 %; what is not known (nan) is at its faintest."""
        step = np.fmin(np.floor(radius_px * (FADE_STEPS / self._config.fade_px)), FADE_STEPS)
        return np.asarray(1 - step * ((1 - FAINTEST) / FADE_STEPS))

    def paint_bands(
        self,
        image: Pixels,
        frame: FrameConfidence,
        lines: Seen,
        layer: IntArray,
        styles: Sequence[LayerStyle],
        sigma_m: Array | None = None,
    ) -> None:
        """Tint (h, w, 3) where 95 % of the true lines run, if lines are to have a band.

        ``layer`` (lines,) is the index of each line's style, whose colour the band has. No band
        is wider than half the picture.
        """
        if self._config.lines != "band" or not len(lines):
            return
        lines, some = sampled(lines, _BAND_STEP_PX)
        most_px = min(image.shape[:2]) / 4
        quads = ribbons(frame, lines, some, each(sigma_m, some.line), most_px)
        of_quad = layer[some.line[:-1]]
        wide = np.isfinite(quads).all(axis=(1, 2))
        for number in np.unique(of_quad[wide]).tolist():
            _tint(image, quads[wide & (of_quad == number)], styles[number])

    def _ellipses(
        self,
        camera: Camera,
        anchors: Anchors,
        spread: Array,
        linear: BoolArray,
        mark_radius_px: float,
    ) -> Ellipses:
        semi_px, angle = ellipse_95(matrices(spread))
        most_px = min(camera.width, camera.height) / 4
        uncertain = ~(linear & (semi_px[:, 0] <= most_px))
        drawn = anchors.mark & (semi_px[:, 0] >= MARK_TIMES * mark_radius_px)  # not if nan
        chosen = np.flatnonzero(drawn & self._config.ellipses)
        semi_px, owner = semi_px[chosen], anchors.owner[chosen]
        uv, within_px = anchors.uv[:, chosen], np.minimum(semi_px, most_px)
        dashes = ellipse_dashes(uv, within_px, angle[chosen], owner, uncertain[chosen])
        return Ellipses(dashes, uncertain)


def layer_sigmas(vector_map: VectorMap) -> Array:
    """(features,) standard deviation of the places of each feature's layer, m; nan: not told."""
    told = [np.nan if layer.sigma_m is None else layer.sigma_m for layer in vector_map.layers]
    return np.array(told, float)[vector_map.layer]


def with_marks(labelled: Anchors, marks: Seen, camera: Camera) -> Anchors:
    """The anchors of labels, and other marks: all, if that is not too many.

    Else one in each part of the picture where there is none yet, up to the most there may be.
    """
    if not len(marks):
        return labelled
    others = np.flatnonzero(~np.isin(marks.owner, labelled.owner))
    uv = np.concatenate([labelled.uv, marks.points[:, others]], axis=1)
    kept, labels = _spread_out(uv, camera), len(labelled.owner)
    others = others[(kept[kept >= labels] - labels)[: max(MOST_ELLIPSES - labels, 0)]]
    rays = np.concatenate([labelled.rays, marks.rays[:, others]], axis=1)
    uv = np.concatenate([labelled.uv, marks.points[:, others]], axis=1)
    owner = np.concatenate([labelled.owner, marks.owner[others]])
    return Anchors(uv, rays, owner, np.concatenate([labelled.mark, np.ones(len(others), bool)]))


def _tint(image: Pixels, quads: Array, style: LayerStyle) -> None:
    """Lay a layer's colour thinly over the picture, once where quads overlap."""
    mask = np.zeros(image.shape[:2], np.uint8)
    for quad in np.rint(quads).astype(np.int32):
        cv2.fillConvexPoly(mask, quad, (255,))
    tinted = cv2.convertScaleAbs(image, alpha=1 - _BAND_OPACITY)
    cv2.copyTo(tinted, mask, image)
    cv2.add(image, np.array([*style.line_bgr, 0.0]) * _BAND_OPACITY, dst=image, mask=mask)


def _spread_out(uv: Array, camera: Camera) -> IntArray:
    """All (2, N), if they are not too many; else the first of each part of the picture."""
    if uv.shape[1] <= MOST_ELLIPSES:
        return np.arange(uv.shape[1])
    side = np.sqrt(camera.width * camera.height / MOST_ELLIPSES)
    across = np.ceil(camera.width / side)
    cell = np.floor(uv[0] / side) + across * np.floor(uv[1] / side)
    _, first = np.unique(cell, return_index=True)
    return np.sort(first)[:MOST_ELLIPSES]


def ellipse_dashes(
    uv: Array, semi_px: Array, angle: Array, owner: IntArray, dotted: BoolArray
) -> Polylines:
    """Dashes (2, V) of ellipses around uv (2, N).

    Semi-axes (N, 2) and the angles (N,) of the larger ones, as ``ellipse_95`` gives them.
    ``owner`` (N,) is whose they are; those that are ``dotted`` (N,) have shorter dashes.
    """
    corners = _corners(uv, semi_px, angle)
    dashes = _CORNERS // _PERIOD
    begins = _PERIOD * np.arange(dashes)
    which = np.repeat(np.arange(len(owner)), dashes)
    lengths = np.where(dotted[which], _DOT, _DASH) + 1
    begin = np.tile(begins, len(owner)) + which * (_CORNERS + 1)
    number, starts = runs(begin, lengths)
    return Polylines(corners.reshape(2, -1).take(number, axis=1), starts, owner[which])


def _corners(uv: Array, semi_px: Array, angle: Array) -> Array:
    """(2, N, corners + 1), the last one the first."""
    c, s = np.cos(angle), np.sin(angle)
    along, across = semi_px.T
    axes = np.array([[along * c, -across * s], [along * s, across * c]])
    return np.asarray(axes.transpose(0, 2, 1) @ _CIRCLE + uv[:, :, None])
