"""Find a picture's outline on the ground."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, locate
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.poses import CameraPose

#: Pixels along each edge: enough for the bend of a lens and the shape of the ground.
_PER_EDGE = 8
#: Where an edge leaves the ground in view is found to a 256th of the step between two of them.
_HALVINGS = 8


def footprint(
    camera: Camera, pose: CameraPose, plane: TangentPlane, ground: Ground, far_m: float
) -> Array:
    """Return the outline (N, 3) of a picture on the ground, NED in the map's plane, m.

    It is cut where the ground is farther ahead than ``far_m``, or is not known: the cut's two ends
    are joined by a straight line. Empty, (0, 3), if no edge of the picture sees ground.
    """

    def seen(uv: Array) -> tuple[Array, BoolArray]:
        points_n, _ = locate(camera, pose, uv, plane, ground)
        ahead_m = (points_n - pose.position_n) @ matrix_from_quat(pose.q_nc)[:, 2]
        return points_n, ahead_m <= far_m  # nan compares false

    uv = _rim(camera)
    points_n, inside = seen(uv)
    after, inside_after = np.roll(uv, -1, axis=0), np.roll(inside, -1)
    cut = np.flatnonzero(inside != inside_after)
    if not len(cut):
        return points_n[inside]
    leaves = inside[cut, None]
    near, far = np.where(leaves, uv[cut], after[cut]), np.where(leaves, after[cut], uv[cut])
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        met = seen(middle)[1][:, None]
        near, far = np.where(met, middle, near), np.where(met, far, middle)
    with_ends = np.insert(points_n, cut + 1, seen(near)[0], axis=0)
    return np.asarray(with_ends[np.insert(inside, cut + 1, values=True)])


def _rim(camera: Camera) -> Array:
    """Return pixels (N, 2) along the picture's border, from the upper left corner, clockwise."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    edges = np.roll(corners, -1, axis=0) - corners
    share = np.arange(_PER_EDGE)[:, None] / _PER_EDGE
    return np.concatenate([c + share * e for c, e in zip(corners, edges, strict=True)])
