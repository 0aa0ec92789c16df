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
"""Locate clicks with the camera and pose of the picture that the person saw, and mark points.

``camera`` is the camera of the picture as shown: the rectified camera if the picture is rectified.
``pose`` is None if the picture was shown without a trusted pose.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter, deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates, ellipse_95, pixel_jacobian
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig, PictureConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.ground.backprojection import Ground, Reason, is_given
from tirgeo_ros.core.ground.ground_point import Answer, Located, Refusal, place
from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.map.vector_map import Colour, LayerStyle
from tirgeo_ros.core.overlay.label_placement import FreeSpace, mark_radius_px, request_beside
from tirgeo_ros.core.overlay.map_renderer import LineRenderer, marks_as_lines
from tirgeo_ros.core.overlay.uncertainty_rendering import ELLIPSE_BGR, MARK_TIMES, ellipse_dashes
from tirgeo_ros.core.overlay.written_text import Box, TextBitmap, stamp, text_px
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels
from tirgeo_ros.core.types.poses import CameraPose

#: Time for which pictures are kept: a person goes back 120 s, looks, thinks and clicks.
REMEMBERED_S = 180.0
#: Time for which a marker is shown after its picture, and the largest number of markers.
MARKER_S, MARKERS = 300.0, 20

_MISSED = {Miss.EMPTY: Reason.NO_PICTURE, Miss.TOO_OLD: Reason.TOO_OLD}
_MARKER_BGR: Colour = (255, 80, 255)
_STYLE = LayerStyle(line_bgr=_MARKER_BGR, width_px=2)
_LARGEST_PX = 2000.0  # semi-axis of an ellipse larger than any picture


#: Newest pictures whose temperatures are kept: of 640x512 pixels with 16 bits, 42 MB.
_THERMAL = 64
#: Scale of the pictures of temperatures: to 1037 deg C, finer than a camera's noise (0.05 deg).
TEMPERATURE_SCALE = PictureConfig(celsius_per_count=0.02, celsius_offset=-273.15)


class Thermal(NamedTuple):
    """Hold a picture's temperatures, which may have fewer pixels than the picture shown."""

    values: RawPixels  # (h, w) uint16
    scale: PictureConfig

    def celsius(self, uv: tuple[float, float], camera: Camera) -> float:
        """Return the temperature (deg C) at a pixel (column, row) of the camera's picture.

        It is nan outside, and at or below absolute zero.
        """
        height, width = self.values.shape
        column = math.floor((uv[0] + 0.5) * width / camera.width)
        row = math.floor((uv[1] + 0.5) * height / camera.height)
        if not (0 <= column < width and 0 <= row < height):
            return math.nan
        count = int(self.values[row, column])
        degrees = count * self.scale.celsius_per_count + self.scale.celsius_offset
        return degrees if degrees > -273.15 else math.nan


def thermal_of(pixels: RawPixels, scale: PictureConfig) -> Thermal | None:
    """Return the temperatures of a picture of 16 bits; None for another, and without a scale."""
    is_thermal = pixels.dtype == np.uint16 and scale.celsius_per_count
    return Thermal(pixels, scale) if is_thermal else None


class Marker(NamedTuple):
    """Hold a located point to draw."""

    point_n: Array  # (3,) NED in the map's plane, m
    label: str
    covariance_n: Array  # (3, 3) m2
    id: str = ""  # of the target, if it is one


class ShownFrame(NamedTuple):
    """Hold the camera, pose and rates of a picture that was shown."""

    camera: Camera
    pose: CameraPose | None
    rates: CameraRates | None


class Clicks:
    """Hold the cameras and poses of the newest pictures, and the points to mark in every picture.

    These points are the clicked ones, or the targets once ``set_targets`` was called.
    ``counts`` holds the number of clicks by result: ``located`` or ``refused_`` and the reason.
    """

    def __init__(self, config: ConfidenceConfig) -> None:
        self.counts: Counter[str] = Counter()
        self.confidence = config
        self._plane: TangentPlane | None = None
        #: An ellipsoidal height (m) or an elevation model; None, nan: unknown.
        self.ground: Ground | None = None
        self._thermal: deque[tuple[int, Thermal]] = deque(maxlen=_THERMAL)
        self._shown: StampedBuffer[ShownFrame] = StampedBuffer(REMEMBERED_S)
        self._located: deque[Located] = deque(maxlen=MARKERS)
        self._targets: Sequence[Target] | None = None
        self._target_markers: list[Marker] = []

    def set_plane(self, plane: TangentPlane) -> None:
        """Set the map's plane; forget pictures in another plane, keep markers where they are."""
        if plane == self._plane:
            return
        self._shown.clear()
        self._plane = plane
        for number, point in enumerate(self._located):
            place = point.latitude_rad, point.longitude_rad, point.height_m
            point_n = plane.ned_from_geodetic(*place)
            self._located[number] = dataclasses.replace(point, point_n=point_n)
        self._place_targets()

    def set_targets(self, targets: Sequence[Target]) -> None:
        """Mark these targets from now on, instead of the clicked points."""
        self._targets = targets
        self._place_targets()

    def _place_targets(self) -> None:
        self._target_markers, plane = [], self._plane
        if plane is None:
            return
        for target in self._targets or ():
            mean = target.place
            point_n = plane.ned_from_geodetic(mean.latitude_rad, mean.longitude_rad, mean.height_m)
            marker = Marker(point_n, target.label, mean.covariance_n, target.id)
            self._target_markers.append(marker)

    def show(
        self,
        stamp_ns: int,
        camera: Camera,
        pose: CameraPose | None,
        rates: CameraRates | None = None,
    ) -> None:
        """Remember a published picture; ``stamp_ns`` is the stamp of its header."""
        self._shown.put(stamp_ns, ShownFrame(camera, pose, rates))

    def show_thermal(self, stamp_ns: int, thermal: Thermal) -> None:
        """Remember the temperatures of a picture; only of the newest pictures."""
        self._thermal.append((stamp_ns, thermal))

    def locate(self, uv: tuple[float, float], stamp_ns: int = 0) -> Answer:
        """Return the ground point at a pixel (column, row) of a picture; stamp 0: the newest."""
        answer = self._answer(uv, stamp_ns)
        if isinstance(answer, Refusal):
            self.counts[f"refused_{answer.reason.name.lower()}"] += 1
        else:
            self.counts["located"] += 1
            self._located.append(answer)
        return answer

    def markers(self) -> list[Marker]:
        """Return the targets, or the clicked points that are still shown, oldest first."""
        if self._targets is not None:
            return self._target_markers
        newest_ns = self._shown.newest_ns
        return [
            Marker(point.point_n, point.label, point.covariance_n)
            for point in self._located
            if newest_ns is None or abs(newest_ns - point.stamp_ns) <= MARKER_S * 1e9
        ]

    def _answer(self, uv: tuple[float, float], stamp_ns: int) -> Answer:
        stamp_ns = stamp_ns or self._shown.newest_ns or 0
        around = self._shown.around(stamp_ns)
        if isinstance(around, Miss):
            return Refusal(stamp_ns, uv, _MISSED.get(around, Reason.UNKNOWN_PICTURE))
        shown, _, fraction = around
        if fraction > 0:  # between two pictures
            return Refusal(stamp_ns, uv, Reason.UNKNOWN_PICTURE)
        if shown.pose is None or self._plane is None:
            return Refusal(stamp_ns, uv, Reason.NO_POSE)
        if self.ground is None or not is_given(self.ground):
            return Refusal(stamp_ns, uv, Reason.NO_GROUND)
        answer = place(
            shown.camera, shown.pose, uv, self._plane, self.ground, self.confidence, shown.rates
        )
        if isinstance(answer, Refusal):
            return dataclasses.replace(answer, stamp_ns=stamp_ns)
        degrees = (t.celsius(uv, shown.camera) for stamp, t in self._thermal if stamp == stamp_ns)
        return dataclasses.replace(
            answer, stamp_ns=stamp_ns, temperature_c=next(degrees, math.nan)
        )


class MarkerShapes(NamedTuple):
    """Hold the markers that are seen in a picture, and their 95 % ellipses, in its pixels."""

    markers: Sequence[Marker]  # N, oldest first
    uv: Array  # (N, 2)
    semi_px: Array  # (N, 2) semi-axes; nan if unknown
    angle: Array  # (N,) of the larger semi-axis, from u towards v


def marker_shapes(camera: Camera, pose: CameraPose, markers: Sequence[Marker]) -> MarkerShapes:
    """Return where a camera sees the markers, with the ellipses of the located ground points."""
    points_n = np.array([marker.point_n for marker in markers]).reshape(-1, 3)
    points_c = (points_n - pose.position_n) @ matrix_from_quat(pose.q_nc)
    uv, visible = camera.project(points_c)
    with np.errstate(invalid="ignore"):
        inside = (uv >= -0.5) & (uv < [camera.width - 0.5, camera.height - 0.5])
    visible &= inside.all(axis=1)
    shown = [markers[i] for i in np.flatnonzero(visible).tolist()]
    _, by_point = pixel_jacobian(camera, pose, points_n[visible])
    covariance_n = np.array([marker.covariance_n for marker in shown]).reshape(-1, 3, 3)
    ellipses = ellipse_95(by_point @ covariance_n @ by_point.transpose(0, 2, 1))
    return MarkerShapes(shown, uv[visible], *ellipses)


class PlacedMarkers:
    """Hold the markers in a picture (h, w, 3); ``boxes`` are the boxes of their labels.

    An ellipse is drawn if it is clearly larger than the mark. Labels do not overlap the boxes in
    ``taken`` or each other. The newest marker's label is placed first; a label without room is
    left out.
    """

    def __init__(self, image: Pixels, shapes: MarkerShapes, taken: Sequence[Box] = ()) -> None:
        self._shapes, uv = shapes, shapes.uv
        room, mark_px = FreeSpace(image, uv.T, taken), 1.5 * mark_radius_px(image)
        self._labels: list[tuple[TextBitmap, Box]] = []
        for marker, (u, v) in zip(shapes.markers[::-1], uv[::-1].tolist(), strict=True):
            text = stamp(marker.label, text_px(image), _MARKER_BGR)
            free = room.find(request_beside(u, v, text.size, mark_px))
            if free is not None:
                self._labels.append((text, free[1]))
        self.boxes = [box for _, box in self._labels]

    def paint(self, image: Pixels, painter: LineRenderer) -> None:
        """Draw marks, ellipses and labels on the picture, in place."""
        _, uv, semi_px, angle = self._shapes
        if not len(uv):
            return
        count = len(uv)
        marks = Polylines(uv.T, np.arange(count + 1), np.zeros(count, np.int64))
        diamonds = marks_as_lines(marks, mark_radius_px(image))
        # Only the ellipses that are clearly larger than the mark.
        drawn = np.flatnonzero(semi_px[:, 0] >= MARK_TIMES * mark_radius_px(image))  # not nan
        semi_px = np.minimum(semi_px[drawn], _LARGEST_PX)
        dotted = np.zeros(len(drawn), bool)
        dashes = ellipse_dashes(uv[drawn].T, semi_px, angle[drawn], drawn, dotted)
        painter.thin_strokes(image, dashes, ELLIPSE_BGR)
        painter.strokes(image, diamonds, np.zeros(count, np.int64), [_STYLE])
        for text, box in self._labels:
            text.draw(image, box.left, box.top)
