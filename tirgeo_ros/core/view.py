"""What a camera sees of a map: culled, clipped in the camera frame, then bent by the lens.

Pieces of lines come at the coarsest level of detail that stays within half a pixel of the line,
unless so little is in view that all of it can be drawn. Of pieces smaller than a pixel one is
drawn in each pixel, and pieces lower than half a row become spans of that row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.areas import closed, cut_rings_to_disc, cut_rings_to_planes
from tirgeo_ros.core.attitude import matrix_from_quat
from tirgeo_ros.core.camera import NEAR_M, Camera
from tirgeo_ros.core.clipping import clip_to_disc, clip_to_planes
from tirgeo_ros.core.detail import Boxes, levels_at
from tirgeo_ros.core.polylines import BoolArray, IntArray, Polylines, joined, runs
from tirgeo_ros.core.samples import Array, CameraPose
from tirgeo_ros.core.thinning import ends, merged
from tirgeo_ros.core.vector_map import VectorMap

#: Lines reach this far beyond the image, so that their cut ends are not seen.
_BORDER_PX = 8.0
#: How far a drawn chord may leave the curve into which the lens bends a straight line.
CHORD_PX = 0.1
_EDGE_SAMPLES = 33
#: Ground farther than this is not drawn. From 100 m up, 20 km and the horizon are 4 rows of the
#: XT2's picture apart, less than the attitude is known to; a far map would be a solid bar there.
FAR_M = 20_000.0
#: With fewer vertices in view than this, lines are drawn with all of theirs.
_FEW_VERTICES = 4096
#: How far a line at a coarser level of detail may leave its place: the first at which no more
#: than so many vertices are left. Where half a pixel leaves more, they cover the whole picture.
_DETAILS_PX = (0.5, 1.0, 2.0)
_MANY_VERTICES = 40_000


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


class View:
    """A camera's field of view, computed once for a calibration."""

    def __init__(self, camera: Camera, far_m: float = FAR_M) -> None:
        self.camera = camera
        left, right, top, bottom = _field_of_view(camera)
        self._normals_c = np.array(
            [[0, 0, 1], [1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom], [0, 0, -1]]
        )
        self._offsets = np.array([NEAR_M, 0.0, 0.0, 0.0, 0.0, -far_m])
        widest = math.hypot(max(-left, right), max(-top, bottom))
        self._reaches_past_lens = widest > camera.max_radius
        radius = min(widest, camera.max_radius)
        # A chord of length L leaves its curve by at most L^2 / 8 times the second derivative.
        self._pieces_per_length = math.sqrt(_largest_bend(camera, radius) / (8 * CHORD_PX))
        self._px_per_rad = _largest_scale(camera, radius)

    def lines(self, vector_map: VectorMap, pose: CameraPose) -> Seen:
        """The map's lines as they are drawn: (2, V) pixels, owned as in the map.

        They reach a little beyond the image. Straight lines are subdivided to follow the lens.
        A line may come in several parts that meet.
        """
        details = vector_map.details
        normals, offsets = self._planes_n(pose)
        piece = details.within(normals, offsets)
        level, detail_px = self._levels(vector_map, piece, pose)
        if detail_px:
            keep = self._dots(vector_map, piece, pose, 2 * detail_px)
            piece, level = piece[keep], level[keep]
        whole, row = self._lie(details.boxes.take(piece), pose, detail_px)
        inner, outer, spans = ((piece[some], level[some]) for some in (whole & ~row, ~whole, row))
        # Most pieces lie wholly in view, and cutting costs as much as all the rest.
        cut = clip_to_planes(
            _in_camera(details.lines(*outer), pose), self._normals_c, self._offsets
        )
        flat = _flat(joined(_in_camera(details.lines(*inner), pose), cut))
        if self._reaches_past_lens:
            flat = clip_to_disc(flat, self.camera.max_radius)
        if row.any():
            flat = joined(flat, self._spans(vector_map, *spans, pose))
        return self._seen(flat)

    def _lie(self, boxes: Boxes, pose: CameraPose, row_px: float) -> tuple[BoolArray, BoolArray]:
        """Which boxes are wholly in view, and which of them are lower than a part of a row.

        A step of x, y, z in the optical frame moves the row by (y - v z) / depth, where v is the
        row on the plane z = 1.
        """
        normals, offsets = self._planes_n(pose)
        whole = boxes.inside(normals, offsets)
        if self._reaches_past_lens:
            return whole, np.zeros(len(whole), bool)
        _, down, ahead = matrix_from_quat(pose.q_nc).T
        from_camera = boxes.centres - pose.position_n[:, None]
        depth = np.where(whole, ahead @ from_camera, 1.0)
        v = (down @ from_camera) / depth
        half = sum(np.abs(down[i] - v * ahead[i]) * boxes.halves[i] for i in range(3)) / depth
        return whole, whole & (2 * half * self._px_per_rad < row_px)

    def _spans(
        self, vector_map: VectorMap, piece: IntArray, level: IntArray, pose: CameraPose
    ) -> Polylines:
        """Pieces that lie in one row each, as spans of rows on the plane z = 1."""
        lines = _in_camera(vector_map.details.lines(piece, level), pose)
        spans = _flat(ends(lines, lines.points[0] / lines.points[2]))
        uv = np.stack(self.camera.pixels(*spans.points[:2]))
        return merged(spans, uv, _sheet(vector_map, spans.owner))

    def areas(self, vector_map: VectorMap, pose: CameraPose) -> Seen:
        """Insides of the outlines of layers with a fill: closed rings (2, V) pixels.

        To be filled by the even-odd rule, all rings of one owner together. They reach a little
        beyond the image, and are filled beyond the distance at which lines end.
        """
        rings, details = vector_map.rings, vector_map.details
        normals, offsets = self._planes_n(pose)
        seen = rings.boxes.within(normals, offsets)
        if not len(seen):
            return Seen(np.empty((2, 0)), np.zeros(1, np.int64), seen, np.empty((3, 0)))
        number, starts = runs(rings.starts[seen], np.diff(rings.starts)[seen])
        piece = rings.pieces[number]
        level, _ = self._levels(vector_map, piece, pose)
        # A piece in a box that no part of is seen may take any way through it.
        out = np.ones(len(piece), bool)
        out[details.boxes.take(piece).within(normals, offsets)] = False
        level[out] = len(details.count) - 1
        lines = details.lines(piece, level)
        lines = _in_camera(Polylines(lines.points, lines.starts[starts], rings.owner[seen]), pose)
        flat = _flat(cut_rings_to_planes(lines, self._normals_c[:-1], self._offsets[:-1]))
        if self._reaches_past_lens:
            flat = cut_rings_to_disc(flat, self.camera.max_radius)
        return self._seen(closed(flat))

    def _planes_n(self, pose: CameraPose) -> tuple[Array, Array]:
        """The field of view in the map's plane: ``normals @ point >= offsets``."""
        normals = self._normals_c @ matrix_from_quat(pose.q_nc).T
        return normals, self._offsets + normals @ pose.position_n

    def _levels(
        self, vector_map: VectorMap, piece: IntArray, pose: CameraPose
    ) -> tuple[IntArray, float]:
        """(N,) the level of detail of each piece, and how far it may be off, px."""
        details = vector_map.details
        level, detail_px = np.zeros(len(piece), np.int64), 0.0
        if details.count[0, piece].sum() <= _FEW_VERTICES:
            return level, detail_px
        distance_m = details.boxes.take(piece).distance(pose.position_n)
        for detail_px in _DETAILS_PX:
            level = levels_at(distance_m * (detail_px / self._px_per_rad))
            if details.count[level, piece].sum() <= _MANY_VERTICES:
                break
        return level, detail_px

    def _dots(
        self, vector_map: VectorMap, piece: IntArray, pose: CameraPose, dot_px: float
    ) -> BoolArray:
        """Which pieces to keep so that of those smaller than a dot there is one in each."""
        boxes = vector_map.details.boxes.take(piece)
        size = 2 * np.sqrt(np.einsum("ij,ij->j", boxes.halves, boxes.halves))
        distance = boxes.distance(pose.position_n)
        small = np.flatnonzero(size * self._px_per_rad < dot_px * distance)
        rotation_nc = matrix_from_quat(pose.q_nc)
        uv, valid = self.camera.project((boxes.centres.T[small] - pose.position_n) @ rotation_nc)
        valid[valid] = self.inside(uv[valid].T)
        small = small[valid]
        column, row = np.rint(uv[valid].T / dot_px).astype(np.int64)
        sheet = _sheet(vector_map, vector_map.details.owner[piece[small]])
        cell = (sheet * (self.camera.height + 2) + row) * (self.camera.width + 2) + column
        _, first = np.unique(cell, return_index=True)
        keep = np.ones(len(piece), bool)
        keep[small] = False
        keep[small[first]] = True
        return keep

    def _seen(self, flat: Polylines) -> Seen:
        flat = flat.subdivided(self._pieces(flat))
        uv = np.stack(self.camera.pixels(*flat.points[:2]))
        return Seen(uv, flat.starts, flat.owner, flat.points)

    def marks(self, vector_map: VectorMap, pose: CameraPose) -> Seen:
        """The map's points that lie in the image: lines of one point (2, V), pixels."""
        marks = vector_map.marks
        offset_n = marks.points.T - pose.position_n
        points_c = offset_n @ matrix_from_quat(pose.q_nc)
        uv, valid = self.camera.project(points_c)
        valid[valid] = self.inside(uv[valid].T)
        owner = marks.owner[valid]
        x, y, z = points_c[valid].T
        rays = np.stack([x / z, y / z, 1 / z])
        return Seen(uv[valid].T, np.arange(len(owner) + 1), owner, rays)

    def inside(self, uv: Array) -> BoolArray:
        """Whether pixels (2, N) lie in the image; (N,)."""
        u, v = uv
        inside = (u >= -0.5) & (u < self.camera.width - 0.5)
        return np.asarray(inside & (v >= -0.5) & (v < self.camera.height - 0.5))

    def _pieces(self, flat: Polylines) -> IntArray:
        step = np.diff(flat.points[:2], axis=1) * self._pieces_per_length
        squared = step[0] * step[0] + step[1] * step[1]
        long = np.flatnonzero((squared > 1) & flat.links())
        pieces = np.ones(len(squared), np.int64)
        pieces[long] = np.ceil(np.sqrt(squared[long]))
        return pieces


def _sheet(vector_map: VectorMap, owner: IntArray) -> IntArray:
    """Lines of one number may stand for each other: of one layer, with a label or without."""
    return 2 * vector_map.layer[owner] + vector_map.labelled[owner]


def _in_camera(lines: Polylines, pose: CameraPose) -> Polylines:
    """Lines of the map's plane in the optical frame."""
    points_c = matrix_from_quat(pose.q_nc).T @ (lines.points - pose.position_n[:, None])
    return Polylines(points_c, lines.starts, lines.owner)


def _flat(lines: Polylines) -> Polylines:
    """On the plane z = 1: x, y and one over the depth, which change evenly along a line there."""
    inverse_depth = 1 / lines.points[2]
    points = np.stack([*(lines.points[:2] * inverse_depth), inverse_depth])
    return Polylines(points, lines.starts, lines.owner)


def _field_of_view(camera: Camera) -> tuple[float, float, float, float]:
    """Left, right, top, bottom of a rectangle on the plane z = 1 that holds the whole image.

    A side of the image that the lens model does not reach is bounded by the model's radius.
    """
    u = np.linspace(-0.5 - _BORDER_PX, camera.width - 0.5 + _BORDER_PX, _EDGE_SAMPLES)
    v = np.linspace(-0.5 - _BORDER_PX, camera.height - 0.5 + _BORDER_PX, _EDGE_SAMPLES)
    border = [
        *([(x, y) for x in u for y in (v[0], v[-1])]),
        *([(x, y) for y in v for x in (u[0], u[-1])]),
    ]
    rays = camera.rays(np.array(border))
    x, y = rays[:, 0], rays[:, 1]
    radius = camera.max_radius
    if np.isnan(x).any():
        return -radius, radius, -radius, radius
    return float(x.min()), float(x.max()), float(y.min()), float(y.max())


def _largest_bend(camera: Camera, radius: float) -> float:
    """Bound of the second derivative of pixels along any straight line of the plane z = 1.

    The norm of all second derivatives, by differences, on rings up to ``radius``.
    """
    ring, turn = np.meshgrid(np.linspace(0, radius, 33), np.linspace(0, 2 * np.pi, 33))
    x, y = (ring * np.cos(turn)).ravel(), (ring * np.sin(turn)).ravel()
    h = 1e-3

    def at(i: int, j: int) -> Array:
        return np.stack(camera.pixels(x + i * h, y + j * h))

    xx = at(1, 0) - 2 * at(0, 0) + at(-1, 0)
    yy = at(0, 1) - 2 * at(0, 0) + at(0, -1)
    xy = (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / 4
    return float(np.sqrt((xx**2 + 2 * xy**2 + yy**2).sum(axis=0).max()) / (h * h))


def _largest_scale(camera: Camera, radius: float) -> float:
    """Bound of the pixels that a small angle between two rays makes, up to ``radius``; px/rad."""
    ring, turn = np.meshgrid(np.linspace(0, radius, 33), np.linspace(0, 2 * np.pi, 33))
    x, y = (ring * np.cos(turn)).ravel(), (ring * np.sin(turn)).ravel()
    h = 1e-4
    by_x = np.stack(camera.pixels(x + h, y)) - np.stack(camera.pixels(x - h, y))
    by_y = np.stack(camera.pixels(x, y + h)) - np.stack(camera.pixels(x, y - h))
    gradient = np.moveaxis(np.stack([by_x, by_y], 1), -1, 0) / (2 * h)
    # On the plane z = 1 an angle makes at most 1 + r^2 as much.
    scale = np.linalg.norm(gradient, ord=2, axis=(1, 2)) * (1 + x * x + y * y)
    return float(scale.max())
