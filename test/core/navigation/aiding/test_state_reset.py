"""Setting a state to measurements that contradict it: what is set, and how certain it is then."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import euler_from_quat, quat_from_euler, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack, Receivers
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.ins_error_model import GPS_ERROR, POSITION, states_of
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import Outcome

SECOND_NS = 1_000_000_000
HOME = (0.695, 2.04, 31.5)
START = NavState(
    tuple(quat_from_euler(0.05, -0.03, 0.4).tolist()),
    (3.0, -1.0, 0.2),
    *HOME,
    (1e-4, -2e-4, 3e-4),
    (0.01, 0.02, -0.03),
    (0.0,) * 3,
)


def ns(seconds: float) -> int:
    return 1000 * SECOND_NS + round(seconds * SECOND_NS)


def config_of(**values) -> EkfConfig:
    given = {key.replace("__", "."): v for key, v in values.items()}
    return config_from(EkfConfig, {"aircraft.rtk_antenna_sigma_m": (0.0, 0.0, 0.0)} | given)


def correlated(states: int, seed: int = 3) -> np.ndarray:
    """A covariance with ties between all states, small enough that jumps are refused."""
    scales = np.r_[[2e-3] * 3, [0.03] * 3, [0.02] * 3, [1e-4] * 3, [5e-3] * 3, [0.5] * 3, [0.01]]
    root = np.random.default_rng(seed).normal(size=(states, 2 * states)) / math.sqrt(2 * states)
    root *= scales[:states, None]
    return root @ root.T


def belief_of(states: int = 18, *, rtk: bool = True, covariance=None) -> StateEstimate:
    control = AidStatus(Receivers(ns(0))).heard(FixStatus.FIXED, ns(-5), SECOND_NS)
    if rtk:
        for source in (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING):
            control = control.with_track(source, AidTrack(ns(0)))
    covariance = correlated(states) if covariance is None else covariance
    return StateEstimate(START, covariance, control)


def position(t_s, shift_n, source=Source.RTK_POSITION, status=FixStatus.FIXED):
    lat, lon, height = (float(x) for x in TangentPlane(*HOME).geodetic_from_ned(shift_n))
    noise = np.diag([1e-4, 1e-4, 4e-4]) if source is Source.RTK_POSITION else np.zeros((3, 3))
    return PositionSample(ns(t_s), source, status, lat, lon, height, noise)


def again_and_again(config, belief, make, seconds, rate_hz=5.0, frozen=True):
    """Verdicts on samples that all say the same; the belief before the last and after it.

    The state does not move in between (``make(t_s)`` gives a sample for a state that stands).
    """
    fusion, outcomes, before = Fusion(config), [], belief
    for k in range(round(seconds * rate_hz) + 1):
        before = belief
        fused = fusion.fuse(make(k / rate_hz), belief, (0.0, 0.0, 0.0))
        outcomes.append(fused.verdict)
        belief = fused.belief
    return outcomes, before, belief


def assert_covariance(covariance):
    np.testing.assert_array_equal(covariance, covariance.T)
    scales = np.sqrt(np.diag(covariance))
    assert np.linalg.eigvalsh(covariance / np.outer(scales, scales))[0] > -1e-12


def test_position_is_set_where_it_is_measured():
    shift = np.array([3.0, -4.0, 1.0])
    config = config_of(rtk__reset_after_s=2.0)
    outcomes, before, after = again_and_again(
        config, belief_of(), lambda t_s: position(t_s, shift), 2.0
    )
    assert [v.outcome for v in outcomes] == [Outcome.GATED] * 10 + [Outcome.RESET]
    assert outcomes[-1].reason == "position moved by 5.10 m"
    assert after.state.correction_n == pytest.approx(tuple(shift), abs=1e-5)
    np.testing.assert_allclose(after.covariance[POSITION, POSITION], np.diag([1e-4, 1e-4, 4e-4]))
    # Nothing else is touched: the other states, and what they know of each other.
    assert after.state.q_nb == pytest.approx(START.q_nb, abs=1e-15)
    assert after.state.velocity_n == START.velocity_n
    others = np.r_[0:6, 9:15]
    chosen = np.ix_(others, others)
    np.testing.assert_array_equal(after.covariance[chosen], before.covariance[chosen])
    assert_covariance(after.covariance)
    assert after.control.resets[0] == sum(after.control.resets) == 1


def test_position_reset_lets_the_gps_stand():
    """What it was off by is reckoned against the position that was wrong."""
    belief = belief_of()
    receivers = Receivers(ns(0), (0.5, -0.2, 2.0))
    belief = belief._replace(control=belief.control._replace(receivers=receivers))
    shift = np.array([3.0, -4.0, 1.0])
    _, _, after = again_and_again(config_of(), belief, lambda t_s: position(t_s, shift), 2.0)
    found = after.control.receivers.gps_error_n
    assert found == pytest.approx((0.5 - 3.0, -0.2 + 4.0, 2.0 - 1.0), abs=0.15)  # 2 s of 45 fade


@pytest.mark.parametrize("seconds", [1.8])
def test_short_runs_do_not_set_it(seconds):
    shift = np.array([3.0, -4.0, 1.0])
    outcomes, _, after = again_and_again(
        config_of(rtk__reset_after_s=2.0), belief_of(), lambda t: position(t, shift), seconds
    )
    assert {v.outcome for v in outcomes} == {Outcome.GATED}
    assert after.state is START


def test_positions_that_do_not_agree_do_not_set_it():
    def wandering(t_s):
        return position(t_s, np.array([3.0 + 4.0 * (round(5 * t_s) % 2), 0.0, 0.0]))

    outcomes, _, after = again_and_again(config_of(), belief_of(), wandering, 20.0)
    assert {v.outcome for v in outcomes} == {Outcome.GATED}
    assert after.state is START


def velocity(t_s, change, source=Source.RTK_VELOCITY):
    return VelocitySample(ns(t_s), source, np.add(START.velocity_n, change), 4e-4 * np.eye(3))


def test_velocity_is_not_set_while_positions_fit():
    """Positions that fit say that the velocity does too."""
    belief = belief_of()

    def both(t_s):
        return velocity(t_s, (2.0, 0.0, 0.0))

    fusion = Fusion(config_of())
    for k in range(100):
        control = belief.control.with_track(Source.RTK_POSITION, AidTrack(ns(0.2 * k)))
        belief = belief._replace(control=control)
        fused = fusion.fuse(both(0.2 * k), belief, (0.0,) * 3)
        assert fused.verdict.outcome is Outcome.GATED
        belief = fused.belief
    assert belief.state is START


@pytest.mark.parametrize("source", [Source.RTK_VELOCITY, Source.GPS_VELOCITY])
def test_velocity_is_set_without_positions(source):
    belief = belief_of(rtk=False)
    outcomes, _, after = again_and_again(
        config_of(), belief, lambda t_s: velocity(t_s, (2.0, 0.0, 0.0), source), 2.0
    )
    assert outcomes[-1].outcome is Outcome.RESET
    assert after.state.velocity_n == pytest.approx((5.0, -1.0, 0.2), abs=1e-12)
    assert_covariance(after.covariance)


# The ordinary GPS


def gps(t_s, shift=(0.0, 0.0, 30.0)):
    return position(t_s, np.array(shift), Source.GPS_POSITION, FixStatus.SINGLE)


def test_gps_reset_changes_its_error_and_nothing_else():
    outcomes, _, after = again_and_again(config_of(), belief_of(rtk=False), gps, 2.0)
    assert outcomes[-1].outcome is Outcome.RESET
    assert after.state is START
    assert after.control.receivers.gps_error_n == pytest.approx((0.0, 0.0, 30.0), abs=1e-5)
    assert_covariance(after.covariance)


def test_gps_reset_says_nothing_of_the_position():
    """Position and GPS error together are measured, neither of them alone."""
    covariance = correlated(18)
    covariance[POSITION, POSITION] += 4.0 * np.eye(3)
    belief = belief_of(rtk=False, covariance=covariance)
    outcomes, before, after = again_and_again(
        config_of(), belief, lambda t_s: gps(t_s, (0.0, 0.0, 60.0)), 2.0
    )
    assert outcomes[-1].outcome is Outcome.RESET
    position_m2 = np.diag(before.covariance)[POSITION]
    np.testing.assert_array_equal(np.diag(after.covariance)[POSITION], position_m2)
    # A second one measures the same once more: it finds the sum to the noise of both, no more.
    again = Fusion(config_of()).fuse(gps(2.2, (0.0, 0.0, 60.0)), after, (0.0,) * 3)
    assert again.verdict.used
    left_m2 = np.diag(again.belief.covariance)[POSITION]
    # Of the fix's noise of 0.05 m a part of 1e-3 of the 4 m2 may go to either.
    np.testing.assert_allclose(left_m2, position_m2, rtol=5e-3)
    sums = (
        again.belief.covariance[POSITION, POSITION]
        + 2 * again.belief.covariance[POSITION, GPS_ERROR]
        + again.belief.covariance[GPS_ERROR, GPS_ERROR]
    )
    assert np.diag(sums) == pytest.approx([0.05**2 / 2] * 3, rel=0.01)


# Headings


def heading(t_s, turn_deg):
    yaw = float(euler_from_quat(np.array(START.q_nb))[2])
    return HeadingSample(ns(t_s), yaw + math.radians(turn_deg), math.radians(0.6) ** 2)


def turned(config, degrees, belief=None):
    """The beliefs before and after the reset to headings that are off, and when it came."""
    fusion, belief = Fusion(config), belief_of() if belief is None else belief
    q_nb = quat_multiply(quat_from_euler(0.0, 0.0, math.radians(degrees)), np.array(START.q_nb))
    for k in range(400):
        t_s = 0.2 * k
        control = belief.control.heard(FixStatus.FIXED, ns(t_s), SECOND_NS)
        before = belief._replace(control=control)
        # The autopilot has turned as well: it is the state that is wrong.
        fused = fusion.fuse(heading(t_s, degrees), before, (0.0,) * 3, autopilot_q_nb=q_nb)
        belief = fused.belief
        if fused.verdict.outcome is Outcome.RESET:
            return before, belief, t_s
        assert not fused.verdict.used
    raise AssertionError("no reset")


@pytest.mark.parametrize("degrees", [20.0, -90.0, 179.0])
def test_attitude_turns_about_the_vertical(degrees):
    before, after, _ = turned(config_of(), degrees)
    roll, pitch, yaw = euler_from_quat(np.array(after.state.q_nb))
    was = euler_from_quat(np.array(START.q_nb))
    assert (roll, pitch) == pytest.approx(was[:2], abs=1e-12)
    # The nose is the baseline; it is not level, so its azimuth is the yaw.
    assert math.remainder(yaw - was[2] - math.radians(degrees), 2 * math.pi) == pytest.approx(
        0.0, abs=1e-12
    )
    assert after.covariance[2, 2] == pytest.approx(math.radians(0.6) ** 2)
    # A start so wrong has spoiled what was estimated with it.
    assert after.state.gyro_bias_b == after.state.accel_bias_b == (0.0,) * 3
    turn_on = EkfConfig().imu.gyro_turn_on_bias
    assert after.covariance[9, 9] == pytest.approx(turn_on**2, rel=1e-3)
    assert after.state.velocity_n == before.state.velocity_n
    assert_covariance(after.covariance)


def test_a_small_turn_keeps_the_biases():
    before, after, t_s = turned(config_of(heading__reset_after_s=5.0), 4.5)
    assert t_s >= 5.0
    assert after.state.gyro_bias_b == START.gyro_bias_b
    np.testing.assert_array_equal(after.covariance[9:15, 9:15], before.covariance[9:15, 9:15])
    assert_covariance(after.covariance)


@pytest.mark.parametrize(("degrees", "error_sigma_deg"), [(4.5, 0.3), (52.0, 2.0)])
def test_heading_reset_with_an_error_state(degrees, error_sigma_deg):
    """Heading and the receiver's error together are measured, neither of them alone."""
    config = config_of(heading__bias_sigma_deg=error_sigma_deg)
    error_rad2, noise_rad2 = math.radians(error_sigma_deg) ** 2, math.radians(0.6) ** 2
    belief = belief_of(states_of(config))
    covariance = belief.covariance.copy()
    covariance[-1, :] = covariance[:, -1] = 0.0
    covariance[-1, -1] = error_rad2
    _, belief, t_s = turned(config, degrees, belief._replace(covariance=covariance))
    found = belief.covariance
    assert found[2, 2] == pytest.approx(noise_rad2 + error_rad2, rel=1e-6)
    assert found[2, -1] == pytest.approx(-error_rad2, rel=1e-6)
    assert_covariance(found)
    again = Fusion(config).fuse(heading(t_s + 0.2, degrees), belief, (0.0,) * 3)
    assert again.verdict.used
    # A second one halves the noise; what is the receiver's error stays unknown.
    expected = noise_rad2 / 2 + error_rad2
    assert again.belief.covariance[2, 2] == pytest.approx(expected, rel=0.02)
