"""What a camera sees of a map: culled, clipped in the camera frame, then bent by the lens."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.attitude import matrix_from_quat
from tirgeo_ros.core.camera import NEAR_M, Camera
from tirgeo_ros.core.clipping import clip_to_disc, clip_to_planes
from tirgeo_ros.core.polylines import BoolArray, IntArray, Polylines
from tirgeo_ros.core.samples import Array, CameraPose
from tirgeo_ros.core.vector_map import VectorMap

#: Lines reach this far beyond the image, so that their cut ends are not seen.
_BORDER_PX = 8.0
#: How far a drawn chord may leave the curve into which the lens bends a straight line.
CHORD_PX = 0.1
_EDGE_SAMPLES = 33


@dataclass(frozen=True, slots=True)
class Seen(Polylines):
    """Lines as they are drawn: ``points`` (2, V) in pixels, owned by features of the map.

    ``rays`` (3, V) has x and y on the plane z = 1 of the optical frame, and one over the depth z.
    """

    rays: Array

    def points_c(self) -> Array:
        """(3, V) the places on the map, in the optical frame, m."""
        x, y, inverse_depth = self.rays
        return np.stack([x, y, np.ones_like(x)]) / inverse_depth

    def points_n(self, pose: CameraPose) -> Array:
        """(3, V) the places on the map, as seen from the pose, m."""
        turned = matrix_from_quat(pose.q_nc) @ self.points_c()
        return np.asarray(turned + pose.position_n[:, None])


class View:
    """A camera's field of view, computed once for a calibration."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        left, right, top, bottom = _field_of_view(camera)
        self._normals_c = np.array(
            [[0, 0, 1], [1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]]
        )
        self._offsets = np.array([NEAR_M, 0.0, 0.0, 0.0, 0.0])
        widest = math.hypot(max(-left, right), max(-top, bottom))
        self._reaches_past_lens = widest > camera.max_radius
        bend = _largest_bend(camera, min(widest, camera.max_radius))
        # A chord of length L leaves its curve by at most L^2 / 8 times the second derivative.
        self._pieces_per_length = math.sqrt(bend / (8 * CHORD_PX))

    def lines(self, vector_map: VectorMap, pose: CameraPose) -> Seen:
        """The map's lines as they are drawn: (2, V) pixels, owned as in the map.

        They reach a little beyond the image. Straight lines are subdivided to follow the lens.
        """
        rotation_nc = matrix_from_quat(pose.q_nc)
        seen = vector_map.lines.select(self._in_view(vector_map, pose.position_n, rotation_nc))
        points_c = rotation_nc.T @ (seen.points - pose.position_n[:, None])
        lines = Polylines(points_c, seen.starts, seen.owner)
        lines = clip_to_planes(lines, self._normals_c, self._offsets)
        # One over the depth changes evenly along a line of the plane z = 1, as x and y do.
        inverse_depth = 1 / lines.points[2]
        rays = np.stack([*(lines.points[:2] * inverse_depth), inverse_depth])
        flat = Polylines(rays, lines.starts, lines.owner)
        if self._reaches_past_lens:
            flat = clip_to_disc(flat, self.camera.max_radius)
        flat = flat.subdivided(self._pieces(flat))
        return self._seen(flat)

    def _seen(self, flat: Polylines) -> Seen:
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

    def _in_view(self, vector_map: VectorMap, position_n: Array, rotation_nc: Array) -> IntArray:
        """Numbers of the lines whose bounding box is not wholly outside one of the planes."""
        normals_n = self._normals_c @ rotation_nc.T
        nearest = normals_n @ (vector_map.centres - position_n[:, None])
        nearest += np.abs(normals_n) @ vector_map.halves
        return np.flatnonzero((nearest >= self._offsets[:, None]).all(axis=0))

    def _pieces(self, flat: Polylines) -> IntArray:
        step = np.diff(flat.points[:2], axis=1) * self._pieces_per_length
        squared = step[0] * step[0] + step[1] * step[1]
        long = np.flatnonzero((squared > 1) & flat.links())
        pieces = np.ones(len(squared), np.int64)
        pieces[long] = np.ceil(np.sqrt(squared[long]))
        return pieces


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
