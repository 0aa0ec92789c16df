"""Draw a map into a picture, given the camera and its pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates, FrameConfidence
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, is_given
from tirgeo_ros.core.ground.camera_place import height_above_m
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.frame_geometry import footprint
from tirgeo_ros.core.map.map_layers import LayerStyle, MapLayer
from tirgeo_ros.core.map.polylines import joined
from tirgeo_ros.core.map.vector_map import VectorMap, check_heights
from tirgeo_ros.core.map.visibility import View, VisibleLines, farthest_m
from tirgeo_ros.core.overlay.clicks import Marker, PlacedMarkers
from tirgeo_ros.core.overlay.label_placement import UNCERTAIN_BGR, Labels
from tirgeo_ros.core.overlay.line_renderer import LineRenderer, mark_radius_px, marks_as_lines
from tirgeo_ros.core.overlay.map_absence import MapAbsence
from tirgeo_ros.core.overlay.scale_bar_compass import (
    camera_heading_rad,
    ground_sample_m,
    place_rose,
    place_scale_bar,
)
from tirgeo_ros.core.overlay.status_and_notices import (
    VERDICT_BGR,
    PlacedText,
    place_notice,
    status_box,
)
from tirgeo_ros.core.overlay.text_rendering import (
    LONGEST,
    TEXT_BGR,
    Box,
    can_shape,
    stamp,
    text_px,
    writable,
)
from tirgeo_ros.core.overlay.uncertainty_rendering import (
    ELLIPSE_BGR,
    marked,
    with_marks,
)
from tirgeo_ros.core.types.arrays import Array, Pixels
from tirgeo_ros.core.types.errors import cut
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.poses import CameraPose


class VisibleMap(NamedTuple):
    """Hold the visible part of a map."""

    areas: VisibleLines
    lines: VisibleLines
    marks: VisibleLines
    hidden: bool  # whether features in view were left out because of their layers' scale range

    @property
    def empty(self) -> bool:
        """Return whether there is nothing to draw."""
        return not (len(self.areas) or len(self.lines) or len(self.marks))


class LayerPainter:
    """Paint one map, frame after frame."""

    def __init__(
        self, config: ConfidenceConfig, vector_map: VectorMap, painter: LineRenderer | None = None
    ) -> None:
        self._map = vector_map
        self._styles: Sequence[LayerStyle] = [layer.style for layer in vector_map.layers]
        ranges = [style.scale_m_px for style in self._styles]
        self._scales_m_px = np.array(ranges, float).reshape(-1, 2)
        # Position sigma of each feature's layer, m; nan if the style has none.
        layer_m = [math.nan if m.sigma_m is None else m.sigma_m for m in vector_map.layers]
        sigmas_m = np.array(layer_m, float)[vector_map.layer]
        self._sigmas_m = None if np.isnan(sigmas_m).all() else sigmas_m
        self._painter = painter or LineRenderer()
        self.confidence = config
        self._labels = Labels(vector_map)
        #: Whether some layers have a limited scale range.
        self.minds_scale = any(some != LayerStyle().scale_m_px for some in ranges)

    def visible(self, view: View, pose: CameraPose, scale_m_px: float, far_m: float) -> VisibleMap:
        """Return what is in view: areas, and lines and marks up to ``far_m`` ahead.

        ``scale_m_px`` is the ground length that a pixel in the middle spans, nan without ground.
        """
        in_view = (
            view.areas(self._map, pose),
            view.lines(self._map, pose, far_m),
            view.marks(self._map, pose, far_m),
        )
        areas, lines, marks = (self._at_scale(each, scale_m_px) for each in in_view)
        shown = len(areas) + len(lines) + len(marks)
        return VisibleMap(areas, lines, marks, hidden=shown < sum(map(len, in_view)))

    def paint(
        self,
        image: Pixels,
        view: View,
        pose: CameraPose,
        rates: CameraRates | None,
        visible: VisibleMap,
        taken: Sequence[Box],
    ) -> list[Box]:
        """Paint what is in view into (h, w, 3) BGR; return the boxes of its labels.

        Labels avoid the boxes in ``taken``. ``rates`` are the camera's at the pose, or None.
        """
        areas, lines, marks, _ = visible
        of = self._map.layer
        frame = FrameConfidence(self.confidence, view.camera, pose, rates)
        self._painter.areas(image, areas, of[areas.owner], self._styles, view.reached)
        labels, points = self._labels.place(image, lines, marks, taken)
        anchors, radius_px = with_marks(points, marks), mark_radius_px(image)
        lines_px, opacity, outlines, unknown = marked(
            self.confidence, frame, lines, anchors, radius_px, self._sigmas_m
        )
        diamonds = marks_as_lines(marks, radius_px)
        # Ellipses first, so that the marks, which are the true places, are drawn over them.
        self._painter.thin_strokes(image, outlines, ELLIPSE_BGR)
        ink = joined(lines_px, diamonds)
        strength = np.concatenate([opacity, np.ones(len(diamonds))])
        self._painter.strokes(image, ink, of[ink.owner], self._styles, strength)
        size_px, uncertain = text_px(image), set(anchors.owner[unknown].tolist())
        for feature, box in labels:
            colour = UNCERTAIN_BGR if feature in uncertain else TEXT_BGR
            stamp(self._map.labels[feature], size_px, colour).lay(image, box.left, box.top)
        return [label.box for label in labels]

    def _at_scale(self, lines: VisibleLines, scale_m_px: float) -> VisibleLines:
        """Return the features whose layers are shown at this scale."""
        if not self.minds_scale or not len(lines):
            return lines
        if math.isnan(scale_m_px):  # no ground in the middle: treat as the coarsest scale
            scale_m_px = math.inf
        low, high = self._scales_m_px.T
        shown = ((low <= scale_m_px) & (scale_m_px <= high))[self._map.layer[lines.owner]]
        return lines if shown.all() else lines.select(np.flatnonzero(shown))


@dataclass(frozen=True, slots=True)
class DrapedMap:
    """Hold a map draped in a plane, without the layers that it was made from."""

    plane: TangentPlane
    map: VectorMap
    features: int  # number of features in the layers
    level_m: float  # median of the map's own heights; nan where a ground is given
    first_n: Array | None = None  # (3,) the first of the layers' points, on the ellipsoid


class DrawingVerdict(NamedTuple):
    """Hold the checks' verdict; ``GO`` has no words in the picture."""

    severity: Severity = Severity.NOTE
    words: str = ""


class Drawn(NamedTuple):
    """Hold what a picture shows."""

    notice: str  # why none of the map is drawn, else empty
    above_m: float  # the camera's height over the given ground; nan without one below
    boxes: tuple[Box, ...]  # of everything that is written; they do not overlap


_GO = DrawingVerdict()


def drape_layers(layers: Sequence[MapLayer], plane: TangentPlane, ground: Ground) -> DrapedMap:
    """Drape layers in a plane, the slow part of a map. Raises ConfigError as VectorMap does."""
    check_heights(layers, ground)
    features = sum(len(layer.features) for layer in layers)
    draped = _written(VectorMap.from_layers(layers, plane, ground))
    places = [feature.points for layer in layers for feature in layer.features]
    level_m = math.nan
    if places and not is_given(ground):
        level_m = float(np.median(np.concatenate(places)[:, 2]))
    first_n = None
    if places:
        latitude, longitude, _ = places[0][0]
        first_n = plane.ned_from_geodetic(latitude, longitude, 0.0)
    return DrapedMap(plane, draped, features, level_m, first_n)


def _written(draped: VectorMap) -> VectorMap:
    """Return a map without the labels that cannot be written here, and with a note of them."""
    lost = [i for i in np.flatnonzero(draped.labelled).tolist() if not writable(draped.labels[i])]
    if not lost:
        return draped
    labelled = draped.labelled.copy()
    labelled[lost] = False
    needed = "a typeface with their letters" + ("" if can_shape() else ", or libfribidi0")
    example = cut(draped.labels[lost[0]], LONGEST)
    note = f"map: labels not drawn: {len(lost)}, as {example!r}; they need {needed}"
    return replace(draped, labelled=labelled, notes=(*draped.notes, note))


class MapRenderer:
    """Draw the layers of a map, draped in a plane, as a camera sees them.

    The map lies at ``ground_height_m`` if that is given, else on the terrain if there is one,
    else at its own heights. Raises ConfigError if these are unknown.
    """

    def __init__(
        self, config: OverlayConfig, layers: Sequence[MapLayer], terrain: Terrain | None
    ) -> None:
        self._view: View | None = None
        height_m = config.ground_height_m
        self.ground: Ground = height_m if terrain is None or math.isfinite(height_m) else terrain
        check_heights(layers, self.ground)
        self._layers = layers
        self.draped: DrapedMap | None = None  # the map with its plane; None without a plane
        self._confidence = config.confidence
        self._painter = LineRenderer()
        self._layer_painter: LayerPainter | None = None  # made when the map is first drawn
        self._absence: MapAbsence | None = None  # made when the map is first out of view

    @property
    def empty(self) -> bool:
        """Return whether there is nothing that could be drawn."""
        if self.draped:
            return not self.draped.features
        return not any(layer.features for layer in self._layers)

    @property
    def camera(self) -> Camera | None:
        """Return the camera of the picture that is drawn into."""
        return self._view.camera if self._view else None

    def set_confidence(self, confidence: ConfidenceConfig) -> None:
        """Set how the uncertainty is drawn."""
        self._confidence = confidence
        if self._layer_painter is not None:
            self._layer_painter.confidence = confidence

    def set_map(self, new: DrapedMap) -> None:
        """Set a map that was draped elsewhere, in the present plane."""
        self._layers = ()
        self._set(new)

    def set_plane(self, plane: TangentPlane) -> None:
        """Set the plane in which poses are given; a map that was draped elsewhere is dropped."""
        self._set(drape_layers(self._layers, plane, self.ground))

    def set_camera(self, camera: Camera) -> None:
        """Set the camera of the picture that is drawn into."""
        if self._view is None or camera != self._view.camera:
            self._view = View(camera)

    @property
    def level(self) -> Ground:
        """Return the given ground, else the middle height of the map's own; nan without any."""
        own_m = self.draped.level_m if self.draped else math.nan
        return self.ground if is_given(self.ground) else own_m

    def footprint(self, pose: CameraPose | None) -> Array:
        """Return the picture's outline on the ground (N, 3), NED in the plane, m.

        It is cut where lines end, and empty without pose, camera, plane or ground.
        """
        level = self.level
        if pose is None or self._view is None or self.draped is None or not is_given(level):
            return np.empty((0, 3))
        plane = self.draped.plane
        far_m = farthest_m(self._view.camera, height_above_m(pose, plane, level))
        return footprint(self._view.camera, pose, plane, level, far_m)

    def _set(self, draped: DrapedMap) -> None:
        self.draped, self._layer_painter, self._absence = draped, None, None

    def draw(
        self,
        image: Pixels,
        pose: CameraPose,
        rates: CameraRates | None = None,
        markers: Sequence[Marker] = (),
        verdict: DrawingVerdict = _GO,
        notice: str = "",
    ) -> Drawn:
        """Draw map and markers into (h, w, 3) BGR; a camera and a plane must be set.

        ``rates`` are the camera's at the pose, or None. The ``verdict`` of the checks, and the
        ``notice``, else the reason why none of the map is in view, are written at the top.
        """
        assert self._view is not None
        assert self.draped is not None
        camera, ground = self._view.camera, self.ground
        scene = camera, pose, self.draped.plane, self.level
        if self._layer_painter is None:
            self._layer_painter = LayerPainter(self._confidence, self.draped.map, self._painter)
        painter = self._layer_painter
        scale_m_px = ground_sample_m(*scene) if painter.minds_scale else math.nan
        above_m = height_above_m(*scene[1:])
        far_m = farthest_m(camera, above_m)
        in_view = painter.visible(self._view, pose, scale_m_px, far_m)
        notice = notice or self._absent(in_view, pose, scale_m_px, far_m)
        bar = place_scale_bar(image, *scene) if self._confidence.scale_bar else None
        wants_rose = self._confidence.heading_rose
        rose = place_rose(image, camera_heading_rad(pose)) if wants_rose else None
        notices = _notices(image, verdict, notice, rose.box if rose else None)
        written = [each for each in (bar, rose, *notices) if each]
        taken = [status_box(image), *(each.box for each in written)]
        placed = PlacedMarkers(image, camera, pose, markers, taken) if markers else None
        if placed:
            taken += placed.boxes
        labels = painter.paint(image, self._view, pose, rates, in_view, taken)
        if placed:
            placed.paint(image, self._painter)
        for each in written:
            each.paint(image)
        return Drawn(notice, above_m if is_given(ground) else math.nan, (*taken, *labels))

    def _absent(
        self, visible: VisibleMap, pose: CameraPose, scale_m_px: float, far_m: float
    ) -> str:
        """Return why none of a map is in view, else an empty string."""
        if not visible.empty or self.empty:
            return ""
        return f"NO MAP IN VIEW: {self._why_absent(visible, pose, scale_m_px, far_m)}"

    def _why_absent(
        self, visible: VisibleMap, pose: CameraPose, scale_m_px: float, far_m: float
    ) -> str:
        if visible.hidden:
            words = f"{100 * scale_m_px:.2g} cm" if scale_m_px < 1 else f"{scale_m_px:.3g} m"
            sees_ground = not math.isnan(scale_m_px)
            sample = f"{words} a pixel" if sees_ground else "the picture's middle sees no ground"
            return f"no layer is shown at this scale ({sample})"
        assert self._view is not None
        assert self.draped is not None
        if self._absence is None:
            self._absence = MapAbsence(self.draped.map, self.draped.plane, self.draped.first_n)
        return self._absence.why(self._view.camera, pose, far_m)


def _notices(
    image: Pixels, verdict: DrawingVerdict, notice: str, beside: Box | None
) -> list[PlacedText]:
    """Place the notices one below the other, at the top of the picture, left of the rose."""
    notices = []
    if verdict.severity:
        colour = VERDICT_BGR[verdict.severity]
        notices.append(place_notice(image, verdict.words, colour, beside=beside))
    if notice:
        top = notices[0].box.bottom if notices else 0
        notices.append(place_notice(image, notice, top=top, beside=beside))
    return notices
