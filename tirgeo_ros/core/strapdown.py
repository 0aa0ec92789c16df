"""The strapdown mechanisation: a nominal state and its step between two IMU samples.

Local-navigation-frame equations of Groves, 2nd ed., section 5.4, on the ellipsoid with earth and
transport rate. Scalar arithmetic: at 3 x 3 it costs a fraction of what array calls do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.geodesy import EARTH_RATE_RAD_S, gravity_down, radii_of_curvature
from tirgeo_ros.core.samples import Array

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
#: R_nb row by row.
Rotation = tuple[float, float, float, float, float, float, float, float, float]


class NavState(NamedTuple):
    """The nominal state: attitude, velocity, position of the IMU, and its biases."""

    q_nb: Quaternion
    velocity_n: Vector  # m/s
    latitude_rad: float
    longitude_rad: float
    height_m: float
    gyro_bias_b: Vector  # rad/s, to be taken from the reading
    accel_bias_b: Vector  # m/s2, to be taken from the reading
    correction_n: Vector  # m, sum of all position corrections so far


class Rates(NamedTuple):
    """What the error model needs to know of a state and of the step that starts there."""

    rotation_nb: Rotation
    specific_force_n: Vector  # m/s2
    earth_rate_n: Vector  # rad/s, of e against i
    transport_rate_n: Vector  # rad/s, of n against e
    meridian_m: float  # radius of curvature plus height
    transverse_m: float


def rotation_of(q: Quaternion) -> Rotation:
    """The matrix of a unit quaternion, row by row."""
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


def rotate(m: Rotation, v: Vector) -> Vector:
    """Matrix times vector."""
    x, y, z = v
    return (
        m[0] * x + m[1] * y + m[2] * z,
        m[3] * x + m[4] * y + m[5] * z,
        m[6] * x + m[7] * y + m[8] * z,
    )


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Hamilton product."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def quaternion_of(x: float, y: float, z: float) -> Quaternion:
    """The quaternion of a rotation vector (rad)."""
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    # The series is exact to 1e-17 below 1e-3 rad: (1 - half^2/6 + ...) / 2.
    scale = math.sin(half) / angle if angle > 1e-3 else 0.5 - half * half / 12
    return (math.cos(half), scale * x, scale * y, scale * z)


def normalised(q: Quaternion) -> Quaternion:
    """The same rotation with unit norm."""
    w, x, y, z = q
    factor = 1 / math.sqrt(w * w + x * x + y * y + z * z)
    return (w * factor, x * factor, y * factor, z * factor)


def rates_of(state: NavState, specific_force_b: Vector) -> Rates:
    """Frame rates and radii at a state (Groves 2.123, 5.44), with the force turned to ``n``."""
    north, east, _ = state.velocity_n
    sine, cosine = math.sin(state.latitude_rad), math.cos(state.latitude_rad)
    meridian, transverse = radii_of_curvature(state.latitude_rad)
    meridian += state.height_m
    transverse += state.height_m
    rotation = rotation_of(state.q_nb)
    return Rates(
        rotation,
        rotate(rotation, specific_force_b),
        (EARTH_RATE_RAD_S * cosine, 0.0, -EARTH_RATE_RAD_S * sine),
        (east / transverse, -north / meridian, -east * sine / (cosine * transverse)),
        meridian,
        transverse,
    )


def propagate(
    state: NavState, specific_force_b: Vector, angular_rate_b: Vector, step_s: float
) -> tuple[NavState, Rates]:
    """One step with the mean readings over it; gives the new state and the rates of the step.

    ``specific_force_b`` (m/s2) and ``angular_rate_b`` (rad/s) are as read, biases still in them.
    """
    turn = _scaled(_minus(angular_rate_b, state.gyro_bias_b), step_s)
    force = _minus(specific_force_b, state.accel_bias_b)
    half = cross(turn, force)  # the body turns during the step: the force at its middle
    force = (force[0] + 0.5 * half[0], force[1] + 0.5 * half[1], force[2] + 0.5 * half[2])
    rates = rates_of(state, force)
    velocity = _velocity(state, rates, step_s)
    return (
        NavState(
            _attitude(state, rates, turn, step_s),
            velocity,
            *_position(state, rates, velocity, step_s),
            state.gyro_bias_b,
            state.accel_bias_b,
            state.correction_n,
        ),
        rates,
    )


def _attitude(state: NavState, rates: Rates, turn: Vector, step_s: float) -> Quaternion:
    e, t = rates.earth_rate_n, rates.transport_rate_n
    frame = quaternion_of(
        -(e[0] + t[0]) * step_s, -(e[1] + t[1]) * step_s, -(e[2] + t[2]) * step_s
    )
    return normalised(multiply(multiply(frame, state.q_nb), quaternion_of(*turn)))


def _velocity(state: NavState, rates: Rates, step_s: float) -> Vector:
    e, t = rates.earth_rate_n, rates.transport_rate_n
    f = rates.specific_force_n
    gravity = gravity_down(state.latitude_rad, state.height_m)
    north, east, down = state.velocity_n
    coriolis = cross(e, state.velocity_n)
    half = 0.5 * step_s  # the axes turn during the step: the force as seen at its middle
    turned = cross(
        (e[0] + t[0], e[1] + t[1], e[2] + t[2]),
        (north + half * f[0], east + half * f[1], down + half * f[2]),
    )
    return (
        north + (f[0] - coriolis[0] - turned[0]) * step_s,
        east + (f[1] - coriolis[1] - turned[1]) * step_s,
        down + (f[2] - coriolis[2] - turned[2] + gravity) * step_s,
    )


def _position(
    state: NavState, rates: Rates, velocity_n: Vector, step_s: float
) -> tuple[float, float, float]:
    a, b = state.velocity_n, velocity_n
    north, east, down = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])
    latitude = state.latitude_rad + north / rates.meridian_m * step_s
    middle = 0.5 * (state.latitude_rad + latitude)
    longitude = state.longitude_rad + east / (rates.transverse_m * math.cos(middle)) * step_s
    if abs(longitude) > math.pi:
        longitude = math.remainder(longitude, 2 * math.pi)
    return latitude, longitude, state.height_m - down * step_s


def _minus(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _scaled(a: Vector, factor: float) -> Vector:
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def matrix(rotation: Rotation) -> Array:
    """A row-by-row rotation as (3, 3)."""
    return np.array(rotation).reshape(3, 3)
