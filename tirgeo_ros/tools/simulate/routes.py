"""Define the shapes of a flight: commanded position and heading at given times.

A shape gives raw way points in time; the trajectory's spline smooths them. Each starts above the
site's origin. The axes of a shape are forward and right of the first heading; they are turned into
north and east at the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.scenario_aircraft import RouteScenario

Route = tuple[Array, Array]  # (N, 2) north and east in m; (N,) heading in rad, unwrapped
Piece = tuple[float, float]  # length in m, turn over it in rad (clockwise positive)

_STEP_M = 0.02


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
    rest = times_s - count * period_s - (period_s - turning_s)
    done = np.clip(rest / turning_s, 0.0, 1.0)
    headings = np.where(count % 2 == 0, done, 1.0 - done) * math.pi / 2
    return np.zeros((len(times_s), 2)), headings


def _flown(pieces: list[Piece], scenario: RouteScenario, times_s: Array) -> Route:
    """Fly along straight and round pieces, slower in turns, after the first hover."""
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
    """Return the times (N + 1,), s, at which each point of the path is passed, rest to rest."""
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
