"""Paint one picture: tones, the map, and the words on it.

Everything that depends on other pictures but their tones and labels is decided before
(``Overlay``), so that this, which takes nearly all of the time, can also be done elsewhere.
The painter owns what is drawn with: the camera, the rectifier, the map in its plane.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera, Rectifier
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, is_given
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.frame_geometry import camera_heading_rad, footprint, height_above_m
from tirgeo_ros.core.map.vector_map import MapLayer, check_heights
from tirgeo_ros.core.map.visibility import View, farthest_m
from tirgeo_ros.core.overlay.clicks import Marker, PlacedMarkers
from tirgeo_ros.core.overlay.map_renderer import DrapedMap, MapRenderer, drape_layers
from tirgeo_ros.core.overlay.scale_bar_compass import ground_sample_m, place_rose, place_scale_bar
from tirgeo_ros.core.overlay.tone_mapping import ToneMapper
from tirgeo_ros.core.overlay.written_text import (
    VERDICT_BGR,
    Box,
    PlacedText,
    paint_notice,
    paint_status,
    place_notice,
    status_box,
    status_line,
)
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import NavigationStatus


class DrawingVerdict(NamedTuple):
    """Hold the checks' verdict; ``GO`` has no words in the picture."""

    severity: Severity = Severity.NOTE
    words: str = ""


_GO = DrawingVerdict()


class Scene(NamedTuple):
    """Hold what many pictures have in common."""

    camera: Camera | None = None  # of the picture as shown
    rectifier: Rectifier | None = None  # None if the picture is shown as it is
    draped: DrapedMap | None = None


@dataclass(frozen=True, slots=True)
class Unpainted:
    """Hold a frame with everything that is painted on it."""

    stamp_ns: int
    pixels: RawPixels  # (h, w) of 8 or 16 bits, or (h, w, 3) BGR
    camera: Camera | None  # of the picture as shown; None if unknown or of another size
    pose: CameraPose | None  # at the exposure; None if none can be trusted
    rates: CameraRates | None  # the camera's at the pose, if known
    notice: str  # why there is no trusted pose or no map; else empty
    predicted_s: float  # how far the pose was extrapolated
    markers: tuple[Marker, ...]
    verdict: DrawingVerdict
    status: NavigationStatus | None
    age_s: float  # of the frame
    rate_hz: float  # of the frames; may be nan
    replaced: int  # frames lost so far


@dataclass(frozen=True, slots=True)
class OverlayResult:
    """Hold one finished picture."""

    stamp_ns: int  # of the frame
    image: Pixels  # (h, w, 3) BGR
    pose: CameraPose | None  # at the exposure; None if none can be trusted
    notice: str  # why no map was drawn, or why none is in view; else empty
    camera: Camera | None = None  # of the picture as shown; None if unknown or of another size
    predicted_s: float = 0.0  # how far the pose was extrapolated


class Drawn(NamedTuple):
    """Hold what a picture shows."""

    notice: str  # why none of the map is drawn, else empty
    above_m: float  # the camera's height over the given ground; nan without one below
    boxes: tuple[Box, ...]  # of everything that is written; they do not overlap


class PicturePainter:
    """Paint pictures in order of time. Raises ConfigError if map heights are unknown.

    The map lies at ``ground_height_m`` if that is given, else on the terrain if there is one,
    else at its own heights. ``ground`` is the first two of these, or nan.
    """

    def __init__(
        self, config: OverlayConfig, layers: Sequence[MapLayer], terrain: Terrain | None
    ) -> None:
        height_m = config.ground_height_m
        self.ground: Ground = height_m if terrain is None or math.isfinite(height_m) else terrain
        check_heights(layers, self.ground)
        self.draped: DrapedMap | None = None  # the map with its plane; None without a plane
        self._layers = layers
        self._rectifier: Rectifier | None = None
        self._view: View | None = None
        self._toner = ToneMapper(config.picture, config.palette)
        self._confidence = config.confidence
        self._renderer: MapRenderer | None = None  # made when the map is first drawn

    @property
    def scene(self) -> Scene:
        """Return what the next picture has in common with others."""
        return Scene(self._view.camera if self._view else None, self._rectifier, self.draped)

    @property
    def has_features(self) -> bool:
        """Return whether there is anything of a map that could be drawn."""
        if self.draped:
            return self.draped.features > 0
        return any(layer.features for layer in self._layers)

    def footprint(self, pose: CameraPose | None) -> Array:
        """Return the picture's outline on the ground (N, 3), NED in the plane, m.

        It is cut where lines end, and empty without pose, camera, plane or ground.
        """
        if pose is None or self._view is None or self.draped is None:
            return np.empty((0, 3))
        level = self.ground if is_given(self.ground) else self.draped.level_m
        if not is_given(level):
            return np.empty((0, 3))
        plane, camera = self.draped.plane, self._view.camera
        far_m = farthest_m(camera, height_above_m(pose, plane, level))
        return footprint(camera, pose, plane, level, far_m)

    def configure(self, config: OverlayConfig) -> None:
        """Take the parameters that are live, also others in flight."""
        self._toner.configure(config.picture, config.palette)
        self._confidence = config.confidence
        if self._renderer is not None:
            self._renderer.confidence = config.confidence

    def set_plane(self, plane: TangentPlane) -> None:
        """Drape the layers in a plane; a map that was draped elsewhere is dropped."""
        self.draped, self._renderer = drape_layers(self._layers, plane, self.ground), None

    def set_map(self, draped: DrapedMap) -> None:
        """Draw a map that was draped elsewhere, in the present plane."""
        self._layers, self.draped, self._renderer = (), draped, None

    def set_lens(self, camera: Camera, *, rectify: bool) -> None:
        """Set the camera's calibration. Raises CameraError if its images cannot be rectified."""
        rectifier = Rectifier(camera) if rectify else None
        self.set_scene(Scene(rectifier.camera if rectifier else camera, rectifier))

    def set_scene(self, scene: Scene) -> None:
        """Paint with this camera and map from now on; without a map the present one stays."""
        self._rectifier = scene.rectifier
        if scene.camera is not None and (not self._view or scene.camera != self._view.camera):
            self._view = View(scene.camera)
        if scene.draped is not None:
            self.set_map(scene.draped)

    def paint(self, picture: Unpainted) -> OverlayResult:
        """Return the finished picture."""
        image = self._toner.tone(picture.pixels, picture.stamp_ns)
        if self._rectifier is not None and picture.camera is not None:
            image = self._rectifier.rectified(image)
        notice, above_m = picture.notice, math.nan
        if picture.pose is None:
            least_top = 0
            for placed in _notices(image, picture.verdict, "", None):
                placed.paint(image)
                least_top = placed.box.bottom
            paint_notice(image, notice, least_top)
        else:
            scene = picture.pose, picture.rates, picture.markers, picture.verdict
            notice, above_m, _ = self.draw(image, *scene, notice)
        fields = status_line(
            picture.status,
            picture.age_s,
            picture.rate_hz,
            picture.predicted_s,
            picture.replaced,
            above_m,
            picture.verdict.severity,
        )
        paint_status(image, fields)
        return OverlayResult(
            picture.stamp_ns, image, picture.pose, notice, picture.camera, picture.predicted_s
        )

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
        camera = self._view.camera
        level = self.ground if is_given(self.ground) else self.draped.level_m
        scene = camera, pose, self.draped.plane, level
        if self._renderer is None:
            self._renderer = MapRenderer(self._confidence, self.draped)
        renderer = self._renderer
        scale_m_px = ground_sample_m(*scene) if renderer.minds_scale else math.nan
        above_m = height_above_m(*scene[1:])
        far_m = farthest_m(camera, above_m)
        in_view = renderer.visible(self._view, pose, scale_m_px, far_m)
        notice = notice or renderer.why_absent(in_view, camera, pose, scale_m_px, far_m)
        bar = place_scale_bar(image, *scene) if self._confidence.scale_bar else None
        wants_rose = self._confidence.heading_rose
        rose = place_rose(image, camera_heading_rad(pose)) if wants_rose else None
        notices = _notices(image, verdict, notice, rose.box if rose else None)
        written = [each for each in (bar, rose, *notices) if each]
        taken = [status_box(image), *(each.box for each in written)]
        placed = PlacedMarkers(image, camera, pose, markers, taken) if markers else None
        if placed:
            taken += placed.boxes
        labels = renderer.paint(image, self._view, pose, rates, in_view, taken)
        if placed:
            placed.paint(image, renderer.lines)
        for each in written:
            each.paint(image)
        return Drawn(notice, above_m if is_given(self.ground) else math.nan, (*taken, *labels))


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
