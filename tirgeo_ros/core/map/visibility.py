"""What a camera sees of a map: culled, clipped in the camera frame, then bent by the lens.

Pieces of lines come at the coarsest level of detail that stays within half a pixel of the line,
unless so little is in view that all of it can be drawn. Of pieces smaller than a pixel one is
drawn in each pixel, and pieces lower than half a row become spans of that row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from tirgeo_ros.core.camera.lens_limits import field_of_view, largest_bend, largest_scale
from tirgeo_ros.core.camera.model import NEAR_M, Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.map.area_clipping import closed, cut_rings_to_disc, cut_rings_to_planes, disc
from tirgeo_ros.core.map.level_of_detail import Boxes, Details, levels_at
from tirgeo_ros.core.map.line_clipping import clip_to_disc, clip_to_planes
from tirgeo_ros.core.map.line_thinning import ends, merged
from tirgeo_ros.core.map.polylines import Polylines, joined, runs
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray, Pixels
from tirgeo_ros.core.types.poses import CameraPose

#: How far a drawn chord may leave the curve into which the lens bends a straight line.
CHORD_PX = 0.1
#: Ground farther than this is never drawn.
FAR_M = 20_000.0
#: Nor is ground so few rows under the horizon. The 16 rows from 5 km on, seen from 100 m up, are
#: a degree: what lies there is a solid bar, and half a degree of tilt moves it by kilometres.
HORIZON_ROWS = 16.0
#: With fewer vertices in view than this, lines are drawn with all of theirs.
_FEW_VERTICES = 4096
#: How far a line at a coarser level of detail may leave its place: the first at which no more
#: than so many vertices are left. Where half a pixel leaves more, they cover the whole picture.
_DETAILS_PX = (0.5, 1.0, 2.0)
_MANY_VERTICES = 40_000
#: Ink of an edge is one pixel wide, and may be rounded to either side: two pixels of the rim.
_RIM = np.ones((5, 5), np.uint8)


@dataclass(frozen=True, slots=True)
class Seen(Polylines):
    """Lines as they are drawn: ``points`` (2, V) in pixels, owned by features of the map.

    ``rays`` (3, V) has x and y on the plane z = 1 of the optical frame, and one over the depth z.
    """

    rays: Array

    def points_c(self) -> Array:
        """(3, V) the places on the map, in the optical frame, m."""
        x, y, inverse_depth = self.rays
        return np.asarray(np.stack([x, y, np.ones_like(x)]) / inverse_depth)

    def points_n(self, pose: CameraPose) -> Array:
        """(3, V) the places on the map, as seen from the pose, m."""
        turned = matrix_from_quat(pose.q_nc) @ self.points_c()
        return np.asarray(turned + pose.position_n[:, None])


_NOTHING = Seen(np.empty((2, 0)), np.zeros(1, np.int64), np.empty(0, np.int64), np.empty((3, 0)))


class View:
    """A camera's field of view, computed once for a calibration."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        left, right, top, bottom = field_of_view(camera)
        self._normals_c = np.array(
            [[0, 0, 1], [1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom], [0, 0, -1]]
        )
        self._offsets = np.array([NEAR_M, 0.0, 0.0, 0.0, 0.0])  # and the farthest
        widest = math.hypot(max(-left, right), max(-top, bottom))
        self._reaches_past_lens = widest > camera.max_radius
        radius = min(widest, camera.max_radius)
        # A chord of length L leaves its curve by at most L^2 / 8 times the second derivative.
        self._pieces_per_length = math.sqrt(largest_bend(camera, radius) / (8 * CHORD_PX))
        self._px_per_rad = largest_scale(camera, radius)
        self._reached = self._lens_mask() if self._reaches_past_lens else None

    @property
    def reached(self) -> Pixels | None:
        """(h, w) 255 where areas may be filled; None for the whole image.

        Where the lens model ends within the image, rings are cut to its rim and may run to and
        fro along it. The rim is left out, for OpenCV inks the edges of what it fills.
        """
        return self._reached

    def _lens_mask(self) -> Pixels:
        rim = self._bent(closed(disc(self.camera.max_radius)))
        uv = self.camera.pixels(*rim.points).T
        mask = np.zeros((self.camera.height, self.camera.width), np.uint8)
        cv2.fillPoly(mask, [np.rint(uv * 16).astype(np.int32)], (255,), cv2.LINE_8, 4)
        # The image's border is no rim: OpenCV takes what is beside it for full.
        return np.asarray(cv2.erode(mask, _RIM), np.uint8)

    def farthest_m(self, height_m: float) -> float:
        """How far ground is drawn from so high above it; nan where that is not known."""
        rows_m = height_m * self.camera.fy / HORIZON_ROWS
        return min(rows_m, FAR_M) if rows_m > 0 else FAR_M

    def lines(self, vector_map: VectorMap, pose: CameraPose, far_m: float = FAR_M) -> Seen:
        """The map's lines up to ``far_m`` ahead as they are drawn: (2, V) pixels.

        They reach a little beyond the image. Straight lines are subdivided to follow the lens.
        A line may come in several parts that meet; all are owned as in the map.
        """
        details, eye = vector_map.details, self._eye(pose, far_m)
        piece, whole = details.seen(eye.normals, eye.offsets)
        boxes = details.boxes.take(piece)
        distance_m = boxes.distance(eye.position_n)
        level, detail_px = self._levels(details, piece, distance_m)
        row = self._in_a_row(boxes, whole, eye, detail_px)
        cut_off = ~whole
        if detail_px:
            keep = self._dots(vector_map, piece, boxes, distance_m, eye, 2 * detail_px)
            whole, row, cut_off = whole & keep, row & keep, cut_off & keep
        inner, outer = np.flatnonzero(whole & ~row), np.flatnonzero(cut_off)
        some = np.concatenate([inner, outer])
        lines, cut = eye.sees(details.lines(piece[some], level[some])).parted(len(inner))
        # Most pieces lie wholly in view, and cutting costs as much as all the rest.
        cut = clip_to_planes(cut, self._normals_c, np.append(self._offsets, -far_m))
        flat = _flat(joined(lines, cut))
        if self._reaches_past_lens:
            flat = clip_to_disc(flat, self.camera.max_radius)
        if row.any():
            flat = joined(flat, self._spans(vector_map, piece[row], level[row], eye))
        return self._seen(flat)

    def _in_a_row(self, boxes: Boxes, whole: BoolArray, eye: _Eye, row_px: float) -> BoolArray:
        """Which boxes, of those wholly in view, are lower than a part of a row.

        A step of x, y, z in the optical frame moves the row by (y - v z) / depth, where v is the
        row on the plane z = 1.
        """
        if self._reaches_past_lens or not row_px:
            return np.zeros(len(whole), bool)
        _, down, ahead = eye.rotation_cn
        _, y, depth = eye.rotation_cn @ boxes.centres - eye.offset_c[:, None]
        depth = np.where(whole, depth, 1.0)
        turned = np.abs(down[:, None] - (y / depth) * ahead[:, None])
        half = np.einsum("ij,ij->j", turned, boxes.halves)
        return np.asarray(whole & (half * (2 * self._px_per_rad) < row_px * depth))

    def _spans(
        self, vector_map: VectorMap, piece: IntArray, level: IntArray, eye: _Eye
    ) -> Polylines:
        """Pieces that lie in one row each, as spans of rows on the plane z = 1."""
        lines = _flat(eye.sees(vector_map.details.lines(piece, level)))
        spans = ends(lines, lines.points[0])
        uv = self.camera.pixels(*spans.points[:2])
        return merged(spans, uv, _sheet(vector_map, spans.owner))

    def areas(self, vector_map: VectorMap, pose: CameraPose) -> Seen:
        """Insides of the outlines of layers with a fill: closed rings (2, V) pixels.

        To be filled by the even-odd rule, all rings of one owner together. They reach a little
        beyond the image, and are filled beyond the distance at which lines end.
        """
        rings, details = vector_map.rings, vector_map.details
        if not len(rings):
            return _NOTHING
        eye = self._eye(pose, FAR_M)
        seen, whole = rings.boxes.seen(eye.normals, eye.offsets)
        if not len(seen):
            return _NOTHING
        whole &= not self._reaches_past_lens
        seen = np.concatenate([seen[whole], seen[~whole]])
        number, starts = runs(rings.starts[seen], np.diff(rings.starts)[seen])
        piece = rings.pieces[number]
        boxes = details.boxes.take(piece)
        level, _ = self._levels(details, piece, boxes.distance(eye.position_n))
        # A piece in a box that no part of is seen may take any way through it.
        out = np.ones(len(piece), bool)
        out[boxes.within(eye.normals, eye.offsets)] = False
        level[out] = len(details.count) - 1
        lines = details.lines(piece, level)
        lines = eye.sees(Polylines(lines.points, lines.starts[starts], rings.owner[seen]))
        # What lies wholly in view ends where it begins, as in the map.
        inner, outer = lines.parted(int(whole.sum()))
        flat = _flat(cut_rings_to_planes(outer, self._normals_c[:-1], self._offsets))
        if self._reaches_past_lens:
            flat = cut_rings_to_disc(flat, self.camera.max_radius)
        return self._seen(joined(_flat(inner), closed(flat)))

    def _eye(self, pose: CameraPose, far_m: float) -> _Eye:
        rotation_cn = matrix_from_quat(pose.q_nc).T
        normals = self._normals_c @ rotation_cn
        offsets = np.append(self._offsets, -far_m) + normals @ pose.position_n
        return _Eye(rotation_cn, pose.position_n, rotation_cn @ pose.position_n, normals, offsets)

    def _levels(
        self, details: Details, piece: IntArray, distance_m: Array
    ) -> tuple[IntArray, float]:
        """(N,) the level of detail of each piece, and how far it may be off, px."""
        level, detail_px = np.zeros(len(piece), np.int64), 0.0
        if details.vertices(piece, level).sum() <= _FEW_VERTICES:
            return level, detail_px
        for detail_px in _DETAILS_PX:
            level = levels_at(distance_m * (detail_px / self._px_per_rad))
            if details.vertices(piece, level).sum() <= _MANY_VERTICES:
                break
        return level, detail_px

    def _dots(
        self,
        vector_map: VectorMap,
        piece: IntArray,
        boxes: Boxes,
        distance_m: Array,
        eye: _Eye,
        dot_px: float,
    ) -> BoolArray:
        """Which pieces to keep so that of those smaller than a dot there is one in each."""
        keep = np.ones(len(piece), bool)
        size = 2 * np.sqrt(np.einsum("ij,ij->j", boxes.halves, boxes.halves))
        small = np.flatnonzero(size * self._px_per_rad < dot_px * distance_m)
        if not len(small):
            return keep
        centres_c = eye.rotation_cn @ boxes.centres[:, small] - eye.offset_c[:, None]
        uv, valid = self.camera.project(centres_c.T)
        valid[valid] = self.inside(uv[valid].T)
        small = small[valid]
        column, row = np.rint(uv[valid].T / dot_px).astype(np.int64)
        sheet = _sheet(vector_map, vector_map.details.owner[piece[small]])
        cell = (sheet * (self.camera.height + 2) + row) * (self.camera.width + 2) + column
        _, first = np.unique(cell, return_index=True)
        keep[small] = False
        keep[small[first]] = True
        return keep

    def _seen(self, flat: Polylines) -> Seen:
        flat = self._bent(flat)
        uv = self.camera.pixels(*flat.points[:2])
        return Seen(uv, flat.starts, flat.owner, flat.points)

    def marks(self, vector_map: VectorMap, pose: CameraPose, far_m: float = FAR_M) -> Seen:
        """The map's points in the image, up to ``far_m`` ahead: lines of one point (2, V) px."""
        marks = vector_map.marks
        if not len(marks):
            return _NOTHING
        offset_n = marks.points.T - pose.position_n
        points_c = offset_n @ matrix_from_quat(pose.q_nc)
        uv, valid = self.camera.project(points_c)
        valid[valid] = self.inside(uv[valid].T) & (points_c[valid, 2] <= far_m)
        owner = marks.owner[valid]
        x, y, z = points_c[valid].T
        rays = np.stack([x / z, y / z, 1 / z])
        return Seen(uv[valid].T, np.arange(len(owner) + 1), owner, rays)

    def inside(self, uv: Array) -> BoolArray:
        """Whether pixels (2, N) lie in the image; (N,)."""
        u, v = uv
        inside = (u >= -0.5) & (u < self.camera.width - 0.5)
        return np.asarray(inside & (v >= -0.5) & (v < self.camera.height - 0.5))

    def _bent(self, flat: Polylines) -> Polylines:
        """With as many points as it takes to follow the lens."""
        x, y = flat.points[:2]
        dx, dy = x[1:] - x[:-1], y[1:] - y[:-1]
        squared = dx * dx
        squared += dy * dy
        squared[flat.starts[1:-1] - 1] = 0.0  # no segment, but a way from line to line
        squared *= self._pieces_per_length**2
        long = np.flatnonzero(squared > 1)
        if not len(long):
            return flat
        pieces = np.ones(len(squared), np.int64)
        pieces[long] = np.ceil(np.sqrt(squared[long]))
        return flat.subdivided(pieces)


@dataclass(frozen=True, slots=True)
class _Eye:
    """The camera at one pose in the map's plane."""

    rotation_cn: Array
    position_n: Array
    offset_c: Array  # the position, turned
    normals: Array  # the field of view is where normals @ point >= offsets
    offsets: Array

    def sees(self, lines: Polylines) -> Polylines:
        """Lines of the map's plane in the optical frame."""
        points_c = self.rotation_cn @ lines.points
        points_c -= self.offset_c[:, None]
        return Polylines(points_c, lines.starts, lines.owner)


def _sheet(vector_map: VectorMap, owner: IntArray) -> IntArray:
    """Lines of one number may stand for each other: of one layer, with a label or without."""
    return 2 * vector_map.layer[owner] + vector_map.labelled[owner]


def _flat(lines: Polylines) -> Polylines:
    """On the plane z = 1: x, y and one over the depth, which change evenly along a line there."""
    points = np.empty_like(lines.points)
    inverse_depth = np.divide(1.0, lines.points[2], out=points[2])
    np.multiply(lines.points[:2], inverse_depth, out=points[:2])
    return Polylines(points, lines.starts, lines.owner)
