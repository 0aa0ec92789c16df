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
"""Setting a state to measurements that contradict it: what is set, and how certain it is then."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from filter_states import (
    RTK,
    SECOND_NS,
    ZERO,
    assert_covariance,
    ekf_config,
    fix,
    heading,
    heard,
    ns,
    state_of,
    used_at,
    velocity,
)

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import euler_from_quat, quat_from_euler, quat_multiply
from tirgeo_ros.core.navigation.aiding.aid import StateEstimate
from tirgeo_ros.core.navigation.aiding.aid_status import AidTrack, Receivers
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.ins.error_states import ANTENNA, GPS_ERROR, POSITION
from tirgeo_ros.core.types.measurements import FixStatus, Source
from tirgeo_ros.core.types.verdicts import Outcome

START = state_of(0.05, -0.03, 0.4)._replace(
    gyro_bias_b=(1e-4, -2e-4, 3e-4), accel_bias_b=(0.01, 0.02, -0.03)
)
CONFIG = ekf_config()
SHIFT_N = np.array([3.0, -4.0, 1.0])


def correlated(states: int, seed: int = 3) -> np.ndarray:
    """A covariance with all states correlated, small enough that jumps are refused."""
    scales = np.r_[
        [2e-3] * 3, [0.03] * 3, [0.02] * 3, [1e-4] * 3, [5e-3] * 3, [0.5] * 4, [0.01] * 4
    ]
    root = np.random.default_rng(seed).normal(size=(states, 2 * states)) / math.sqrt(2 * states)
    root *= scales[:states, None]
    return root @ root.T


def estimate_of(
    states: int = ANTENNA.start, *, rtk: bool = True, covariance=None
) -> StateEstimate:
    """RTK fixed for five seconds, its three measurements just used or never."""
    aids = used_at(dict.fromkeys(RTK, ns(0)) if rtk else {})
    aids = aids._replace(receivers=Receivers(ns(0)))
    aids = aids.with_status(FixStatus.FIXED, ns(-5), SECOND_NS)
    return StateEstimate(START, correlated(states) if covariance is None else covariance, aids)


def again_and_again(estimate, make, seconds=2.0, config=CONFIG):
    """The verdicts on samples at 5 Hz that all agree; the estimates before and after the last.

    The state does not move in between (``make(t_s)`` gives a sample for a state that stands).
    """
    fusion, verdicts, before = Fusion(config), [], estimate
    for k in range(round(seconds * 5) + 1):
        before = estimate
        verdict, estimate = fusion.fuse(make(k / 5), before, ZERO)
        verdicts.append(verdict)
    return verdicts, before, estimate


def test_position_is_set_where_it_is_measured():
    estimate = estimate_of()
    receivers = Receivers(ns(0), (0.5, -0.2, 2.0))
    estimate = estimate._replace(aids=estimate.aids._replace(receivers=receivers))
    verdicts, before, after = again_and_again(estimate, lambda t_s: fix(t_s, SHIFT_N))
    assert [v.outcome for v in verdicts] == [Outcome.GATED] * 10 + [Outcome.RESET]
    assert verdicts[-1].reason == "position moved by 5.10 m"
    assert after.state.correction_n == pytest.approx(tuple(SHIFT_N), abs=1e-5)
    np.testing.assert_allclose(after.covariance[POSITION, POSITION], np.diag([1e-4, 1e-4, 4e-4]))
    # Nothing else is touched: the other states and their covariances.
    assert after.state.q_nb == pytest.approx(START.q_nb, abs=1e-15)
    assert after.state.velocity_n == START.velocity_n
    others = np.r_[0:6, 9:15]
    chosen = np.ix_(others, others)
    np.testing.assert_array_equal(after.covariance[chosen], before.covariance[chosen])
    assert_covariance(after.covariance)
    assert after.aids.resets[0] == sum(after.aids.resets) == 1
    # The ordinary GPS did not move: its error was against the wrong position.
    result = after.aids.receivers.gps_error_n
    assert result == pytest.approx((0.5 - 3.0, -0.2 + 4.0, 2.0 - 1.0), abs=0.15)  # 2 s of 45 fade


def wandering(t_s):
    return fix(t_s, (3.0 + 4.0 * (round(5 * t_s) % 2), 0.0, 0.0))


@pytest.mark.parametrize(
    ("make", "seconds"), [(lambda t_s: fix(t_s, SHIFT_N), 1.8), (wandering, 20.0)]
)
def test_short_runs_and_positions_that_disagree_do_not_set_the_position(make, seconds):
    verdicts, _, after = again_and_again(estimate_of(), make, seconds)
    assert {v.outcome for v in verdicts} == {Outcome.GATED}
    assert after.state is START


def off(t_s, source=Source.RTK_VELOCITY):
    """A velocity that is 2 m/s away from the state's."""
    return velocity(t_s, np.add(START.velocity_n, (2.0, 0.0, 0.0)), source)


def test_velocity_is_not_set_while_positions_fit():
    """Positions that fit confirm the state's velocity, too."""
    estimate, fusion = estimate_of(), Fusion(CONFIG)
    for k in range(100):
        aids = estimate.aids.with_track(Source.RTK_POSITION, AidTrack(ns(0.2 * k)))
        verdict, estimate = fusion.fuse(off(0.2 * k), estimate._replace(aids=aids), ZERO)
        assert verdict.outcome is Outcome.GATED
    assert estimate.state is START


@pytest.mark.parametrize("source", [Source.RTK_VELOCITY, Source.GPS_VELOCITY])
def test_velocity_is_set_without_positions(source):
    verdicts, _, after = again_and_again(estimate_of(rtk=False), lambda t_s: off(t_s, source))
    assert verdicts[-1].outcome is Outcome.RESET
    assert after.state.velocity_n == pytest.approx((5.0, -1.0, 0.2), abs=1e-12)
    assert_covariance(after.covariance)


def by_gps(t_s):
    return fix(t_s, (0.0, 0.0, 60.0), Source.GPS_POSITION, FixStatus.SINGLE)


def test_gps_reset_changes_its_error_and_not_the_position():
    """Position and GPS error together are measured, neither of them alone."""
    covariance = correlated(ANTENNA.start)
    covariance[POSITION, POSITION] += 4.0 * np.eye(3)
    verdicts, before, after = again_and_again(
        estimate_of(rtk=False, covariance=covariance), by_gps
    )
    assert verdicts[-1].outcome is Outcome.RESET
    assert after.state is START
    assert after.aids.receivers.gps_error_n == pytest.approx((0.0, 0.0, 60.0), abs=1e-4)
    assert_covariance(after.covariance)
    position_m2 = np.diag(before.covariance)[POSITION]
    np.testing.assert_array_equal(np.diag(after.covariance)[POSITION], position_m2)
    # A second one measures the same once more: it finds the sum to the noise of both, no more.
    again = Fusion(CONFIG).fuse(by_gps(2.2), after, ZERO)
    assert again.verdict.used
    result = again.estimate.covariance
    # Of the fix's noise of 0.05 m a part of 1e-3 of the 4 m2 may go to either.
    np.testing.assert_allclose(np.diag(result)[POSITION], position_m2, rtol=5e-3)
    sums = (
        result[POSITION, POSITION] + 2 * result[POSITION, GPS_ERROR] + result[GPS_ERROR, GPS_ERROR]
    )
    assert np.diag(sums) == pytest.approx([0.05**2 / 2] * 3, rel=0.01)


def turned(config, degrees, estimate=None):
    """The estimates before and after the reset to headings that are off, and when it came."""
    fusion, estimate = Fusion(config), estimate_of() if estimate is None else estimate
    off_rad = float(euler_from_quat(np.array(START.q_nb))[2]) + math.radians(degrees)
    # The autopilot has turned as well, so the state is wrong.
    q_nb = quat_multiply(quat_from_euler(0.0, 0.0, math.radians(degrees)), np.array(START.q_nb))
    for k in range(400):
        t_s = 0.2 * k
        before = estimate._replace(aids=heard(estimate.aids, t_s))
        sample = replace(heading(t_s), heading_rad=off_rad)
        verdict, estimate = fusion.fuse(sample, before, ZERO, autopilot_q_nb=q_nb)
        if verdict.outcome is Outcome.RESET:
            return before, estimate, t_s
        assert not verdict.used
    raise AssertionError("no reset")


@pytest.mark.parametrize("degrees", [20.0, -90.0, 179.0])
def test_attitude_turns_about_the_vertical(degrees):
    before, after, _ = turned(CONFIG, degrees)
    roll, pitch, yaw = euler_from_quat(np.array(after.state.q_nb))
    was = euler_from_quat(np.array(START.q_nb))
    assert (roll, pitch) == pytest.approx(was[:2], abs=1e-12)
    # The nose is the baseline; it is not level, so its azimuth is the yaw.
    left = math.remainder(yaw - was[2] - math.radians(degrees), 2 * math.pi)
    assert left == pytest.approx(0.0, abs=1e-12)
    assert after.covariance[2, 2] == pytest.approx(math.radians(0.6) ** 2)
    # After such a wrong start, tilt and biases were wrong, too.
    assert after.state.gyro_bias_b == after.state.accel_bias_b == ZERO
    turn_on = EkfConfig().imu.gyro_turn_on_bias
    assert after.covariance[9, 9] == pytest.approx(turn_on**2, rel=1e-3)
    assert after.state.velocity_n == before.state.velocity_n
    assert_covariance(after.covariance)


def test_a_small_turn_keeps_the_biases():
    before, after, t_s = turned(ekf_config(heading__reset_after_s=5.0), 4.5)
    assert t_s >= 5.0
    assert after.state.gyro_bias_b == START.gyro_bias_b
    np.testing.assert_array_equal(after.covariance[9:15, 9:15], before.covariance[9:15, 9:15])
    assert_covariance(after.covariance)


def set_by(make, **estimate):
    return again_and_again(estimate_of(**estimate), make)[1:]


@pytest.mark.parametrize(
    ("reset", "chosen"),
    [
        (lambda: set_by(lambda t_s: fix(t_s, SHIFT_N)), range(6, 9)),
        (lambda: set_by(off, rtk=False), range(3, 6)),
        (lambda: set_by(by_gps, rtk=False), range(GPS_ERROR.start, GPS_ERROR.stop)),
        (lambda: turned(CONFIG, 52.0)[:2], (0, 1, 2, *range(9, 15))),
        (lambda: turned(ekf_config(heading__reset_after_s=5.0), 4.5)[:2], (2,)),
    ],
)
def test_a_reset_is_a_transition_and_noise_of_what_was_set(reset, chosen):
    """So a smoother knows what the reset has discarded: the rest keeps all its covariances."""
    before, after = reset()
    (change,) = after.changes
    noise = change.covariance - change.transition @ before.covariance @ change.transition.T
    np.testing.assert_array_equal(change.covariance, after.covariance)
    others = [k for k in range(len(noise)) if k not in chosen]
    scale = np.sqrt(np.diag(after.covariance))
    np.testing.assert_allclose((noise / np.outer(scale, scale))[others], 0.0, atol=1e-12)
    assert (np.linalg.eigvalsh(noise[np.ix_(chosen, chosen)]) > 0).all()
