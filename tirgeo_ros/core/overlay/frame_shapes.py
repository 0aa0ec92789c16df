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
"""Compute all that is drawn on one picture, as numbers and words: one geometry for all painters.

``PicturePainter`` draws it with OpenCV; the operator's page draws it in the browser.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.config import OverlayConfig
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
from tirgeo_ros.core.overlay.clicks import Marker, MarkerShapes, marker_shapes
from tirgeo_ros.core.overlay.map_shapes import DrapedMap, MapShaper, MapShapes, drape_layers
from tirgeo_ros.core.overlay.scale_bar_compass import ScaleBar, ground_sample_m, seen_bar
from tirgeo_ros.core.overlay.written_text import Field, status_line
from tirgeo_ros.core.types.arrays import Array, IntArray, RawPixels
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import NavigationStatus

_NONE_SHOWN: IntArray = np.empty(0, np.int64)


class DrawingVerdict(NamedTuple):
    """Hold the checks' verdict and its words for the picture; none are drawn for a NOTE."""

    severity: Severity = Severity.NOTE
    words: str = ""


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
class FrameShapes:
    """Hold all that is drawn on one picture; places are its pixels.

    Pixel (0, 0) is the middle of the first one.
    """

    notice: str  # why none of the map is drawn, else empty
    verdict: DrawingVerdict
    status: tuple[Field, ...]  # of the status line
    map: MapShapes | None = None  # None without a trusted pose
    markers: MarkerShapes | None = None  # None without any
    bar: ScaleBar | None = None
    heading_rad: float = math.nan  # the camera's; nan: no compass rose


class FrameShaper:
    """Compute what is drawn, picture after picture. Raises ConfigError for unknown map heights.

    The map lies at ``ground_height_m`` if that is given, else on the terrain if there is one,
    else at its own heights. ``ground`` is the first two of these, or nan. ``camera`` is that of
    the picture as shown; None until ``set_camera``.
    """

    def __init__(
        self, config: OverlayConfig, layers: Sequence[MapLayer], terrain: Terrain | None
    ) -> None:
        height_m = config.ground_height_m
        self.ground: Ground = height_m if terrain is None or math.isfinite(height_m) else terrain
        check_heights(layers, self.ground)
        self.draped: DrapedMap | None = None  # the map with its plane; None without a plane
        self._layers = layers
        self._view: View | None = None
        self.confidence = config.confidence
        self._of_map: MapShaper | None = None  # made when the map is first drawn

    @property
    def camera(self) -> Camera | None:
        """Return the camera of the picture as shown."""
        return self._view.camera if self._view else None

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

    def set_plane(self, plane: TangentPlane) -> None:
        """Drape the layers in a plane; a map that was draped elsewhere is dropped."""
        self.draped = drape_layers(self._layers, plane, self.ground)

    def set_map(self, draped: DrapedMap) -> None:
        """Draw a map that was draped elsewhere, in the present plane."""
        self._layers, self.draped = (), draped

    def set_camera(self, camera: Camera) -> None:
        """Set the camera of the picture as shown."""
        if camera != self.camera:
            self._view = View(camera)

    def shapes(self, picture: Unpainted, shown: IntArray = _NONE_SHOWN) -> FrameShapes:
        """Return what is drawn on a picture.

        ``shown`` are the map's features that had a label on the picture before.
        """
        words, above_m = FrameShapes(picture.notice, picture.verdict, ()), math.nan
        status, pose = picture.status, picture.pose
        if pose is not None:
            words, above_m = self._seen(picture, pose, shown)
            if status is not None:  # the camera's heading, with the error of the gimbal's north
                sigma_rad = math.sqrt(pose.covariance[5, 5])
                status = replace(status, heading_sigma_rad=sigma_rad)
        video = picture.age_s, picture.rate_hz, picture.predicted_s, picture.replaced
        line = status_line(status, *video, above_m, picture.verdict.severity)
        return replace(words, status=tuple(line))

    def _seen(
        self, picture: Unpainted, pose: CameraPose, shown: IntArray
    ) -> tuple[FrameShapes, float]:
        """Return what the camera sees from a pose, and its height above a given ground, m."""
        assert self._view is not None
        draped = self.draped
        assert draped is not None
        camera = self._view.camera
        level = self.ground if is_given(self.ground) else draped.level_m
        sight = Sight(camera, pose, draped.plane, level)
        above_m = height_above_m(pose, sight.plane, level)
        seen, absent = self._seen_map(self._view, sight, picture.rates, above_m, shown)
        markers = picture.markers
        shapes = FrameShapes(
            picture.notice or absent,
            picture.verdict,
            (),
            seen,
            marker_shapes(camera, pose, markers) if markers else None,
            seen_bar(picture.pixels, sight) if self.confidence.scale_bar else None,
            camera_heading_rad(pose) if self.confidence.heading_rose else math.nan,
        )
        return shapes, above_m if is_given(self.ground) else math.nan

    def _seen_map(
        self, view: View, sight: Sight, rates: CameraRates | None, above_m: float, shown: IntArray
    ) -> tuple[MapShapes, str]:
        """Return the map's shapes, and why no part of it is in view, if none is."""
        assert self.draped is not None
        if self._of_map is None or self._of_map.draped is not self.draped:
            self._of_map = MapShaper(self.confidence, self.draped)
        shaper, camera, pose = self._of_map, view.camera, sight.pose
        shaper.confidence = self.confidence
        scale_m_px = ground_sample_m(sight) if shaper.depends_on_scale else math.nan
        far_m = farthest_m(camera, above_m)
        in_view = shaper.visible(view, pose, scale_m_px, far_m)
        absent = shaper.why_absent(in_view, camera, pose, scale_m_px, far_m)
        return shaper.shapes(camera, pose, rates, in_view, shown), absent
