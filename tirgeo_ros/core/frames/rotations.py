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
"""Convert rotations: matrices, quaternions (w, x, y, z), vectors, Euler angles; headings; axes.

Unless a single shape is given, functions accept leading axes: quaternions ``(..., 4)`` give
matrices ``(..., 3, 3)``.
Equations: Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems,
2nd ed., section 2.2; rotation vectors as in its section 2.2.4.
Azimuths and headings are in radians from true north, clockwise. ``math`` computes single values,
which is faster: they are wrapped to [-pi, pi]. NumPy computes arrays, wrapped to [-pi, pi).

NED and ENU differ by a swap of the first two axes and the sign of the third; FRD and FLU by the
signs of the last two. Each conversion is its own inverse: one function serves both directions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array, Quaternion

#: NED to ENU, or ENU to NED (the matrix is its own inverse).
ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
#: FRD to FLU, or FLU to FRD.
FLU_FRD = np.diag([1.0, -1.0, -1.0])
#: ``R_gc``: optical frame (right, down, forward) to camera body (forward, right, down).
BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
#: ``q_gc``, (w, x, y, z): the quaternion of BODY_OPTICAL.
Q_BODY_OPTICAL = np.array([0.5, 0.5, 0.5, 0.5])
_SQRT_HALF = math.sqrt(0.5)


def skew(v: Array) -> Array:
    """Return ``[v x]``, so that ``skew(v) @ w == cross(v, w)``; (..., 3) -> (..., 3, 3)."""
    v = np.asarray(v, float)
    x, y, z = _parts(v)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def _parts(a: Array) -> Any:
    """Return the entries of the last axis: arrays, or floats (faster) for a single vector."""
    return a.tolist() if a.ndim == 1 else np.moveaxis(a, -1, 0)


def matrix_from_quat(q: Array) -> Array:
    """Convert unit quaternions (..., 4) to rotation matrices (..., 3, 3)."""
    q = np.asarray(q, float)
    flat = rotation_of(_parts(q))
    out = np.array(flat) if q.ndim == 1 else np.stack(flat, -1)
    return out.reshape(*q.shape[:-1], 3, 3)


def rotation_of(q: Any) -> tuple[Any, Any, Any, Any, Any, Any, Any, Any, Any]:
    """Return the 9 entries of ``matrix_from_quat``, row by row, as floats or arrays."""
    w, x, y, z = q
    xx, yy, zz = x * x, y * y, z * z
    xy, xz, yz, wx, wy, wz = x * y, x * z, y * z, w * x, w * y, w * z
    return (
        1 - 2 * (yy + zz),
        2 * (xy - wz),
        2 * (xz + wy),
        2 * (xy + wz),
        1 - 2 * (xx + zz),
        2 * (yz - wx),
        2 * (xz - wy),
        2 * (yz + wx),
        1 - 2 * (xx + yy),
    )


def quat_from_matrix(matrix: Array) -> Array:
    """Convert rotation matrices (..., 3, 3) to unit quaternions (..., 4) with w >= 0.

    The four classic formulas are the rows of 4 q q^T. The row with the largest diagonal entry is
    normalised, which gives the largest divisor (Shepperd, 1978).
    """
    m = np.asarray(matrix, float)
    lead = m.shape[:-2]
    xx, xy, xz, yx, yy, yz, zx, zy, zz = _parts(m.reshape(*lead, 9))
    rows = np.empty((*lead, 16))
    rows[..., 0], rows[..., 5] = 1 + xx + yy + zz, 1 + xx - yy - zz
    rows[..., 10], rows[..., 15] = 1 - xx + yy - zz, 1 - xx - yy + zz
    rows[..., 1] = rows[..., 4] = zy - yz
    rows[..., 2] = rows[..., 8] = xz - zx
    rows[..., 3] = rows[..., 12] = yx - xy
    rows[..., 6] = rows[..., 9] = yx + xy
    rows[..., 7] = rows[..., 13] = xz + zx
    rows[..., 11] = rows[..., 14] = zy + yz
    flat = rows.reshape(-1, 4, 4)
    best = rows[..., ::5].reshape(-1, 4).argmax(1)
    return canonical(flat[np.arange(len(flat)), best].reshape(*lead, 4))


def canonical(q: Array) -> Array:
    """Return quaternions (..., 4) of the same rotations with unit norm and w >= 0."""
    q = np.asarray(q, float)
    if q.ndim == 1:
        return _canonical(q.tolist())
    norms = np.copysign(np.sqrt((q * q).sum(-1, keepdims=True)), q[..., :1])
    return np.asarray(q / norms)


def _canonical(q: list[float]) -> Array:
    """Return ``canonical`` of one quaternion, with fewer array calls."""
    return np.array(q) / math.copysign(math.sqrt(_dot(q, q)), q[0])


@overload
def quat_multiply(p: Quaternion, q: Quaternion) -> Quaternion: ...
@overload
def quat_multiply(p: Array, q: Array) -> Array: ...
def quat_multiply(p: Any, q: Any) -> Any:
    """Return the Hamilton product, with ``R(p q) = R(p) R(q)``.

    Two tuples of 4 floats give a tuple, which is faster. Arrays (..., 4) give an array, and their
    leading axes broadcast.
    """
    tuples = isinstance(p, tuple) and isinstance(q, tuple)
    if not tuples:
        p, q = np.asarray(p, float), np.asarray(q, float)
    (p0, p1, p2, p3), (q0, q1, q2, q3) = (p, q) if tuples else (_parts(p), _parts(q))
    product = (
        p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
        p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
        p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
        p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
    )
    if tuples:
        return product
    return np.array(product) if p.ndim == q.ndim == 1 else np.stack(product, -1)


def quat_conjugate(q: Array) -> Array:
    """Return the inverse rotations of unit quaternions (..., 4)."""
    return np.asarray(np.asarray(q, float) * np.array([1.0, -1.0, -1.0, -1.0]))


def quat_from_rotvec(rotvec: Array) -> Array:
    """Convert rotation vectors (..., 3), radians, to unit quaternions (..., 4)."""
    v = np.asarray(rotvec, float)
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    scale = 0.5 * np.sinc(half / np.pi)  # sin(half) / (2 half), also exact at zero
    return np.concatenate([np.cos(half), scale * v], -1)


def rotvec_from_quat(q: Array) -> Array:
    """Convert unit quaternions (..., 4) to the shortest rotation vectors (..., 3), radians."""
    q = canonical(q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., :1])
    factor: Array = np.where(sine > 1e-12, angle / np.where(sine > 1e-12, sine, 1.0), 2.0)
    return np.asarray(factor * q[..., 1:])


def matrix_from_rotvec(rotvec: Array) -> Array:
    """Convert rotation vectors (..., 3), radians, to matrices (..., 3, 3): ``exp([v x])``."""
    return matrix_from_quat(quat_from_rotvec(rotvec))


def matrix_from_euler(
    roll_rad: npt.ArrayLike, pitch_rad: npt.ArrayLike, yaw_rad: npt.ArrayLike
) -> Array:
    """Convert Euler angles (...) to ``R_nb`` (..., 3, 3), z-y'-x'' (Groves 2.24, transposed)."""
    return rotation_z(yaw_rad) @ rotation_y(pitch_rad) @ rotation_x(roll_rad)


def euler_from_matrix(matrix: Array) -> Array:
    """Convert ``R_nb`` (..., 3, 3) to roll, pitch, yaw (..., 3), rad; pitch in [-pi/2, pi/2].

    Roll is computed from the matrix with the yaw removed. The three angles therefore reproduce
    the matrix also with the nose straight up or down, where roll and yaw share one axis.
    """
    m = np.asarray(matrix, float)
    pitch = np.arctan2(-m[..., 2, 0], np.hypot(m[..., 0, 0], m[..., 1, 0]))
    yaw = np.arctan2(m[..., 1, 0], m[..., 0, 0])
    sine, cosine = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(
        sine * m[..., 0, 2] - cosine * m[..., 1, 2], cosine * m[..., 1, 1] - sine * m[..., 0, 1]
    )
    return np.stack([roll, pitch, yaw], -1)


def euler_from_quat(q: Array) -> Array:
    """Convert ``q_nb`` (..., 4) to roll, pitch, yaw (..., 3), rad."""
    return euler_from_matrix(matrix_from_quat(q))


def quat_from_euler(
    roll_rad: npt.ArrayLike, pitch_rad: npt.ArrayLike, yaw_rad: npt.ArrayLike
) -> Array:
    """Convert Euler angles (...) to ``q_nb`` (..., 4)."""
    return quat_from_matrix(matrix_from_euler(roll_rad, pitch_rad, yaw_rad))


def rotation_x(angle_rad: npt.ArrayLike) -> Array:
    """Return the rotation matrices of angles about x; (...) -> (..., 3, 3)."""
    return matrix_from_rotvec(np.multiply.outer(np.asarray(angle_rad, float), [1.0, 0.0, 0.0]))


def rotation_y(angle_rad: npt.ArrayLike) -> Array:
    """Return the rotation matrices of angles about y; (...) -> (..., 3, 3)."""
    return matrix_from_rotvec(np.multiply.outer(np.asarray(angle_rad, float), [0.0, 1.0, 0.0]))


def rotation_z(angle_rad: npt.ArrayLike) -> Array:
    """Return the rotation matrices of angles about z; (...) -> (..., 3, 3)."""
    return matrix_from_rotvec(np.multiply.outer(np.asarray(angle_rad, float), [0.0, 0.0, 1.0]))


def euler_axes(pitch_rad: float, yaw_rad: float) -> Array:
    """Return the axes (3, 3), as columns, about which roll, pitch and yaw turn (Groves 2.58)."""
    heading = rotation_z(yaw_rad)
    return np.stack([heading @ rotation_y(pitch_rad)[:, 0], heading[:, 1], [0.0, 0.0, 1.0]], 1)


def slerp(q0: Array, q1: Array, fraction: float) -> Array:
    """Interpolate from q0 to q1 along the shortest rotation, by a fraction; (4,), (4,) -> (4,)."""
    start, end = q0.tolist(), q1.tolist()
    cosine = _dot(start, end)
    sign = math.copysign(1.0, cosine)
    across = [sign * (b - cosine * a) for a, b in zip(start, end, strict=True)]
    sine = math.sqrt(_dot(across, across))
    angle = math.atan2(sine, abs(cosine))
    # Below 1e-8, sin(f a) / sin(a) equals f to the last digit.
    scale = math.sin(fraction * angle) / sine if sine > 1e-8 else fraction
    keep = math.cos(fraction * angle)
    return _canonical([keep * a + scale * b for a, b in zip(start, across, strict=True)])


def _dot(p: list[float], q: list[float]) -> float:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]


def wrapped(angle_rad: float) -> float:
    """Return an angle as the same direction in [-pi, pi]."""
    return math.remainder(angle_rad, math.tau)


def wrap_pi(angle_rad: npt.ArrayLike) -> Array:
    """Return angles, any shape, wrapped to [-pi, pi); nan stays nan."""
    angles = (np.asarray(angle_rad, float) + np.pi) % (2 * np.pi) - np.pi
    # Rounding can make the remainder 2 pi itself.
    return np.asarray(np.where(angles >= np.pi, -np.pi, angles))


def azimuth(direction_n: Sequence[float] | Array) -> float:
    """Return the azimuth of a NED vector (3,); its length does not matter."""
    return math.atan2(direction_n[1], direction_n[0])


def azimuths(directions_n: Array) -> Array:
    """Return the azimuths (...) of NED vectors (..., 3)."""
    return np.asarray(np.arctan2(directions_n[..., 1], directions_n[..., 0]))


def heading_of(q_nb: Array) -> float:
    """Return the azimuth of the body's x axis, the nose, from a unit quaternion (4,) wxyz."""
    return azimuth(rotation_of(q_nb.tolist())[0::3])


def level_quat(q_ng: Array) -> Array:
    """Return the level attitude (4,) wxyz that heads where a camera's picture has its top.

    ``q_ng`` (4,) is the camera's body, FRD. The heading of a level camera is its axis's; straight
    down it is that of the top. The sum of both directions has this heading at every pitch between.
    """
    rotation = matrix_from_quat(q_ng)
    return quat_from_euler(0.0, 0.0, azimuth(rotation[:, 0] - rotation[:, 2]))


def azimuth_row(direction_n: Sequence[float] | Array) -> tuple[float, float, float]:
    """Return the partials (3,) of a direction's azimuth by the attitude error ``phi_n``.

    With ``u = R u_b`` and ``du = phi x u`` the azimuth changes by
    ``phi_D - u_D (u_N phi_N + u_E phi_E) / (u_N^2 + u_E^2)``. For the nose it is the last row of
    Equation 9 of Ren et al. 2022 with its errata: [tan(pitch) cos(yaw), tan(pitch) sin(yaw), 1].
    """
    north, east, down = direction_n
    horizontal = north * north + east * east
    return -down * north / horizontal, -down * east / horizontal, 1.0


def flu_from_frd(v: Array) -> Array:
    """Convert vectors (..., 3) from FRD to FLU, or from FLU to FRD."""
    return np.asarray(np.asarray(v, float) * FLU_FRD.diagonal())


def quat_turned_both(w: float, x: float, y: float, z: float) -> Quaternion:
    """Convert an attitude quaternion (w, x, y, z) from FRD-to-NED to FLU-to-ENU, or back."""
    h = _SQRT_HALF
    return h * (w + z), h * (x + y), h * (x - y), h * (w - z)
