"""How a point of the map moves before the camera by small errors of pose and map: the algebra.

A point at d from the camera moves in c by -position + d x phi. Over its depth that is a sum of
constant matrices times x, y, 1 and 1/z, where x and y are on the plane z = 1. Covariances of such
moves are therefore sums of products of these four, with weights that are the same for all points
of a frame.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from tirgeo_ros.core.frames.rotations import skew
from tirgeo_ros.core.types.arrays import Array, IntArray

#: By position and phi, (3, 6), times x, y, 1 and 1/z.
MOVES = np.zeros((4, 3, 6))
MOVES[:3, :, 3:] = [skew(axis) for axis in np.eye(3)]
MOVES[3, :, :3] = -np.eye(3)
_FIRST, _SECOND = np.triu_indices(4)  # of the products of x, y, 1 and 1/z
_ROWS, _COLUMNS = np.triu_indices(3)
_TIMES = np.where(_FIRST == _SECOND, 0.5, 1.0)


def _parts(first: IntArray, second: IntArray) -> Array:
    """(10, 6, 6, 6): what the pose's covariance has to do with products and the upper triangle."""
    rows, columns = MOVES[first][:, _ROWS], MOVES[second][:, _COLUMNS]
    return np.asarray(rows[..., :, None] * columns[..., None, :])


# (60, 36): from the pose's covariance to the weights of products in that of the moves.
_WEIGHTS = _TIMES[:, None, None, None] * (_parts(_FIRST, _SECOND) + _parts(_SECOND, _FIRST))
_WEIGHTS = _WEIGHTS.transpose(1, 0, 2, 3).reshape(60, 36)

Slopes: TypeAlias = tuple[Array, ...]  # as Camera.slopes gives them
Spread: TypeAlias = tuple[Array, ...]  # (N,) variance, covariance, variance


def both(rotation: Array) -> Array:
    """(6, 6) that turns position and phi alike."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = rotation
    return turn


def products(rays: Array) -> Array:
    """(10, N) of x, y, 1 and 1/z of points; the last is 1/z^2."""
    factors = np.ones((4, rays.shape[1]))
    factors[:2], factors[3] = rays[:2], rays[2]
    return np.asarray(factors.take(_FIRST, axis=0) * factors.take(_SECOND, axis=0))


def moves_of(covariance_c: Array) -> Array:
    """(6, 10): weights of ``products`` in the upper triangle of the moves' covariance (3, 3)."""
    return np.asarray((_WEIGHTS @ covariance_c.ravel()).reshape(6, 10))


def level_moves(rotation_cn: Array) -> Array:
    """(6,) the upper triangle, in c, of the covariance of a level error of 1 m, north and east.

    As much along all axes less that along the vertical.
    """
    down_c = rotation_cn[:, 2]
    return np.asarray((np.eye(3) - np.outer(down_c, down_c))[_ROWS, _COLUMNS])


def on_plane(rays: Array, moves: Array) -> Spread:
    """Variance of x, covariance of x and y, variance of y on the plane z = 1.

    x moves by the point's move along x less x times that along z, both over the depth.
    """
    x, y = rays[:2]
    xx, xy, xz, yy, yz, zz = moves
    x_z, y_z = xz - x * zz, yz - y * zz
    return xx - x * (xz + x_z), xy - x * yz - y * x_z, yy - y * (yz + y_z)


def on_lens(spread: Spread, slopes: Slopes) -> Spread:
    """The same in pixels: variance of the column, covariance, variance of the row, px2."""
    xx, xy, yy = spread
    ux, uy, vx, vy = slopes
    u_x, u_y = ux * xx + uy * xy, ux * xy + uy * yy  # the column's covariance with x and y
    v_x, v_y = vx * xx + vy * xy, vx * xy + vy * yy
    return u_x * ux + u_y * uy, u_x * vx + u_y * vy, v_x * vx + v_y * vy
