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
"""RTK judged against itself: the test's statistic, which source is refused, for how long."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding import rtk_consistency
from tirgeo_ros.core.navigation.aiding.rtk_consistency import Consistency, distance
from tirgeo_ros.core.navigation.ins.kalman import chi_square_limit
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source, VelocitySample

FIX_M, VELOCITY_M_S = np.array((0.01, 0.01, 0.02)), 0.02
PLANE = TangentPlane(0.695, 2.04, 31.5)
BEGIN_NS = 1_000_000_000_000
FAULT_S = (20.0, 30.0)

Motion = Callable[[np.ndarray], np.ndarray]  # seconds (n,) to NED (n, 3)


def circle(radius_m: float, speed_m_s: float) -> tuple[Motion, Motion]:
    """Place (m) and velocity (m/s) on a level circle; with no speed, at rest."""
    turn = speed_m_s / radius_m

    def place(t_s: np.ndarray) -> np.ndarray:
        north, east = np.cos(turn * t_s), np.sin(turn * t_s)
        return radius_m * np.stack([north, east, 0 * t_s], axis=1)

    def velocity(t_s: np.ndarray) -> np.ndarray:
        north, east = -np.sin(turn * t_s), np.cos(turn * t_s)
        return speed_m_s * np.stack([north, east, 0 * t_s], axis=1)

    return place, velocity


REST = circle(1.0, 0.0)
STEADY = circle(20.0, 5.0)


def states_over(
    motion: tuple[Motion, Motion] = STEADY,
    *,
    seed: int = 1,
    seconds: float = 40.0,
    rate_hz: float = 5.0,
    late_s: float = 0.0,
    ramp_n: tuple[float, float, float] = (0, 0, 0),
    faster_n: tuple[float, float, float] = (0, 0, 0),
    status: FixStatus = FixStatus.FIXED,
) -> list[Consistency]:
    """Return the state after each epoch; faults last over ``FAULT_S``, the IMU is perfect."""
    place, velocity = motion
    rng = np.random.default_rng(seed)
    t_s = np.arange(0, seconds, 1 / rate_hz)
    during = (t_s >= FAULT_S[0]) & (t_s < FAULT_S[1])
    fixes_n = place(t_s) + rng.normal(size=(len(t_s), 3)) * FIX_M
    fixes_n += np.where(during, t_s - FAULT_S[0], 0)[:, None] * ramp_n
    velocities_n = velocity(t_s - late_s) + rng.normal(size=(len(t_s), 3)) * VELOCITY_M_S
    velocities_n += during[:, None] * np.array(faster_n)
    alone_n = velocities_n - velocity(t_s)
    stamps = BEGIN_NS + np.round(t_s * 1e9).astype(int)
    state, states = Consistency(), []
    for number, stamp_ns in enumerate(stamps.tolist()):
        at = [float(x) for x in PLANE.geodetic_from_ned(fixes_n[number])]
        noise = np.diag(FIX_M**2)
        fix = PositionSample(stamp_ns, Source.RTK_POSITION, status, *at, noise)
        state = state.with_fix(fix, noise)
        noise = np.eye(3) * VELOCITY_M_S**2
        sample = VelocitySample(stamp_ns, Source.RTK_VELOCITY, velocities_n[number], noise)
        state = state.with_velocity(sample, noise, tuple(alone_n[number].tolist()))
        states.append(state)
    return states


def refused_s(states: list[Consistency], source: Source, rate_hz: float = 5.0) -> np.ndarray:
    """Return the times, s, at which a source is refused."""
    return np.flatnonzero([state.against is source for state in states]) / rate_hz


# The statistic


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [5.0, 10.0])
def test_statistic_is_chi_square(rate_hz):
    """1000 windows: mean 3 within 3 sqrt(6 / 1000) = 0.23, less 8 % for a noise set too large.

    Too large are the ends of the integral, counted whole, and the bends.
    """
    step, squared = round(rtk_consistency.WINDOW_NS * 1e-9 * rate_hz), []
    for seed in range(20):
        states = states_over(REST, seed=seed, seconds=100.0, rate_hz=rate_hz)
        pairs = [state.pairs[-1] for state in states][5::step]  # windows that do not overlap
        squared += [distance(a, b, states[-1].lag)[0] for a, b in pairwise(pairs)]
    squared = np.array(squared)
    assert len(squared) >= 960
    assert 3 * 0.92 - 0.23 < squared.mean() < 3 + 0.23
    beyond = np.mean(squared > chi_square_limit(2.0, 3))
    assert beyond == pytest.approx(0.0455, abs=0.02)  # 3 sqrt(0.0455 / 1000)


@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 5.0, 20.0])
@pytest.mark.parametrize("motion", [REST, STEADY, circle(24.0, 12.0)])
def test_nothing_is_refused_without_a_fault(motion, rate_hz):
    for seed in range(5):
        states = states_over(motion, seed=seed, rate_hz=rate_hz)
        assert not any(state.since_ns for state in states)


def test_a_lag_is_learned_and_forgiven():
    """118 ms, as in the recorded walk: learned to 20 ms, and nothing is refused meanwhile."""
    states = states_over(late_s=0.118)
    assert states[-1].lag.mean_s == pytest.approx(0.118, abs=0.02)
    assert not any(state.against for state in states)


# What is refused


@pytest.mark.parametrize(
    ("fault", "wrong", "right", "within_s", "over_s"),
    [
        # 0.1 m/s is 5 sigma after 1.2 s (down, of 2 cm: 1.8 s); 43 of these 45 are found.
        ("faster_n", Source.RTK_VELOCITY, Source.RTK_POSITION, 3.0, 2.0),  # the window's length
        # Fixes that drifted step back: that shows at once that the fault is over.
        ("ramp_n", Source.RTK_POSITION, Source.RTK_VELOCITY, 3.4, 0.0),
    ],
)
def test_the_wrong_source_is_refused(fault, wrong, right, within_s, over_s):
    flights = [
        states_over(seed=seed, **{fault: tuple((0.1 * axis).tolist())})
        for seed in range(15)
        for axis in np.eye(3)
    ]
    refused = [times for f in flights if len(times := refused_s(f, wrong))]
    assert len(refused) >= 40
    assert sum(len(refused_s(f, right)) > 0 for f in flights) <= 1
    for times in refused:
        assert FAULT_S[0] < times[0] < FAULT_S[0] + within_s
        assert times[-1] < FAULT_S[1] + over_s


@pytest.mark.parametrize(
    ("fault", "source", "off"),
    [
        ("faster_n", Source.RTK_VELOCITY, "the differences of rtk/fix"),
        ("ramp_n", Source.RTK_POSITION, "rtk/vel"),
    ],
)
def test_a_clear_fault_is_refused_without_a_break(fault, source, off):
    states = states_over(**{fault: (0.3, 0, 0)})
    times = refused_s(states, source)
    assert times[0] < FAULT_S[0] + 1.6
    assert times[-1] > FAULT_S[1] - 0.5
    assert np.diff(times) == pytest.approx(0.2)
    size, *rest = states[(26 * 5)].reason(source).split()
    assert float(size) == pytest.approx(0.3, abs=0.03)
    assert " ".join(rest) == f"m/s off {off}"


def test_fixes_are_not_refused_for_ever(monkeypatch):
    monkeypatch.setattr(rtk_consistency, "_LONGEST_AGAINST_FIXES_NS", 3_000_000_000)
    times = refused_s(states_over(ramp_n=(0.2, 0, 0)), Source.RTK_POSITION)
    assert 2.0 < times[-1] - times[0] < 3.0  # of 3 s, less the time until the fixes are blamed


# What is not refused


def test_no_source_is_blamed_for_a_difference_from_the_start():
    """A receiver whose velocity is of another frame or place is left to the gates."""
    place, velocity = STEADY
    states = states_over((place, lambda t_s: velocity(t_s) + np.array((0.1, 0, 0))))
    assert states[-1].since_ns
    assert not any(state.against for state in states)


@pytest.mark.parametrize(
    ("step_m", "peak_m_s"), [(0.3, 0.0), (3.0, 0.0), (0.0, 5.0)], ids=["step", "jump", "velocity"]
)
def test_steps_and_single_errors_are_left_to_the_gates(step_m, peak_m_s):
    place, velocity = STEADY
    north, east, _ = np.eye(3)
    states = states_over(
        (
            lambda t_s: place(t_s) + step_m * (t_s > 20)[:, None] * north,
            lambda t_s: velocity(t_s) + peak_m_s * (np.abs(t_s - 20) < 0.1)[:, None] * east,
        )
    )
    assert not any(state.against for state in states)


@pytest.mark.parametrize("status", [FixStatus.NONE, FixStatus.SINGLE, FixStatus.FLOAT])
def test_only_fixed_positions_are_compared(status):
    assert states_over(status=status, faster_n=(5, 0, 0))[-1].pairs == ()


def test_a_window_is_kept_no_longer_than_it_is_needed():
    states = states_over(rate_hz=20.0)
    assert max(len(state.pairs) for state in states) <= 3 * 20 + 2
