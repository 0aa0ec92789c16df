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
"""Compute radii of curvature, gravity and earth-fixed coordinates of the WGS84 ellipsoid.

Equations: Groves, 2nd ed., sections 2.3 and 2.4. Latitude and longitude in radians, heights in
metres above the ellipsoid.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array

SEMI_MAJOR_AXIS_M = 6378137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
SEMI_MINOR_AXIS_M = SEMI_MAJOR_AXIS_M * (1 - FLATTENING)
# Terms of Bowring's formula: e'^2 b along the earth's axis, e^2 a perpendicular to it.
_POLAR_BEND = ECCENTRICITY_SQUARED / (1 - ECCENTRICITY_SQUARED) * SEMI_MINOR_AXIS_M
_AXIAL_BEND = ECCENTRICITY_SQUARED * SEMI_MAJOR_AXIS_M
_FEW = 9  # numbers in three positions: up to this, floats are faster than arrays
Functions = tuple[Any, ...]  # hypot, atan2, sin, cos, sqrt
FLOAT_FUNCTIONS: Functions = (math.hypot, math.atan2, math.sin, math.cos, math.sqrt)
ARRAY_FUNCTIONS: Functions = (np.hypot, np.arctan2, np.sin, np.cos, np.sqrt)
EARTH_RATE_RAD_S = 7.292115e-5
GRAVITATIONAL_CONSTANT_M3_S2 = 3.986004418e14
GRAVITY_EQUATOR_M_S2 = 9.7803253359
SOMIGLIANA_CONSTANT = 0.001931853
# Decrease of gravity with height (Groves 2.139): the coefficients of h, h sin^2(latitude) and h^2.
_CENTRIFUGAL = (
    EARTH_RATE_RAD_S**2 * SEMI_MAJOR_AXIS_M**2 * SEMI_MINOR_AXIS_M / GRAVITATIONAL_CONSTANT_M3_S2
)
_LINEAR = 2 / SEMI_MAJOR_AXIS_M * (1 + FLATTENING + _CENTRIFUGAL)
_LINEAR_SIN2 = 2 / SEMI_MAJOR_AXIS_M * 2 * FLATTENING
_SQUARE = 3 / SEMI_MAJOR_AXIS_M**2


def radii_of_curvature(latitude_rad: float) -> tuple[float, float]:
    """Return the meridian and transverse (prime vertical) radius in m; Groves 2.105, 2.106."""
    return earth_at(latitude_rad, 0.0)[2:4]


def earth_at(latitude_rad: float, height_m: float) -> tuple[float, float, float, float, float]:
    """Return sine and cosine of a latitude, both radii plus height (m), and gravity (m/s2).

    The radii of curvature are meridian and transverse; gravity is positive down. Groves 2.105,
    2.106, 2.134 and 2.139, computed together for speed: called once for each IMU sample.
    """
    sine = math.sin(latitude_rad)
    sin2 = sine * sine
    factor = 1 - ECCENTRICITY_SQUARED * sin2
    root = math.sqrt(factor)
    transverse = SEMI_MAJOR_AXIS_M / root
    linear = (_LINEAR - _LINEAR_SIN2 * sin2) * height_m
    surface = GRAVITY_EQUATOR_M_S2 * (1 + SOMIGLIANA_CONSTANT * sin2) / root
    return (
        sine,
        math.cos(latitude_rad),
        transverse * (1 - ECCENTRICITY_SQUARED) / factor + height_m,
        transverse + height_m,
        surface * (1 - linear + _SQUARE * height_m * height_m),
    )


def gravity_down(latitude_rad: float, height_m: float) -> float:
    """Return gravity with its centrifugal part in m/s2, positive down; Groves 2.134, 2.139."""
    return earth_at(latitude_rad, height_m)[4]


def ecef_from_geodetic(
    latitude_rad: npt.ArrayLike, longitude_rad: npt.ArrayLike, height_m: npt.ArrayLike
) -> Array:
    """Convert geodetic positions (...) to earth-fixed ones (..., 3) in m; Groves 2.112."""
    lat, lon, h = (np.asarray(x, float) for x in (latitude_rad, longitude_rad, height_m))
    return np.stack(np.broadcast_arrays(*ecef(lat, lon, h, ARRAY_FUNCTIONS)), -1)


def ecef(latitude: Any, longitude: Any, height: Any, functions: Functions) -> tuple[Any, Any, Any]:
    """Return ``ecef_from_geodetic`` as x, y, z; with floats it takes a tenth of the time."""
    _, _, sin, cos, sqrt = functions
    sine = sin(latitude)
    transverse = SEMI_MAJOR_AXIS_M / sqrt(1 - ECCENTRICITY_SQUARED * (sine * sine))
    axial = (transverse + height) * cos(latitude)
    polar = transverse * (1 - ECCENTRICITY_SQUARED) + height
    return axial * cos(longitude), axial * sin(longitude), polar * sine


def geodetic_from_ecef(position_e: Array) -> tuple[Array, Array, Array]:
    """Convert earth-fixed positions (..., 3) in m to latitude, longitude (rad) and height (m).

    Bowring's formula, then two more Newton steps on the reduced latitude: the error is below
    1e-9 m for any height that an aircraft reaches. Up to three positions are computed in floats,
    which takes a fifth of the time for one.
    """
    position_e = np.asarray(position_e, float)
    if 0 < position_e.size <= _FEW and math.isfinite(position_e.sum()):
        rows = position_e.reshape(-1, 3).tolist()
        columns = np.array([_geodetic(x, y, z, FLOAT_FUNCTIONS) for x, y, z in rows]).T
        lat, lon, height = columns.reshape(3, *position_e.shape[:-1])
        return lat, lon, height
    return _geodetic(position_e[..., 0], position_e[..., 1], position_e[..., 2], ARRAY_FUNCTIONS)


def _geodetic(x: Any, y: Any, z: Any, functions: Functions) -> tuple[Any, Any, Any]:
    hypot, atan2, sin, cos, sqrt = functions
    p = hypot(x, y)
    reduced = atan2(z, (1 - FLATTENING) * p)
    for k in range(3):
        s, c = sin(reduced), cos(reduced)
        lat = atan2(z + _POLAR_BEND * (s * s * s), p - _AXIAL_BEND * (c * c * c))
        s, c = sin(lat), cos(lat)
        if k < 2:
            reduced = atan2((1 - FLATTENING) * s, c)
    root = sqrt(1 - ECCENTRICITY_SQUARED * (s * s))
    return lat, atan2(y, x), p * c + z * s - SEMI_MAJOR_AXIS_M * root


def rotation_ecef_from_ned(latitude_rad: float, longitude_rad: float) -> Array:
    """Return ``R_en`` (3, 3): local NED to earth-fixed; Groves 2.150, transposed."""
    sl, cl = math.sin(latitude_rad), math.cos(latitude_rad)
    so, co = math.sin(longitude_rad), math.cos(longitude_rad)
    flat = (-sl * co, -so, -cl * co, -sl * so, co, -cl * so, cl, 0.0, -sl)
    return np.array(flat).reshape(3, 3)


def quat_ecef_from_ned(
    latitude_rad: float, longitude_rad: float
) -> tuple[float, float, float, float]:
    """Return ``q_en`` (w, x, y, z), the quaternion of ``rotation_ecef_from_ned``.

    The rotation is by the longitude about z, then by -(90 deg + latitude) about the new y.
    """
    so, co = math.sin(longitude_rad / 2), math.cos(longitude_rad / 2)
    sl, cl = math.sin(latitude_rad / 2 + math.pi / 4), math.cos(latitude_rad / 2 + math.pi / 4)
    return co * cl, so * sl, -co * sl, so * cl
