"""The mechanisation in turns: a closed form each, and the order of what is left."""

from __future__ import annotations

import math

import numpy as np
from motions import angle_between, state_at, steady_readings

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.strapdown import propagate

STEP_S = 0.01


class Circle:
    """A level circle, the nose along the velocity, seen from the turning, round earth."""

    rate, lat, height = 0.5, 0.7, 50.0

    def __init__(self, speed):
        self.speed = speed

    def state(self, t):
        """The truth; over 40 m the radii of curvature are constant to 1e-7."""
        yaw = self.rate * t
        velocity = (self.speed * math.cos(yaw), self.speed * math.sin(yaw), 0.0)
        north, east, _ = self.position_n(t)
        meridian, transverse = radii_of_curvature(self.lat)
        lat = self.lat + north / (meridian + self.height)
        lon = 2.0 + east / ((transverse + self.height) * math.cos(lat))
        return state_at(lat, lon, self.height, velocity, (0.0, 0.0, yaw))

    def position_n(self, t):
        yaw, radius = self.rate * t, self.speed / self.rate
        return radius * np.array([math.sin(yaw), 1 - math.cos(yaw), 0.0])

    def readings(self, t):
        """As in steady flight, with the turn and its acceleration to the right."""
        force_b, rate_b = steady_readings(self.state(t))
        return (
            (force_b[0], force_b[1] + self.rate * self.speed, force_b[2]),
            (rate_b[0], rate_b[1], rate_b[2] + self.rate),
        )

    def flown(self, seconds, step_s):
        state = self.state(0.0)
        for k in range(round(seconds / step_s)):
            state, _ = propagate(state, *self.readings((k + 0.5) * step_s), step_s)
        return state


def test_circle_is_flown_as_its_closed_form():
    circle = Circle(10.0)
    end, truth = circle.flown(2 * math.pi / 0.5, math.pi / 250), circle.state(0.0)
    turn = 0.5 * math.pi / 250
    # The force at the middle of a step, linear in the turn, is too large by an eighth of the
    # turn's square, and the mean over the step is smaller by a twenty-fourth. An acceleration
    # too large by a sixth leaves no velocity after a circle but moves it against the first way.
    moved = 10 * 4 * math.pi * turn**2 / 6  # 0.8 mm
    # The Coriolis force, taken at the start of a step, adds 1.5e-4 x 6.3 ms to 6.6e-6.
    share = 0.15
    assert np.linalg.norm(np.subtract(end.velocity_n, truth.velocity_n)) < 10 * turn**2 / 6 * share
    # On the round earth the way does not close: parallels are shorter in its northern half, by
    # its area times tan(latitude) over the radius.
    open_m = math.pi * 20**2 * math.tan(0.7) / 6.4e6
    error = TangentPlane(*truth[2:5]).ned_from_geodetic(*end[2:5])
    np.testing.assert_allclose(error, [-moved, open_m, 0], atol=share * moved)
    assert angle_between(truth.q_nb, end.q_nb) < 1e-8


def test_error_falls_with_the_square_of_the_step():
    """Half the step, a quarter of the error: in velocity, and in position."""
    circle, seconds = Circle(10.0), 4.0
    truth = circle.state(seconds)
    errors = []
    for step_s in (0.2, 0.1, 0.05):
        end = circle.flown(seconds, step_s)
        velocity = np.linalg.norm(np.subtract(end.velocity_n, truth.velocity_n))
        place = np.subtract(end[2:4], truth[2:4]) * [1, math.cos(0.7)]
        errors.append([velocity, np.linalg.norm(place)])
    ratios = np.array(errors[:-1]) / errors[1:]
    # The Coriolis force, taken at the start of a step, is of first order: at 0.05 s it is
    # 1.5e-4 x 5 m/s2 x 0.025 s against 5 m/s2 x 0.025^2 / 6, which is 4 %.
    np.testing.assert_allclose(ratios, 4.0, rtol=0.04)
