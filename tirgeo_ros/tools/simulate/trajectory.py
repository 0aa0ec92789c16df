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
"""Simulate the true motion of the aircraft on its route, and a perfect IMU on the rotating earth.

Position and heading are splines with six continuous derivatives; roll and pitch follow from the
thrust that acceleration and drag need. Before take-off the aircraft may stand on the ground, at
rest without wind, or be in a hand. ``p`` denotes north, east, down of the tangent plane at the
site. It is fixed to the earth, so earth rate, Coriolis force and gravity are exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.rotations import matrix_from_euler, quat_from_matrix, skew
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import EARTH_RATE_RAD_S, gravity_down, rotation_ecef_from_ned
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.processes import Spline, gauss_markov, generator, smooth_noise
from tirgeo_ros.tools.simulate.scenario import RouteScenario, Scenario

Route = tuple[Array, Array]  # (N, 2) north and east in m; (N,) heading in rad, unwrapped
Piece = tuple[float, float]  # length in m, turn over it in rad (clockwise positive)

_STEP_M = 0.02  # of a point on the route
_KNOT_S = 0.4
_HOLD_TIME_S, _GUST_TIME_S = 4.0, 2.0  # correlation times
#: A hand turns and shifts at up to 3 Hz: a spline of this time smooths what is faster.
_HAND_TIME_S = 0.4
_STANDING_M = 0.5  # height of the IMU on the ground
_GROUND_TILT_RAD = math.radians(1.0)  # sigma, per axis
_SETTLES_S = 4 * _KNOT_S  # a spline of degree 7 moves as long before its control points do
_WIND_RISES_S = 2.0  # from the ground to the full wind
# Only for the tilt of the aircraft; the IMU measures the ellipsoid's gravity.
_GRAVITY_P = np.array([0.0, 0.0, 9.8])


def route(scenario: RouteScenario, times_s: Array) -> Route:
    """Return the commanded position (N, 2), m, and heading (N,), rad, at ``times_s`` (N,)."""
    positions, headings = _SHAPES[scenario.shape](scenario, times_s)
    first = math.radians(scenario.heading_deg)
    turn = np.array([[math.cos(first), -math.sin(first)], [math.sin(first), math.cos(first)]])
    return positions @ turn.T, headings + first


def _lawnmower(scenario: RouteScenario, times_s: Array) -> Route:
    radius = min(scenario.turn_radius_m, scenario.leg_spacing_m / 2)
    quarter = radius * math.pi / 2
    pieces: list[Piece] = [(scenario.leg_length_m, 0.0)]
    for leg in range(1, scenario.legs):
        turn = math.pi / 2 if leg % 2 else -math.pi / 2
        across = scenario.leg_spacing_m - 2 * radius
        pieces += [(quarter, turn), (across, 0.0), (quarter, turn), (scenario.leg_length_m, 0.0)]
    return _flown(pieces, scenario, times_s)


def _figure_eight(scenario: RouteScenario, times_s: Array) -> Route:
    circle = 2 * math.pi * scenario.turn_radius_m
    pieces = [(circle, 2 * math.pi), (circle, -2 * math.pi)] * scenario.legs
    return _flown(pieces, scenario, times_s)


def _hover(scenario: RouteScenario, times_s: Array) -> Route:
    """Hover; turn right and left by 90 degrees, resting ``hover_s`` in between."""
    turning_s = 90.0 / scenario.yaw_rate_deg_s
    period_s = turning_s + max(scenario.hover_s, 1.0)
    count = np.floor(times_s / period_s)
    turned_s = times_s - count * period_s - (period_s - turning_s)
    done = np.clip(turned_s / turning_s, 0.0, 1.0)
    headings = np.where(count % 2 == 0, done, 1.0 - done) * math.pi / 2
    return np.zeros((len(times_s), 2)), headings


def _flown(pieces: list[Piece], scenario: RouteScenario, times_s: Array) -> Route:
    """Fly along straight and round pieces, slower in turns, after an initial hover."""
    counts = [max(1, round(length / _STEP_M)) for length, _ in pieces if length > 0]
    pieces = [piece for piece in pieces if piece[0] > 0]
    step = np.repeat([p[0] / n for p, n in zip(pieces, counts, strict=True)], counts)
    bend = np.repeat([p[1] / n for p, n in zip(pieces, counts, strict=True)], counts)
    heading = np.concatenate([[0.0], np.cumsum(bend)])
    along = heading[:-1] + bend / 2
    moves = np.stack([step * np.cos(along), step * np.sin(along)], -1)
    position = np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    clock = scenario.hover_s + _passing_times(step, bend, scenario)
    axes = [np.interp(times_s, clock, position[:, axis]) for axis in (0, 1)]
    return np.stack(axes, -1), np.interp(times_s, clock, heading)


def _passing_times(step: Array, bend: Array, scenario: RouteScenario) -> Array:
    """Return the times (N + 1,), s, at which each point is passed, from rest to rest."""
    with np.errstate(divide="ignore"):
        turning = np.sqrt(scenario.acceleration_m_s2 * step / np.abs(bend))
    limit = np.minimum(scenario.speed_m_s, turning)
    squares = np.concatenate([[0.0], np.minimum(limit[:-1], limit[1:]) ** 2, [0.0]])
    gains = 2 * scenario.acceleration_m_s2 * step
    for k in range(len(gains)):
        squares[k + 1] = min(squares[k + 1], squares[k] + gains[k])
    for k in reversed(range(len(gains))):
        squares[k] = min(squares[k], squares[k + 1] + gains[k])
    speed = np.sqrt(squares)
    return np.concatenate([[0.0], np.cumsum(2 * step / (speed[:-1] + speed[1:]))])


_SHAPES: dict[str, Callable[[RouteScenario, Array], Route]] = {
    "lawnmower": _lawnmower,
    "hover": _hover,
    "figure_eight": _figure_eight,
}


@dataclass(frozen=True)
class Motion:
    """Hold the motion of the aircraft at N instants, in the plane ``p`` of the site."""

    t_s: Array  # (N,)
    position_p: Array  # (N, 3) m, the IMU
    velocity_p: Array  # (N, 3) m/s
    acceleration_p: Array  # (N, 3) m/s2
    rotation_pb: Array  # (N, 3, 3)
    rate_pb_b: Array  # (N, 3) rad/s, of the body relative to the earth
    heading_rad: Array  # (N,) unwrapped

    def at_arm(self, arm_b: Array) -> tuple[Array, Array]:
        """Return position and velocity (N, 3) in ``p`` of a point ``arm_b`` (3,) from the IMU."""
        spin = np.cross(self.rate_pb_b, arm_b)
        return (
            self.position_p + self.rotation_pb @ arm_b,
            self.velocity_p + np.einsum("nij,nj->ni", self.rotation_pb, spin),
        )


def _aloft(times_s: Array, start_s: float) -> Array:
    """Return the shares (N, 1) of the wind and of the errors off the route that have begun."""
    return np.clip((times_s - start_s) / _WIND_RISES_S, 0.0, 1.0)[:, None]


def _standing(scenario: RouteScenario, seed: int, start_s: float) -> Spline:
    """Return shifts (3), m, heading, rad, and the force (2), m/s2, that the aircraft leans to.

    It stands on ground that is level to a degree, or is in a hand as well; 0 after ``start_s``.
    """
    if not scenario.standing_s:
        return Spline(np.zeros((2, 6)), _KNOT_S)
    rng, turn = generator(seed, "standing"), math.radians(scenario.hand_turn_deg)
    std = np.array([*[scenario.hand_shift_m] * 3, turn, 9.8 * turn, 9.8 * turn])
    slope = np.array([0.0] * 4 + [9.8 * _GROUND_TILT_RAD] * 2) * rng.standard_normal(6)
    std *= scenario.standing_on == "hand"
    motion = smooth_noise(rng, start_s, _HAND_TIME_S, std)
    points = np.concatenate([motion.points + slope, np.zeros((1, 6))])
    return Spline(points, motion.spacing_s)


class Trajectory:
    """Compute the motion of a flight as a function of time."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        """Plan the route and draw the gusts and the autopilot's position errors."""
        self.plane: TangentPlane = scenario.site.plane
        self._drag_1_s = scenario.wind.drag_1_s
        self._mean_wind_p = np.array([*scenario.wind.mean_m_s, 0.0])
        way = scenario.route
        times_s = np.arange(0.0, scenario.duration_s + 2 * _KNOT_S, _KNOT_S)
        start_s = way.standing_s + _SETTLES_S if way.standing_s else -math.inf
        top_m = way.height_above_ground_m
        self.begin_s = max(0.0, start_s + top_m / way.speed_m_s)  # of the route
        height = np.interp(times_s, [start_s, self.begin_s], [_STANDING_M, top_m])
        level, heading = route(way, np.maximum(times_s - self.begin_s, 0.0))
        hold_m = np.full(3, way.hold_error_m)
        rng = generator(seed, "hold")
        slips = gauss_markov(rng, len(times_s), _KNOT_S, np.full(3, _HOLD_TIME_S), hold_m)
        slips *= _aloft(times_s, start_s)
        self._position = Spline(np.column_stack([level, -height]) + slips, _KNOT_S)
        self._heading = Spline(heading[:, None], _KNOT_S)
        self._standing = _standing(way, seed, start_s)
        gust = scenario.wind.gust_m_s * np.array([1.0, 1.0, 0.3])  # weaker vertically
        blows = smooth_noise(generator(seed, "gusts"), scenario.duration_s, _GUST_TIME_S, gust)
        calm = 1 - _aloft(blows.spacing_s * np.arange(len(blows.points), dtype=float), start_s)
        blows.points -= calm * (blows.points + self._mean_wind_p)
        self._gust = Spline(blows.points, blows.spacing_s)

    def motion(self, t_s: npt.ArrayLike) -> Motion:
        """Return the motion at times (N,) in seconds from the start."""
        times = np.atleast_1d(np.asarray(t_s, float))
        position, velocity, acceleration, jerk = (self._position(times, k) for k in range(4))
        standing = [self._standing(times, k) for k in range(3)]
        yaw, yaw_rate = (self._heading(times, k)[:, 0] + standing[k][:, 3] for k in range(2))
        wind = self._mean_wind_p + self._gust(times)
        thrust = acceleration - _GRAVITY_P + self._drag_1_s * (velocity - wind)
        thrust_rate = jerk + self._drag_1_s * (acceleration - self._gust(times, 1))
        thrust[:, :2] += standing[0][:, 4:]
        thrust_rate[:, :2] += standing[1][:, 4:]
        position, velocity = position + standing[0][:, :3], velocity + standing[1][:, :3]
        acceleration = acceleration + standing[2][:, :3]
        tilt, tilt_rate = _tilt(thrust, thrust_rate, yaw, yaw_rate)
        rotation = matrix_from_euler(tilt[:, 0], tilt[:, 1], yaw)
        rate = _body_rate(tilt, tilt_rate, yaw_rate)
        return Motion(times, position, velocity, acceleration, rotation, rate, yaw)

    def inertial(self, motion: Motion) -> tuple[Array, Array]:
        """Return specific force and angular rate (N, 3) in ``b`` of a perfect IMU."""
        lat, lon, height = self.plane.geodetic_from_ned(motion.position_p)
        gravity_p = np.array(
            [
                self.plane.rotation_from_local(a, b)[:, 2] * gravity_down(a, h)
                for a, b, h in zip(lat, lon, height, strict=True)
            ]
        )
        to_earth = rotation_ecef_from_ned(self.plane.latitude_rad, self.plane.longitude_rad)
        spin_p = to_earth.T @ np.array([0.0, 0.0, EARTH_RATE_RAD_S])
        # The centrifugal part is in gravity (Groves 2.132), so only Coriolis is added.
        force_p = motion.acceleration_p + 2 * motion.velocity_p @ skew(spin_p).T - gravity_p
        force_b = np.einsum("nji,nj->ni", motion.rotation_pb, force_p)
        return force_b, motion.rate_pb_b + np.einsum("nji,j->ni", motion.rotation_pb, spin_p)

    def rotation_nb(self, motion: Motion) -> Array:
        """Return the rotations (N, 3, 3) from body to north, east, down at the aircraft.

        Near a pole these axes differ from those of the site.
        """
        lat, lon, _ = self.plane.geodetic_from_ned(motion.position_p)
        return np.asarray(_local_axes(self.plane, lat, lon) @ motion.rotation_pb)


def _local_axes(plane: TangentPlane, latitude_rad: Array, longitude_rad: Array) -> Array:
    """Return the rotations (N, 3, 3) from the plane ``p`` to north, east, down at N places."""
    places = zip(latitude_rad, longitude_rad, strict=True)
    return np.array([plane.rotation_from_local(lat, lon).T for lat, lon in places])


def geodetic_state(
    plane: TangentPlane, position_p: Array, velocity_p: Array, rotation_pb: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Return latitude, longitude (rad), height (m), velocity (N, 3), quaternion (N, 4), NED.

    The axes are the local ones at each position.
    """
    lat, lon, height = plane.geodetic_from_ned(position_p)
    turn = _local_axes(plane, lat, lon)
    velocity_n = np.einsum("nij,nj->ni", turn, velocity_p)
    return lat, lon, height, velocity_n, quat_from_matrix(turn @ rotation_pb)


def _tilt(thrust: Array, thrust_rate: Array, yaw: Array, yaw_rate: Array) -> tuple[Array, Array]:
    """Return roll and pitch (N, 2) that turn the body's up axis to ``thrust``, and the rates."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    north, east, down = -thrust.T
    north_rate, east_rate, down_rate = -thrust_rate.T
    # Body down in axes turned by the heading: (cos r sin p, -sin r, cos r cos p) times its length.
    x, y, z = cos * north + sin * east, cos * east - sin * north, down
    x_rate = cos * north_rate + sin * east_rate + yaw_rate * y
    y_rate = cos * east_rate - sin * north_rate - yaw_rate * x
    upright = np.hypot(x, z)
    upright_rate = (x * x_rate + z * down_rate) / upright
    tilt = np.stack([np.arctan2(-y, upright), np.arctan2(x, z)], -1)
    roll_rate = (y * upright_rate - upright * y_rate) / (upright**2 + y**2)
    pitch_rate = (z * x_rate - x * down_rate) / upright**2
    return tilt, np.stack([roll_rate, pitch_rate], -1)


def _body_rate(tilt: Array, tilt_rate: Array, yaw_rate: Array) -> Array:
    """Return the rate (N, 3) in ``b`` from rates of Euler angles (Groves 2.57)."""
    (roll, pitch), (roll_rate, pitch_rate) = tilt.T, tilt_rate.T
    return np.stack(
        [
            roll_rate - np.sin(pitch) * yaw_rate,
            np.cos(roll) * pitch_rate + np.sin(roll) * np.cos(pitch) * yaw_rate,
            np.cos(roll) * np.cos(pitch) * yaw_rate - np.sin(roll) * pitch_rate,
        ],
        -1,
    )
