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
"""Paint one picture: tones, the map, and the words on it.

Of all that depends on earlier pictures, only tones and labels are computed here; ``Overlay``
decides the rest before. So painting, which takes nearly all of the time, can also run in another
process. The painter owns what it draws with: the camera, the rectifier, the draped map.

A stretch of 16 bits computed anew for each frame flickers: a warm roof that comes into view
darkens everything else at once. Here it stays constant while it fits, and otherwise moves slowly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.config.overlay_parameters import PALETTES, PictureConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Terrain, is_given
from tirgeo_ros.core.ground.frame_geometry import (
    Sight,
    camera_heading_rad,
    footprint,
    height_above_m,
)
from tirgeo_ros.core.map.vector_map import MapLayer, check_heights
from tirgeo_ros.core.map.visibility import View, farthest_m
from tirgeo_ros.core.overlay.clicks import Marker, PlacedMarkers
from tirgeo_ros.core.overlay.map_renderer import DrapedMap, MapRenderer, drape_layers
from tirgeo_ros.core.overlay.scale_bar_compass import ground_sample_m, place_rose, place_scale_bar
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
from tirgeo_ros.core.types.errors import CameraError, ConfigError
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import NavigationStatus

_MOST_RECTIFIED = 10_000_000  # cinema 4K has 9e6; building the maps takes 80 bytes for each pixel
_BORDER_BGR = (40, 40, 110)  # of a rectified picture
#: Number of time constants in stretch_time_s: 95 % of a change is followed within it.
_CONSTANTS = 3.0
#: A stretch starts to move when an end is off by more than the first share of its span, and stops
#: when both ends are within the second.
_LEAVES, _ARRIVES = 0.05, 0.01
#: A smaller change of a span's logarithm is treated as none.
_PLAIN_GROWTH = 1e-3
#: A smaller span would show only the sensor's noise.
_LEAST_SPAN = 16.0
#: Frames further apart than this, s, do not belong to one continuous video.
_LONGEST_GAP_S = 1.0
_LARGEST = 0xFFFF
_SAMPLE = 2  # the stretch is computed from every second row and column, in a quarter of the time
_FEW = 1 << 14  # pictures of up to this many pixels are used whole
_TILES = (8, 8)
#: OpenCV's colour map of each palette; all but the rainbow's are never darker for hotter points.
_MAPS = {
    "iron": cv2.COLORMAP_INFERNO,
    "rainbow": cv2.COLORMAP_TURBO,
    "arctic": cv2.COLORMAP_CIVIDIS,
    "lava": cv2.COLORMAP_HOT,
}


class ToneMapper:
    """Convert raw thermal frames to BGR. Raises ConfigError for an unknown palette."""

    def __init__(self, config: PictureConfig, palette: str) -> None:
        self._stretch = Stretch(config.stretch_percent, config.stretch_time_s)
        self.configure(config, palette)

    def configure(self, config: PictureConfig, palette: str) -> None:
        """Set the parameters, at start or in flight; raises ConfigError as above."""
        if palette not in PALETTES:
            raise ConfigError(f"palette: {palette!r} is not one of {', '.join(PALETTES)}")
        self._map = _MAPS.get(palette)
        self._inverted = palette == "black_hot"
        self._stretch.configure(config.stretch_percent, config.stretch_time_s)
        self._local = None
        if config.local_contrast > 0:
            self._local = cv2.createCLAHE(config.local_contrast, _TILES)

    def tone(self, raw: RawPixels, stamp_ns: int) -> Pixels:
        """Return a new picture (h, w, 3) BGR uint8.

        The input is (h, w) uint8 or uint16, or (h, w, 3) BGR uint8. A colour picture is copied
        unchanged: palette and local contrast are for temperatures.
        """
        if raw.ndim == 3:
            return np.array(raw, np.uint8)
        grey = self._stretch.to_bytes(raw, stamp_ns) if raw.dtype == np.uint16 else raw
        if self._local is not None and grey.min() < grey.max():  # CLAHE turns uniform white black
            grey = np.asarray(self._local.apply(grey), np.uint8)
        if self._map is not None:
            return np.asarray(cv2.applyColorMap(grey, self._map), np.uint8)
        grey = np.invert(grey) if self._inverted else grey
        return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)


class Stretch:
    """Track the range of values over which a 16-bit video is shown, without flicker.

    The wanted ends are the ``percent`` percentiles of a frame's pixels. The range stays while both
    are within 5 % of its span of the shown ends. Otherwise it approaches them with a time constant
    of ``time_s`` / 3, and in a frame after dt its span changes by no more than the factor
    exp(3 dt / ``time_s``). So a constant pixel of grey level g becomes darker by no more than
    3 g dt / ``time_s`` when something hot comes into view. Still, a span that grows or shrinks
    tenfold is followed within ``time_s``. A frame whose median is outside the shown range is
    another scene; so is a frame after a gap or with a stamp that went back. Then the range is set
    anew.
    """

    def __init__(self, percent: tuple[float, ...], time_s: float) -> None:
        self._ends: tuple[float, float] | None = None
        self._stamp_ns = 0
        self._moves = False
        self.configure(percent, time_s)

    def configure(self, percent: tuple[float, ...], time_s: float) -> None:
        """Set the parameters, at start or in flight; the range continues from its present ends."""
        self._shares = np.array([min(percent), 50.0, max(percent)]) / 100
        self._time_s = time_s

    def to_bytes(self, raw: npt.NDArray[np.uint16], stamp_ns: int) -> Pixels:
        """Convert (h, w) values to 8 bits; a picture of one value becomes black."""
        low, middle, high = self._wanted(raw)
        self._ends = self._followed(low, middle, high, stamp_ns)
        self._stamp_ns = stamp_ns
        low, high = self._ends
        scale = 255.0 / (high - low)
        # The only OpenCV call that scales 16 bits to 8 and also clips below zero in one pass.
        return np.asarray(cv2.addWeighted(raw, scale, raw, 0.0, -low * scale, dtype=cv2.CV_8U))

    def _wanted(self, raw: npt.NDArray[np.uint16]) -> tuple[float, float, float]:
        """Return the percentiles; ignore dead and saturated pixels unless there are no others."""
        part = raw if raw.size <= _FEW else raw[::_SAMPLE, ::_SAMPLE]
        count = np.bincount(part.ravel(), minlength=_LARGEST + 1)
        if count[0] + count[_LARGEST] < part.size:
            count[0] = count[_LARGEST] = 0
        below = np.cumsum(count)
        low, middle, high = np.searchsorted(below, self._shares * below[-1]).tolist()
        return low, middle, max(high, low + _LEAST_SPAN)

    def _followed(
        self, low: float, middle: float, high: float, stamp_ns: int
    ) -> tuple[float, float]:
        elapsed_s = (stamp_ns - self._stamp_ns) * 1e-9
        if self._ends is None or not 0 <= elapsed_s <= max(_LONGEST_GAP_S, self._time_s):
            return low, high
        shown_low, shown_high = self._ends
        if not shown_low <= middle <= shown_high or not self._time_s:
            return low, high
        span = shown_high - shown_low
        off = max(abs(low - shown_low), abs(high - shown_high)) / span
        self._moves = off > (_ARRIVES if self._moves else _LEAVES)
        if not self._moves:
            return self._ends
        # Move by ``share`` of the way to the wanted ends; ``growth`` is log(new span / old span).
        growth, most = math.log((high - low) / span), _CONSTANTS * elapsed_s / self._time_s
        share = -math.expm1(-most)
        if abs(growth) >= _PLAIN_GROWTH:
            share = math.expm1(max(-most, min(most, share * growth))) / math.expm1(growth)
        return shown_low + share * (low - shown_low), shown_high + share * (high - shown_high)


class DrawingVerdict(NamedTuple):
    """Hold the checks' verdict and its words for the picture; none are drawn for a NOTE."""

    severity: Severity = Severity.NOTE
    words: str = ""


_GO = DrawingVerdict()


class Scene(NamedTuple):
    """Hold what many pictures share."""

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
    above_m: float  # the camera's height over the given ground; nan if it is unknown below
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
        """Return what the next picture shares with others."""
        return Scene(self._view.camera if self._view else None, self._rectifier, self.draped)

    @property
    def has_features(self) -> bool:
        """Return whether the map has any feature."""
        if self.draped:
            return self.draped.features > 0
        return any(layer.features for layer in self._layers)

    def footprint(self, pose: CameraPose | None) -> Array:
        """Return the picture's outline on the ground (N, 3), NED in the plane, m.

        It is cut where the map's lines end. It is empty without pose, camera, plane or ground.
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
        """Set the live parameters, at start or in flight."""
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
        """Paint with this scene from now on; keep the present camera or map if it has none."""
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
        notice, above_m, status = picture.notice, math.nan, picture.status
        if picture.pose is None:
            least_top = 0
            for placed in _notices(image, picture.verdict, "", None):
                placed.paint(image)
                least_top = placed.box.bottom
            paint_notice(image, notice, least_top)
        else:
            scene = picture.pose, picture.rates, picture.markers, picture.verdict
            notice, above_m, _ = self.draw(image, *scene, notice)
            if status is not None:  # the camera's heading, with the error of the gimbal's north
                sigma_rad = math.sqrt(picture.pose.covariance[5, 5])
                status = replace(status, heading_sigma_rad=sigma_rad)
        video = picture.age_s, picture.rate_hz, picture.predicted_s, picture.replaced
        paint_status(image, status_line(status, *video, above_m, picture.verdict.severity))
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

        ``rates`` are the camera's at the pose, or None. At the top are written the checks'
        ``verdict`` and the ``notice`` or, if it is empty, why no part of the map is in view.
        """
        assert self._view is not None
        assert self.draped is not None
        camera = self._view.camera
        level = self.ground if is_given(self.ground) else self.draped.level_m
        sight = Sight(camera, pose, self.draped.plane, level)
        if self._renderer is None:
            self._renderer = MapRenderer(self._confidence, self.draped)
        renderer = self._renderer
        scale_m_px = ground_sample_m(sight) if renderer.depends_on_scale else math.nan
        above_m = height_above_m(pose, sight.plane, level)
        far_m = farthest_m(camera, above_m)
        in_view = renderer.visible(self._view, pose, scale_m_px, far_m)
        notice = notice or renderer.why_absent(in_view, camera, pose, scale_m_px, far_m)
        bar = place_scale_bar(image, sight) if self._confidence.scale_bar else None
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


class Rectifier:
    """Rectify the pictures of a camera: remove the distortion of its lens.

    ``camera`` is the camera without distortion. The remap tables and the border are computed once.
    """

    def __init__(self, camera: Camera) -> None:
        """Compute the tables; raise CameraError if the picture has too many pixels for them."""
        if camera.width * camera.height > _MOST_RECTIFIED:
            size = f"{camera.width}x{camera.height}"
            raise CameraError(
                f"camera: {size} pixels are too many to rectify: set rectify to false"
            )
        self.camera = Camera(
            camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
        )
        shape = camera.height, camera.width
        v, u = np.indices(shape, dtype=float)
        x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        valid = x * x + y * y <= camera.max_radius**2
        column, row = np.full(shape, -1e3), np.full(shape, -1e3)
        column[valid], row[valid] = camera.pixels(x[valid], y[valid])
        places = column.astype(np.float32), row.astype(np.float32)
        self._maps = cv2.convertMaps(*places, cv2.CV_16SC2)
        inside = (column >= -0.5) & (column <= camera.width - 0.5)
        inside &= (row >= -0.5) & (row <= camera.height - 0.5)
        self._blank = np.where(inside, np.uint8(0), np.uint8(255))
        self._border = np.full((*shape, 3), _BORDER_BGR, np.uint8)

    def rectified(self, image: Pixels) -> Pixels:
        """Return the rectified picture, a new array (h, w, 3) BGR, of a picture (h, w, 3) BGR."""
        straight = cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(cv2.copyTo(self._border, self._blank, straight), np.uint8)
