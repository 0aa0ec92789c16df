"""Propagate small errors of pose and map to the displacement of a point in the camera frame c.

A point at d from the camera is displaced in c by -position + d x phi. Divided by its depth z this
is a sum of constant matrices (3, 6) times x, y, 1 and 1/z, where x and y are the point's
coordinates on the plane z = 1. The covariance of the displacement over the depth is therefore a
weighted sum of the ten products of these four; the weights are the same for all points of a frame.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from tirgeo_ros.core.frames.rotations import skew
from tirgeo_ros.core.types.arrays import Array, IntArray

#: (4, 3, 6): derivatives of displacement / depth by position and phi; the factors of x, y, 1, 1/z.
MOVES = np.zeros((4, 3, 6))
MOVES[:3, :, 3:] = [skew(axis) for axis in np.eye(3)]
MOVES[3, :, :3] = -np.eye(3)
_FIRST, _SECOND = np.triu_indices(4)  # which two of x, y, 1 and 1/z make each product
_ROWS, _COLUMNS = np.triu_indices(3)  # upper triangle of the displacement's covariance
_LEVEL = np.where(_ROWS == _COLUMNS, 1.0, 0.0)  # the upper triangle of I
_TIMES = np.where(_FIRST == _SECOND, 0.5, 1.0)  # squares are counted twice in _WEIGHTS


def _parts(first: IntArray, second: IntArray) -> Array:
    """Return (10, 6, 6, 6): product by triangle entry by the pose covariance's row and column.

    An entry is the factor of one entry of the pose's covariance in one entry of the upper
    triangle, for one product.
    """
    rows, columns = MOVES[first][:, _ROWS], MOVES[second][:, _COLUMNS]
    return np.asarray(rows[..., :, None] * columns[..., None, :])


# (60, 36): maps the flattened covariance of the pose to the weights that ``moves_of`` returns.
_WEIGHTS = _TIMES[:, None, None, None] * (_parts(_FIRST, _SECOND) + _parts(_SECOND, _FIRST))
_WEIGHTS = _WEIGHTS.transpose(1, 0, 2, 3).reshape(60, 36)

Slopes: TypeAlias = tuple[Array, ...]  # what Camera.slopes returns
Spread: TypeAlias = tuple[Array, ...]  # (N,) variance, covariance, variance


def both(rotation: Array) -> Array:
    """Return the block-diagonal (6, 6) matrix that rotates position and phi alike."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = rotation
    return turn


def products(rays: Array) -> Array:
    """Return the ten products (10, N) of x, y, 1 and 1/z for rays (3, N); the last is 1/z^2."""
    factors = np.ones((4, rays.shape[1]))
    factors[:2], factors[3] = rays[:2], rays[2]
    return np.asarray(factors.take(_FIRST, axis=0) * factors.take(_SECOND, axis=0))


def moves_of(covariance_c: Array) -> Array:
    """Return the weights (6, 10) of ``products`` in the displacement's covariance over depth^2.

    The rows are the upper triangle of that covariance (3, 3). ``covariance_c`` (6, 6) is the
    pose's, in c.
    """
    return np.asarray((_WEIGHTS @ covariance_c.ravel()).reshape(6, 10))


def level_moves(rotation_cn: Array) -> Array:
    """Return the covariance of a horizontal error of 1 m in north and east, in c.

    It is I - down down', given as its upper triangle (6,).
    """
    down_c = rotation_cn[:, 2]
    return np.asarray(_LEVEL - down_c[_ROWS] * down_c[_COLUMNS])


def on_plane(rays: Array, moves: Array) -> Spread:
    """Project displacement covariances to the plane z = 1: var x, cov x y, var y, each (N,).

    ``moves`` (6, N) is the covariance of the displacement over the depth. x changes by the
    displacement along x minus x times that along z, both over the depth.
    """
    x, y = rays[:2]
    xx, xy, xz, yy, yz, zz = moves
    x_z, y_z = xz - x * zz, yz - y * zz
    return xx - x * (xz + x_z), xy - x * yz - y * x_z, yy - y * (yz + y_z)


def on_lens(spread: Spread, slopes: Slopes) -> Spread:
    """Convert covariances on the plane z = 1 to pixels: var column, cov, var row, px2."""
    xx, xy, yy = spread
    ux, uy, vx, vy = slopes
    u_x, u_y = ux * xx + uy * xy, ux * xy + uy * yy  # covariances of the column with x and y
    v_x, v_y = vx * xx + vy * xy, vx * xy + vy * yy
    return u_x * ux + u_y * uy, u_x * vx + u_y * vy, v_x * vx + v_y * vy
