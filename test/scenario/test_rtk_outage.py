"""Twelve seconds at 4 m/s without RTK's position, velocity and heading; ordinary GPS goes on."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scenario.deliveries import RTK
from scenario.runs import Run, faulty, run, sizes
from scenario.time_faults import drop

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import Scenario

pytestmark = pytest.mark.slow

SEEDS = (1, 2, 3, 4, 5, 6)
LOST_S, FOUND_S = 22.0, 34.0  # the end of the first leg, the turn, and some of the next leg
END_S = 50.0
SPEED_M_S = 4.0


@functools.cache
def flown(seed: int) -> SimulatedFlight:
    """Legs of 85 m and turns of 7.5 m radius, all at 4 m/s."""
    base = Scenario()
    route = replace(
        base.route,
        speed_m_s=SPEED_M_S,
        acceleration_m_s2=2.5,  # 4 m/s in a turn of 7.5 m take 2.1
        turn_radius_m=7.5,
        leg_length_m=85.0,
    )
    return fly(replace(base, duration_s=END_S, route=route), seed)


@dataclass(frozen=True)
class Outage:
    """A run with RTK lost from ``LOST_S`` to ``FOUND_S``."""

    done: Run
    steps_m: Array  # (N,) how far each published position is from where the one before was going

    @property
    def t_s(self) -> Array:
        return self.done.errors.t_s

    def between(self, start_s: float, end_s: float) -> Array:
        return (self.t_s >= start_s) & (self.t_s < end_s)


@functools.cache
def outage(seed: int) -> Outage:
    flight = flown(seed)
    done = run(flight, faulty(flight, drop(*RTK), LOST_S, FOUND_S))
    return Outage(done, steps(flight.plane, done))


def steps(plane: TangentPlane, done: Run) -> Array:
    """(N,) m: change of the published position less that of the published velocity; first is 0."""
    poses = [plane.body_pose(solution) for solution in done.published]
    places = np.array([pose.position_n for pose in poses])
    velocity = np.array([solution.velocity_n for solution in done.published])
    dt_s = np.diff(done.errors.t_s)[:, None]
    jumps = np.diff(places, axis=0) - (velocity[1:] + velocity[:-1]) / 2 * dt_s
    return np.concatenate([[0.0], np.linalg.norm(jumps, axis=1)])


@pytest.mark.parametrize("seed", SEEDS)
def test_twelve_seconds_without_rtk(seed):
    found = outage(seed)
    running, degraded = FilterState.RUNNING, FilterState.DEGRADED
    assert found.done.states_from(LOST_S) == (running, degraded, running)
    assert found.done.resets == 0
    errors = found.done.errors
    heading_deg, tilt_deg, position_m = sizes(found.done)
    # Errors stay small and inside three sigma, and are those of good data after five seconds.
    during = found.between(LOST_S, FOUND_S + 5.0)
    assert position_m[during].max() <= 1.5
    assert np.abs(errors.state / errors.sigma)[during, :3].max() <= 3.0
    assert heading_deg[during].max() <= 0.3
    after = found.between(FOUND_S + 5.0, END_S)
    assert max(heading_deg[after].max(), tilt_deg[after].max()) <= 0.3
    assert position_m[after].max() <= 0.05
    # Nothing moves more than usual in the first second; then GPS fixes do, below 5 cm each.
    usual_m = found.steps_m[found.between(LOST_S - 10, LOST_S)].max()
    assert found.steps_m[found.between(LOST_S, LOST_S + 1)].max() <= usual_m
    assert found.steps_m[found.between(LOST_S, FOUND_S)].max() <= 0.05
    # No fix makes good more than half of what went wrong meanwhile, beside what a fix does.
    wrong_m = position_m[found.between(LOST_S, FOUND_S)][-1]
    assert wrong_m > 0.05  # else there is nothing to see
    assert found.steps_m[found.between(FOUND_S, END_S)].max() <= wrong_m / 2 + usual_m
