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
"""Paint one picture with OpenCV: tones, the map, and the words on it.

Of all that depends on earlier pictures, only tones and labels are computed here; ``Overlay``
decides the rest before. So painting, which takes nearly all of the time, can also run in another
process. The painter owns what it draws with: the camera, the rectifier, the draped map.

A stretch of 16 bits computed anew for each frame flickers: a warm roof that comes into view
darkens everything else at once. Here it stays constant while it fits, and otherwise moves slowly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.config.overlay_parameters import PALETTES, PictureConfig
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.map.vector_map import MapLayer, VectorMap
from tirgeo_ros.core.overlay.clicks import PlacedMarkers
from tirgeo_ros.core.overlay.frame_shapes import (
    DrawingVerdict,
    FrameShaper,
    FrameShapes,
    Unpainted,
)
from tirgeo_ros.core.overlay.map_renderer import MapRenderer
from tirgeo_ros.core.overlay.map_shapes import DrapedMap, MapShapes
from tirgeo_ros.core.overlay.scale_bar_compass import place_rose, place_scale_bar
from tirgeo_ros.core.overlay.written_text import (
    VERDICT_BGR,
    Box,
    PlacedText,
    paint_notice,
    paint_status,
    place_notice,
    status_box,
)
from tirgeo_ros.core.types.arrays import Pixels, RawPixels
from tirgeo_ros.core.types.errors import CameraError, ConfigError
from tirgeo_ros.core.types.poses import CameraPose

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
        self._newest: tuple[int, RawPixels, Pixels] | None = None  # stamp, 16 bits, grey
        self.configure(config, palette)

    def configure(self, config: PictureConfig, palette: str) -> None:
        """Set the parameters, at start or in flight; raises ConfigError as above."""
        if palette not in PALETTES:
            raise ConfigError(f"palette: {palette!r} is not one of {', '.join(PALETTES)}")
        self._config, self._map = config, _MAPS.get(palette)
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
        grey = self.grey(raw, stamp_ns)
        if self._local is not None and grey.min() < grey.max():  # CLAHE turns uniform white black
            grey = np.asarray(self._local.apply(grey), np.uint8)
        if self._map is not None:
            return np.asarray(cv2.applyColorMap(grey, self._map), np.uint8)
        grey = np.invert(grey) if self._inverted else grey
        return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)

    def grey(self, raw: RawPixels, stamp_ns: int) -> Pixels:
        """Return the picture (h, w) of 8 bits, hot white, of one of 8 or 16 bits."""
        if raw.dtype != np.uint16:
            return raw
        newest = self._newest
        if newest is None or newest[0] != stamp_ns or newest[1] is not raw:
            newest = self._newest = stamp_ns, raw, self._stretch.to_bytes(raw, stamp_ns)
        return newest[2]  # kept, because the stretch moves with each call

    def celsius(self, raw: RawPixels) -> tuple[float, float] | None:
        """Return the temperatures of black and of white in the newest ``grey``; None if unknown.

        ``raw`` is its picture.
        """
        config, ends = self._config, self._stretch.ends
        if raw.dtype != np.uint16 or not config.celsius_per_count or ends is None:
            return None
        low, high = (value * config.celsius_per_count + config.celsius_offset for value in ends)
        return low, high


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

    @property
    def ends(self) -> tuple[float, float] | None:
        """Return the values shown as black and as white; None before the first frame."""
        return self._ends

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


class Scene(NamedTuple):
    """Hold what many pictures share."""

    camera: Camera | None = None  # of the picture as shown
    rectifier: Rectifier | None = None  # None if the picture is shown as it is
    draped: DrapedMap | None = None


@dataclass(frozen=True, slots=True)
class OverlayResult:
    """Hold one finished picture."""

    stamp_ns: int  # of the frame
    image: Pixels  # (h, w, 3) BGR
    pose: CameraPose | None  # at the exposure; None if none can be trusted
    notice: str  # why no map was drawn, or why none is in view; else empty
    camera: Camera | None = None  # of the picture as shown; None if unknown or of another size
    predicted_s: float = 0.0  # how far the pose was extrapolated


class CleanPicture(NamedTuple):
    """Hold a picture with nothing drawn on it."""

    pixels: Pixels  # (h, w) grey, hot white, or (h, w, 3) BGR
    celsius: tuple[float, float] | None  # of grey 0 and 255; None if unknown


class PicturePainter:
    """Paint pictures in order of time; ``shaper`` computes what is drawn on them.

    Raises ConfigError if map heights are unknown.
    """

    def __init__(
        self, config: OverlayConfig, layers: Sequence[MapLayer], terrain: Terrain | None
    ) -> None:
        self.shaper = FrameShaper(config, layers, terrain)
        self._rectifier: Rectifier | None = None
        self._toner = ToneMapper(config.picture, config.palette)
        self._renderer = MapRenderer()
        self._drawn_map: VectorMap | None = None

    @property
    def scene(self) -> Scene:
        """Return what the next picture shares with others."""
        return Scene(self.shaper.camera, self._rectifier, self.shaper.draped)

    def configure(self, config: OverlayConfig) -> None:
        """Set the live parameters, at start or in flight."""
        self._toner.configure(config.picture, config.palette)
        self.shaper.confidence = config.confidence

    def set_lens(self, camera: Camera, *, rectify: bool) -> None:
        """Set the camera's calibration. Raises CameraError if its images cannot be rectified."""
        rectifier = Rectifier(camera) if rectify else None
        self.set_scene(Scene(rectifier.camera if rectifier else camera, rectifier))

    def set_scene(self, scene: Scene) -> None:
        """Paint with this scene from now on; keep the present camera or map if it has none."""
        self._rectifier = scene.rectifier
        if scene.camera is not None:
            self.shaper.set_camera(scene.camera)
        if scene.draped is not None:
            self.shaper.set_map(scene.draped)

    def shapes(self, picture: Unpainted) -> FrameShapes:
        """Return what is drawn on a picture."""
        if self.shaper.draped is not None:
            self._renew_for(self.shaper.draped.map)
        return self.shaper.shapes(picture, self._renderer.labels.shown)

    def clean(self, picture: Unpainted) -> CleanPicture:
        """Return the picture with nothing drawn on it."""
        raw = picture.pixels
        pixels = raw if raw.ndim == 3 else self._toner.grey(raw, picture.stamp_ns)
        if self._rectifier is not None and picture.camera is not None:
            pixels = self._rectifier.rectified(pixels)
        return CleanPicture(pixels, self._toner.celsius(raw))

    def paint(self, picture: Unpainted, shapes: FrameShapes | None = None) -> OverlayResult:
        """Return the finished picture; ``shapes`` are its own, if they are known already."""
        shapes = shapes or self.shapes(picture)
        image = self._toner.tone(picture.pixels, picture.stamp_ns)
        if self._rectifier is not None and picture.camera is not None:
            image = self._rectifier.rectified(image)
        self.draw(image, shapes)
        return OverlayResult(
            *(picture.stamp_ns, image, picture.pose, shapes.notice),
            *(picture.camera, picture.predicted_s),
        )

    def draw(self, image: Pixels, shapes: FrameShapes) -> list[Box]:
        """Draw shapes on their picture (h, w, 3) BGR; return the boxes of all that is written.

        Without a trusted pose only words are drawn.
        """
        if shapes.map is None:
            boxes = self._draw_notices(image, shapes)
        else:
            boxes = self._draw_seen(image, shapes, shapes.map)
        paint_status(image, shapes.status)
        return boxes

    def _renew_for(self, vector_map: VectorMap) -> None:
        """Forget the labels that were drawn, whose numbers are of their own map, for another."""
        if vector_map is not self._drawn_map:
            self._renderer, self._drawn_map = MapRenderer(), vector_map

    def _draw_notices(self, image: Pixels, shapes: FrameShapes) -> list[Box]:
        placed = _notices(image, shapes.verdict, "", None)
        for each in placed:
            each.paint(image)
        paint_notice(image, shapes.notice, max((each.box.bottom for each in placed), default=0))
        return [each.box for each in placed]

    def _draw_seen(self, image: Pixels, shapes: FrameShapes, seen: MapShapes) -> list[Box]:
        self._renew_for(seen.map)
        bar = place_scale_bar(image, shapes.bar) if shapes.bar else None
        has_rose = not math.isnan(shapes.heading_rad)
        rose = place_rose(image, shapes.heading_rad) if has_rose else None
        notices = _notices(image, shapes.verdict, shapes.notice, rose.box if rose else None)
        written = [each for each in (bar, rose, *notices) if each]
        taken = [status_box(image), *(each.box for each in written)]
        placed = PlacedMarkers(image, shapes.markers, taken) if shapes.markers else None
        if placed:
            taken += placed.boxes
        labels = self._renderer.paint(image, seen, taken)
        if placed:
            placed.paint(image, self._renderer.lines)
        for each in written:
            each.paint(image)
        return [*taken, *labels]


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
        """Return the rectified picture, a new array, of one (h, w) grey or (h, w, 3) BGR."""
        straight = cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        border = self._border if image.ndim == 3 else np.zeros_like(image)
        return np.asarray(cv2.copyTo(border, self._blank, straight), np.uint8)
