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
"""Project the visible part of a map: cull, clip in the camera frame, then apply the lens model.

Pieces of lines are drawn at the coarsest level of detail within half a pixel of the line. If few
vertices are in view, all are drawn; if very many, the tolerance grows to 1 or 2 px. Pieces lower
than the tolerance become spans of a pixel row.

If no part of a map is in view, a text says how far away it is, in which direction, and likely why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import (
    NEAR_M,
    Camera,
    field_of_view,
    largest_bend,
    largest_scale,
)
from tirgeo_ros.core.frames.rotations import azimuth, matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M, ecef_from_geodetic
from tirgeo_ros.core.ground.frame_geometry import camera_heading_rad
from tirgeo_ros.core.map.polylines import (
    Boxes,
    Details,
    Polylines,
    ends,
    joined,
    levels_at,
    merged,
    runs,
)
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.poses import CameraPose

_BITS = (1 << np.arange(8, dtype=np.uint8))[:, None]
# What is drawn.
#: Largest distance between a drawn chord and the curve into which the lens bends a line.
CHORD_PX = 0.1
#: Lines and marks farther ahead than this are never drawn.
FAR_M = 20_000.0
#: Lines and marks less than this many rows below the horizon are not drawn either. Seen from
#: 100 m up, the ground beyond 5 km fills 16 rows, about a degree: its lines merge into a solid
#: bar, and half a degree of tilt error moves the bar by kilometres.
HORIZON_ROWS = 16.0
#: With up to this many vertices in view, lines are drawn with all their vertices.
_FEW_VERTICES = 4096
#: Tolerances of the coarser levels of detail. The first that leaves at most _MANY_VERTICES is
#: used, else the last. If half a pixel leaves more, the lines cover the whole picture anyway.
_DETAILS_PX = (0.5, 1.0, 2.0)
_MANY_VERTICES = 40_000
# Why no map is in view.
#: A map farther away than this is not a map of the flight's area.
ELSEWHERE_M = 20_000.0
_CANDIDATES = 16  # pieces of lines to search: the nearest box may not have the nearest line
_HINT_M = 50_000.0  # a mistake is likely if correcting it brings the map this near
_ZONE_DEG = 6.0  # width of a UTM zone
_GRID = 5  # pixels along each side of the picture, to look for the horizon
_WORDS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"]


def clip_to_planes(lines: Polylines, normals: Array, offsets: Array) -> Polylines:
    """Return the part of lines where ``normals @ point >= offsets``; (m, k), (m,), m up to 8."""
    distance = normals @ lines.points - offsets[:, None]
    code = np.bitwise_or.reduce((distance < 0) * _BITS[: len(normals)], axis=0)
    if not code.any():
        return lines
    links = lines.links()
    keep = links & ((code[:-1] & code[1:]) == 0)
    crossing = np.flatnonzero(keep & ((code[:-1] | code[1:]) != 0))
    start, end = distance[:, crossing], distance[:, crossing + 1]
    change = np.where((start < 0) == (end < 0), 1.0, start - end)
    at = start / change
    enter = np.where(start < 0, at, 0.0).max(axis=0)
    leave = np.where(end < 0, at, 1.0).min(axis=0)
    return _cut_lines(lines, keep, crossing, enter, leave)


def clip_to_disc(lines: Polylines, radius: float) -> Polylines:
    """Return the part of lines within a radius of the origin, in their first two coordinates."""
    excess = lines.points[0] ** 2 + lines.points[1] ** 2 - radius**2
    outside = excess > 0
    if not outside.any():
        return lines
    keep = lines.links()
    crossing = np.flatnonzero(keep & (outside[:-1] | outside[1:]))
    start = lines.points[:2, crossing]
    step = lines.points[:2, crossing + 1] - start
    # |start + t step|^2 = radius^2
    a, b = (step**2).sum(axis=0), (start * step).sum(axis=0)
    root = b * b - a * excess[crossing]
    meets = (root > 0) & (a > 0)
    root, a = np.sqrt(np.where(meets, root, 0.0)), np.where(meets, a, 1.0)
    enter = np.where(meets, np.maximum((-b - root) / a, 0.0), 1.0)
    leave = np.where(meets, np.minimum((-b + root) / a, 1.0), 0.0)
    return _cut_lines(lines, keep, crossing, enter, leave)


def _cut_lines(
    lines: Polylines, keep: BoolArray, crossing: IntArray, enter: Array, leave: Array
) -> Polylines:
    enter_all, leave_all = np.zeros(len(keep)), np.where(keep, 1.0, 0.0)
    enter_all[crossing], leave_all[crossing] = enter, leave
    return lines.cut(enter_all, leave_all)


def closed(rings: Polylines) -> Polylines:
    """Return the rings with their first point repeated at the end."""
    last = rings.starts[1:] - 1
    index = np.insert(np.arange(rings.points.shape[1]), last + 1, rings.starts[:-1])
    starts = rings.starts + np.arange(len(rings) + 1)
    return Polylines(rings.points.take(index, axis=1), starts, rings.owner)


def _cut_rings(rings: Polylines, distance: Array) -> Polylines:
    """Return the part of the rings' insides where ``distance`` (V,), linear there, is >= 0.

    The last point of a ring is joined to its first; it is not repeated.
    """
    inside = distance >= 0
    if inside.all():
        return rings
    following = np.arange(1, rings.points.shape[1] + 1)
    following[rings.starts[1:] - 1] = rings.starts[:-1]
    crosses = inside != inside[following]
    count = inside.astype(np.int64) + crosses
    after = np.cumsum(count)
    points = np.empty((len(rings.points), int(after[-1])))
    points[:, (after - count)[inside]] = rings.points[:, inside]
    start = np.flatnonzero(crosses)
    end = following[start]
    share = distance[start] / (distance[start] - distance[end])
    points[:, after[start] - 1] = rings.points[:, start] + share * (
        rings.points[:, end] - rings.points[:, start]
    )
    starts = np.append(0, after)[rings.starts]
    left = np.diff(starts) > 0
    return Polylines(points, np.append(starts[:-1][left], starts[-1]), rings.owner[left])


@dataclass(frozen=True, slots=True)
class VisibleLines(Polylines):
    """Hold lines as they are drawn: ``points`` (2, V) in pixels, owned by features of the map.

    ``rays`` (3, V) has x and y on the plane z = 1 of the optical frame, and 1/z (1/m).
    """

    rays: Array

    def select(self, which: IntArray) -> VisibleLines:
        """Return the lines with these indices."""
        first = self.starts[which]
        index, starts = runs(first, self.starts[which + 1] - first)
        points, rays = (rows.take(index, axis=1) for rows in (self.points, self.rays))
        return VisibleLines(points, starts, self.owner[which], rays)


_NOTHING = VisibleLines(
    np.empty((2, 0)), np.zeros(1, np.int64), np.empty(0, np.int64), np.empty((3, 0))
)


def farthest_m(camera: Camera, height_m: float) -> float:
    """Return the distance (m) up to which lines are drawn, for a camera's height (m) above ground.

    It is ``FAR_M`` if the height is unknown (nan) or not positive.
    """
    rows_m = height_m * camera.fy / HORIZON_ROWS
    return min(rows_m, FAR_M) if rows_m > 0 else FAR_M


class View:
    """Project maps into the picture of one camera; its field of view is computed once."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        left, right, top, bottom = field_of_view(camera)
        self._normals_c = np.array(
            [[0, 0, 1], [1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom], [0, 0, -1]]
        )
        widest = math.hypot(max(-left, right), max(-top, bottom))
        self._reaches_past_lens = widest > camera.max_radius
        radius = min(widest, camera.max_radius)
        # A chord of length L leaves its curve by at most L^2 / 8 times the second derivative.
        self._pieces_per_length = math.sqrt(largest_bend(camera, radius) / (8 * CHORD_PX))
        self._px_per_rad = largest_scale(camera, radius)

    def lines(self, vector_map: VectorMap, pose: CameraPose, far_m: float = FAR_M) -> VisibleLines:
        """Return the map's lines as they are drawn, (2, V) pixels, up to ``far_m`` ahead.

        They reach a little beyond the image. Straight lines are subdivided to follow the lens.
        A line may be returned in several parts that meet; each has the line's owner.
        """
        details, rotation_cn = vector_map.details, matrix_from_quat(pose.q_nc).T
        offset_c = rotation_cn @ pose.position_n
        offsets_c = np.array([NEAR_M, 0.0, 0.0, 0.0, 0.0, -far_m])
        # The field of view is where normals @ point >= offsets.
        normals = self._normals_c @ rotation_cn
        piece, whole = details.in_view(normals, offsets_c + normals @ pose.position_n)
        boxes = details.boxes.take(piece)
        level, detail_px = self._levels(details, piece, boxes.distance(pose.position_n))
        row = self._in_a_row(boxes, whole, rotation_cn, offset_c, detail_px)

        def in_camera(which: BoolArray) -> Polylines:
            return _in_camera(details.lines(piece[which], level[which]), rotation_cn, offset_c)

        # Only pieces partly in view are clipped: most lie wholly in view, and clipping takes as
        # long as all other steps together.
        cut = clip_to_planes(in_camera(~whole), self._normals_c, offsets_c)
        flat = _flat(joined(in_camera(whole & ~row), cut))
        if self._reaches_past_lens:
            flat = clip_to_disc(flat, self.camera.max_radius)
        if row.any():
            # Pieces that each lie in one row become merged spans. Only spans of one layer are
            # merged, and only if the features of both have a label or both have none.
            in_row = _flat(in_camera(row))
            spans = ends(in_row, in_row.points[0])
            uv = self.camera.pixels(*spans.points[:2])
            sheet = 2 * vector_map.layer[spans.owner] + vector_map.labelled[spans.owner]
            flat = joined(flat, merged(spans, uv, sheet))
        return self._in_pixels(flat)

    def _in_pixels(self, flat: Polylines) -> VisibleLines:
        flat = self._bent(flat)
        uv = self.camera.pixels(*flat.points[:2])
        return VisibleLines(uv, flat.starts, flat.owner, flat.points)

    def _in_a_row(
        self, boxes: Boxes, whole: BoolArray, rotation_cn: Array, offset_c: Array, row_px: float
    ) -> BoolArray:
        """Return (N,) whether each box is wholly in view and lower than ``row_px`` in the picture.

        A step (x, y, z) in the optical frame moves the row by (y - v z) / depth, where v is the
        row on the plane z = 1. All are False if ``row_px`` is 0, or if the field of view reaches
        beyond the lens model.
        """
        if self._reaches_past_lens or not row_px:
            return np.zeros(len(whole), bool)
        _, down, ahead = rotation_cn
        _, y, depth = rotation_cn @ boxes.centres - offset_c[:, None]
        depth = np.where(whole, depth, 1.0)
        turned = np.abs(down[:, None] - (y / depth) * ahead[:, None])
        half = np.einsum("ij,ij->j", turned, boxes.halves)
        return np.asarray(whole & (half * (2 * self._px_per_rad) < row_px * depth))

    def areas(self, vector_map: VectorMap, pose: CameraPose) -> VisibleLines:
        """Return the filled areas of layers with a fill, as closed rings (2, V) in pixels.

        The caller fills all rings of one owner together by the even-odd rule. The rings reach a
        little beyond the image, and beyond the distance up to which lines are drawn. There are
        none if the field of view reaches beyond the lens model.
        """
        rings, rotation_cn = vector_map.rings, matrix_from_quat(pose.q_nc).T
        if not len(rings) or self._reaches_past_lens:
            return _NOTHING
        normals = self._normals_c @ rotation_cn
        offsets_c = np.array([NEAR_M, 0.0, 0.0, 0.0, 0.0, -FAR_M])
        ring, whole = vector_map.ring_boxes.in_view(normals, offsets_c + normals @ pose.position_n)
        if not len(ring):
            return _NOTHING
        # Rings wholly in view are not clipped, and already end where they begin.
        inner, outer = (
            _in_camera(rings.select(part), rotation_cn, rotation_cn @ pose.position_n)
            for part in (ring[whole], ring[~whole])
        )
        for normal, offset in zip(self._normals_c[:-1], offsets_c[:-1], strict=True):
            outer = _cut_rings(outer, normal @ outer.points - offset)
        return self._in_pixels(joined(_flat(inner), closed(_flat(outer))))

    def _levels(
        self, details: Details, piece: IntArray, distance_m: Array
    ) -> tuple[IntArray, float]:
        """Return the level of detail (N,) of each piece, and their tolerance in px."""
        level, detail_px = np.zeros(len(piece), np.int64), 0.0
        if details.vertices(piece, level).sum() <= _FEW_VERTICES:
            return level, detail_px
        for detail_px in _DETAILS_PX:
            level = levels_at(distance_m * (detail_px / self._px_per_rad))
            if details.vertices(piece, level).sum() <= _MANY_VERTICES:
                break
        return level, detail_px

    def marks(self, vector_map: VectorMap, pose: CameraPose, far_m: float = FAR_M) -> VisibleLines:
        """Return the map's points in the image, up to ``far_m`` ahead: lines of one point, px."""
        marks = vector_map.marks
        if not len(marks):
            return _NOTHING
        points_c = (marks.points.T - pose.position_n) @ matrix_from_quat(pose.q_nc)
        uv, valid = self.camera.project(points_c)
        valid[valid] = self.inside(uv[valid].T) & (points_c[valid, 2] <= far_m)
        owner = marks.owner[valid]
        x, y, z = points_c[valid].T
        rays = np.stack([x / z, y / z, 1 / z])
        return VisibleLines(uv[valid].T, np.arange(len(owner) + 1), owner, rays)

    def inside(self, uv: Array) -> BoolArray:
        """Return (N,) whether pixels (2, N) lie in the image."""
        u, v = uv
        inside = (u >= -0.5) & (u < self.camera.width - 0.5)
        return np.asarray(inside & (v >= -0.5) & (v < self.camera.height - 0.5))

    def _bent(self, flat: Polylines) -> Polylines:
        """Return lines on the plane z = 1 subdivided so that drawn chords follow the lens."""
        dx, dy = flat.points[:2, 1:] - flat.points[:2, :-1]
        squared = dx * dx + dy * dy
        squared[flat.starts[1:-1] - 1] = 0.0  # not a segment: the gap between two lines
        squared *= self._pieces_per_length**2
        long = np.flatnonzero(squared > 1)
        if not len(long):
            return flat
        pieces = np.ones(len(squared), np.int64)
        pieces[long] = np.ceil(np.sqrt(squared[long]))
        return flat.subdivided(pieces)


def _in_camera(lines: Polylines, rotation_cn: Array, offset_c: Array) -> Polylines:
    """Return lines in the optical frame; ``offset_c`` (3,) is the camera's position there."""
    points_c = rotation_cn @ lines.points
    points_c -= offset_c[:, None]
    return Polylines(points_c, lines.starts, lines.owner)


def _flat(lines: Polylines) -> Polylines:
    """Project lines to the plane z = 1: x, y and 1/z, which are linear along a line there."""
    points = np.empty_like(lines.points)
    inverse_depth = np.divide(1.0, lines.points[2], out=points[2])
    np.multiply(lines.points[:2], inverse_depth, out=points[:2])
    return Polylines(points, lines.starts, lines.owner)


class Nearest(NamedTuple):
    """Hold the nearest point of a map's features."""

    distance_m: float  # horizontal, over the ground
    azimuth_rad: float  # 0 is north, clockwise
    point_n: Array  # (3,) in the map's plane, m


def nearest_feature(
    vector_map: VectorMap, position_n: Array, first_n: Array | None = None
) -> Nearest | None:
    """Return the map's point nearest to a position (3,), NED, m.

    If no part of the map is on the ground, ``first_n`` (3,) is used; None if that is None too.
    """
    details, points = vector_map.details, [vector_map.marks.points]
    for piece in np.argsort(details.boxes.distance(position_n))[:_CANDIDATES].tolist():
        first = details.first[0, piece]
        vertices = details.points[:, first : first + details.count[0, piece]]
        # The horizontally nearest point on each segment.
        start, along = vertices[:, :-1], np.diff(vertices, axis=1)
        way = (along[:2] * (position_n[:2, None] - start[:2])).sum(axis=0)
        share = np.clip(way / ((along[:2] ** 2).sum(axis=0) + 1e-9), 0.0, 1.0)
        points.append(start + share * along)
    candidates = np.concatenate(points, axis=1)
    if not candidates.size:
        if first_n is None:
            return None
        candidates = first_n[:, None]
    away = candidates - position_n[:, None]
    away_n = away[:, np.argmin((away[:2] ** 2).sum(axis=0))]
    level_m, chord_m = math.hypot(away_n[0], away_n[1]), float(np.linalg.norm(away_n))
    if level_m >= ELSEWHERE_M or chord_m >= 2 * ELSEWHERE_M:  # over a spherical Earth
        half = min(chord_m / (2 * SEMI_MAJOR_AXIS_M), 1.0)
        level_m = 2 * SEMI_MAJOR_AXIS_M * math.asin(half)
    return Nearest(level_m, azimuth(away_n), position_n + away_n)


def compass_word(azimuth_rad: float) -> str:
    """Return the name of the nearest of eight directions, such as ``north-east``."""
    return _WORDS[round(azimuth_rad / (math.pi / 4)) % 8]


def distance_words(distance_m: float) -> str:
    """Return a distance to two digits as text: ``300 m``, ``1.2 km``."""
    rounded = float(f"{distance_m:.2g}")
    return f"{rounded:g} m" if rounded < 1000 else f"{rounded / 1000:g} km"


def way_words(distance_m: float, azimuth_rad: float) -> str:
    """Return a distance and a direction as text: ``300 m away to the north-east``."""
    return f"{distance_words(distance_m)} away to the {compass_word(azimuth_rad)}"


def likely_mistake(plane: TangentPlane, place_n: Array) -> str:
    """Return a question that names why a map's point (3,) may be far from the plane's origin.

    It is the first of the usual mistakes whose correction brings the point within 50 km, or local
    metres if the point is within 50 km of latitude and longitude 0. Without either it is empty.
    """
    latitude, longitude, _ = (float(each) for each in plane.geodetic_from_ned(place_n))
    origin = plane.latitude_rad, plane.longitude_rad
    zones = round(math.degrees(origin[1] - longitude) / _ZONE_DEG)
    zone = int(math.floor(math.degrees(longitude) / _ZONE_DEG) + 30) % 60 + 1
    wrong_sign = "is the sign of {} wrong?".format
    corrections = (
        ((longitude, latitude), "are latitude and longitude swapped?"),
        ((latitude, -longitude), wrong_sign("longitude")),
        ((-latitude, longitude), wrong_sign("latitude")),
        ((-latitude, -longitude), wrong_sign("latitude and longitude")),
        (
            (latitude, longitude + math.radians(zones * _ZONE_DEG)),
            f"is it UTM zone {(zone + zones - 1) % 60 + 1} instead of {zone}?" if zones else "",
        ),
    )
    for corrected, question in corrections:
        if question and _apart_m(origin, corrected) < _HINT_M:
            return question
    local = _apart_m((0.0, 0.0), (latitude, longitude)) < _HINT_M
    return "are its coordinates metres of a local system?" if local else ""


def _apart_m(first: tuple[float, float], second: tuple[float, float]) -> float:
    """Return the chord (m) between two points (rad); infinite for an impossible latitude."""
    if abs(second[0]) > math.pi / 2:
        return math.inf
    apart = ecef_from_geodetic(*first, 0.0) - ecef_from_geodetic(*second, 0.0)
    return float(np.linalg.norm(apart))


def why_absent(
    vector_map: VectorMap,
    plane: TangentPlane,
    first_n: Array | None,
    camera: Camera,
    pose: CameraPose,
    far_m: float,
) -> str:
    """Return why no part of a map is in view at a pose in its plane.

    The map is drawn up to ``far_m``. ``first_n`` is as in ``nearest_feature``.
    """
    nearest = nearest_feature(vector_map, pose.position_n, first_n)
    if nearest is None:
        return "the map has no coordinates"
    lead = f"map {way_words(nearest.distance_m, nearest.azimuth_rad)}"
    if nearest.distance_m > ELSEWHERE_M:
        question = likely_mistake(plane, nearest.point_n)
        return f"{lead}; {question}" if question else lead
    if not (len(vector_map.lines) or len(vector_map.marks)):
        return "none of the map lies on the elevation model"
    across, down = (np.linspace(0, size - 1, _GRID) for size in (camera.width, camera.height))
    uv = np.stack(np.meshgrid(across, down), -1).reshape(-1, 2)
    north, east, below = matrix_from_quat(pose.q_nc) @ camera.rays(uv).T
    # Rays beyond the lens limit are nan and compare false.
    if not (below > np.hypot(north, east) * (HORIZON_ROWS / camera.fy)).any():
        return "the camera looks above the horizon"
    if nearest.distance_m > far_m:
        return f"{lead}; it is drawn up to {distance_words(far_m)}"
    return f"{lead}; the camera looks {compass_word(camera_heading_rad(pose))}"
