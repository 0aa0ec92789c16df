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

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.camera.rectification import Rectifier
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.map_layers import MapLayer
from tirgeo_ros.core.overlay.clicks import Marker
from tirgeo_ros.core.overlay.map_renderer import DrapedMap, DrawingVerdict, MapRenderer
from tirgeo_ros.core.overlay.status_and_notices import (
    VERDICT_BGR,
    paint_notice,
    paint_status,
    place_notice,
    status_line,
)
from tirgeo_ros.core.overlay.tone_mapping import ToneMapper
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import NavigationStatus


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


class PicturePainter:
    """Paint pictures in order of time. Raises ConfigError if map heights are unknown.

    ``ground`` is an elevation model, an ellipsoidal height, or nan if it is not given.
    """

    def __init__(
        self, config: OverlayConfig, layers: Sequence[MapLayer], terrain: Terrain | None
    ) -> None:
        self._renderer = MapRenderer(config, layers, terrain)
        self._toner = ToneMapper(config.picture, config.palette)
        self._rectifier: Rectifier | None = None
        self.ground = self._renderer.ground

    @property
    def scene(self) -> Scene:
        """Return what the next picture has in common with others."""
        return Scene(self._renderer.camera, self._rectifier, self._renderer.draped)

    @property
    def has_features(self) -> bool:
        """Return whether there is anything of a map that could be drawn."""
        return not self._renderer.empty

    def footprint(self, pose: CameraPose | None) -> Array:
        """Return the outline (N, 3) on the ground of a picture, NED, m, as the renderer does."""
        return self._renderer.footprint(pose)

    def configure(self, config: OverlayConfig) -> None:
        """Take the parameters that are live, also others in flight."""
        self._toner.configure(config.picture, config.palette)
        self._renderer.set_confidence(config.confidence)

    def set_plane(self, plane: TangentPlane) -> None:
        """Drape the layers in a plane; a map that was draped elsewhere is dropped."""
        self._renderer.set_plane(plane)

    def set_map(self, draped: DrapedMap) -> None:
        """Draw a map that was draped elsewhere, in the present plane."""
        self._renderer.set_map(draped)

    def set_lens(self, camera: Camera, *, rectify: bool) -> None:
        """Set the camera's calibration. Raises CameraError if its images cannot be rectified."""
        self._rectifier = Rectifier(camera) if rectify else None
        self._renderer.set_camera(self._rectifier.camera if self._rectifier else camera)

    def set_scene(self, scene: Scene) -> None:
        """Paint with this camera and map from now on; without a map the present one stays."""
        self._rectifier = scene.rectifier
        if scene.camera is not None:
            self._renderer.set_camera(scene.camera)
        if scene.draped is not None:
            self._renderer.set_map(scene.draped)

    def paint(self, picture: Unpainted) -> OverlayResult:
        """Return the finished picture."""
        image = self._toner.tone(picture.pixels, picture.stamp_ns)
        if self._rectifier is not None and picture.camera is not None:
            image = self._rectifier.rectified(image)
        notice, above_m = picture.notice, math.nan
        if picture.pose is None:
            _write_notice(image, picture)
        else:
            scene = picture.pose, picture.rates, picture.markers, picture.verdict
            drawn = self._renderer.draw(image, *scene, notice)
            notice, above_m = drawn.notice, drawn.above_m
        _write_status(image, picture, above_m)
        return OverlayResult(
            picture.stamp_ns, image, picture.pose, notice, picture.camera, picture.predicted_s
        )


def _write_notice(image: Pixels, picture: Unpainted) -> None:
    """Write why there is no map, below the checks' verdict."""
    severity, words = picture.verdict
    below = 0
    if severity:
        verdict = place_notice(image, words, VERDICT_BGR[severity])
        verdict.paint(image)
        below = verdict.box.bottom
    paint_notice(image, picture.notice, below)


def _write_status(image: Pixels, picture: Unpainted, above_m: float) -> None:
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
