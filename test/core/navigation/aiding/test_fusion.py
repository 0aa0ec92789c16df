"""Fusion: median, gate, floors, what the receivers' errors take, and positions eased in."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from filter_states import LEVEL as HOVER
from filter_states import (
    LEVER_B,
    MEASURED,
    NOW_NS,
    ZERO,
    antenna_fix,
    armed_config,
    belief_of,
    ekf_config,
    fix,
    ns,
    state_of,
    used_at,
    velocity,
)
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid_status import AidTrack
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.gnss_position import innovation_n
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate, floored
from tirgeo_ros.core.navigation.ins_error_model import states_of
from tirgeo_ros.core.navigation.strapdown import rotate
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample, Source
from tirgeo_ros.core.types.verdicts import Outcome

LEVEL = state_of(0.0, 0.0, 0.0)
GOOD = ((0.01, 0.0, -0.01), (-0.01, 0.01, 0.0))


def fused_position(config: dict, shift: np.ndarray, offsets: tuple = ()):
    belief = belief_of(LEVEL, covariance=0.01 * np.eye(18))
    belief = belief._replace(control=belief.control._replace(offsets_n=offsets))
    return belief, Fusion(armed_config(**config)).fuse(antenna_fix(LEVEL, shift), belief, ZERO)


def test_direct_position_is_the_rtk_position():
    """Section 3.3: after the cycle the antenna stands where RTK says, whatever the gain."""
    shift = np.array([0.1, -0.2, 0.3])
    before, fused = fused_position({"position_update": "rtk_direct"}, shift)
    assert fused.verdict.used
    sample = antenna_fix(before.state, shift)
    lever_n = rotate(rotation_of(before.state.q_nb), tuple(LEVER_B))
    assert innovation_n(fused.belief.state, sample, lever_n) == pytest.approx(ZERO, abs=2e-6)
    turned = rotate(rotation_of(fused.belief.state.q_nb), tuple(LEVER_B))
    moved_m = innovation_n(fused.belief.state, sample, turned)
    assert np.abs(moved_m).max() < 0.1  # the lever arm turned with the attitude that was kept


@pytest.mark.parametrize("before", [GOOD, (*GOOD, ZERO)])
def test_median_filter_ignores_one_jump(before):
    """Window of three: the middle of two good offsets and the jump is a good one."""
    shift = np.array([0.0, 5.0, 0.0])
    _, fused = fused_position({"rtk__median_window": 3}, shift, before)
    assert fused.verdict.used
    middle = np.sort([*before[-2:], shift], axis=0)[1]
    assert fused.verdict.innovation == pytest.approx(middle, abs=2e-6)
    assert fused.belief.control.offsets_n[:2] == before[-2:]
    assert fused.belief.control.offsets_n[2] == pytest.approx(shift, abs=2e-6)


def test_velocity_enters_with_its_floor():
    sample = replace(velocity(0.0, (3.5, -1.0, 0.2), variance=0.0), stamp_ns=NOW_NS)
    covariance = np.diag(np.r_[np.zeros(3), np.full(3, 4e-4), np.zeros(12)])
    fused = Fusion(MEASURED).fuse(sample, belief_of(LEVEL, covariance=covariance), ZERO)
    # Variance 0.02^2 against the floor 0.02^2: half of the 0.5 m/s, but that is 17 sigma: refused.
    assert fused.verdict.outcome is Outcome.GATED
    near = LEVEL._replace(velocity_n=(3.45, -1.0, 0.2))
    fused = Fusion(MEASURED).fuse(sample, belief_of(near, covariance=covariance), ZERO)
    assert fused.belief.state.velocity_n[0] == pytest.approx(3.475, abs=1e-9)


def test_gps_error_takes_what_the_state_does_not():
    """Where the position is known, a GPS position says what the receiver is off."""
    covariance = np.diag(np.r_[np.zeros(6), np.full(3, 1e-4), np.zeros(6), np.full(3, 4.0)])
    belief = belief_of(LEVEL, covariance=covariance)
    sample = antenna_fix(LEVEL, np.array([1.0, -2.0, 3.0]), Source.GPS_POSITION)
    sample = replace(sample, covariance_n=np.zeros((3, 3)))
    fused = Fusion(armed_config(gps__position_noise_m=0.05)).fuse(sample, belief, ZERO)
    assert fused.verdict.used
    # Shares of the innovation: 4 and 1e-4 of 4 + 1e-4 + 0.05^2.
    shift = np.array([1.0, -2.0, 3.0]) / (4 + 1e-4 + 0.05**2)
    assert fused.belief.control.receivers.gps_error_n == pytest.approx(4 * shift, abs=2e-6)
    moved = np.subtract(fused.belief.state.correction_n, belief.state.correction_n)
    assert moved == pytest.approx(1e-4 * shift, abs=2e-9)


@pytest.mark.parametrize(("sigma_deg", "states"), [(0.0, 18), (2.0, 19)])
def test_heading_error_is_learned_only_where_there_is_such_a_state(sigma_deg, states):
    config = ekf_config(heading__bias_sigma_deg=sigma_deg)
    assert states_of(config) == states
    covariance = np.zeros((states, states))
    covariance[-1, -1] = math.radians(sigma_deg) ** 2
    covariance[2, 2] = math.radians(1.0) ** 2
    sample = HeadingSample(NOW_NS, math.radians(3.0), math.radians(0.6) ** 2)
    fused = Fusion(config).fuse(sample, belief_of(LEVEL, covariance=covariance), ZERO)
    found = math.degrees(fused.belief.control.receivers.heading_error_rad)
    expected = 3.0 * sigma_deg**2 / (4 + 1 + 0.36)
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("variances", "expected"),
    [
        ([4e-4, 1e-6, 1e-2], [4e-4, 1e-4, 1e-2]),
        ([0, 0, 0], [1e-4] * 3),
        ([-1, 1, 1], [1e-4, 1, 1]),
    ],
)
def test_floor_of_a_covariance(variances, expected):
    assert np.diag(floored(np.diag(variances).astype(float), 0.01)) == pytest.approx(expected)


@given(st.lists(st.floats(1e-6, 1.0), min_size=3, max_size=3), st.floats(-0.99, 0.99))
def test_floor_only_adds(variances, correlation):
    covariance = np.diag(variances)
    covariance[0, 1] = covariance[1, 0] = correlation * math.sqrt(variances[0] * variances[1])
    found = floored(covariance, 0.1)
    assert (np.diag(found) >= 0.01 * (1 - 1e-12)).all()
    assert np.linalg.eigvalsh(found - covariance)[0] >= -1e-15
    assert found[0, 1] == covariance[0, 1]


# Positions that come back after a silence


def drifted(sigma_m: float = 1.0) -> StateEstimate:
    """After an outage: the position is known to a metre, RTK was used 12 s ago."""
    control = used_at({Source.RTK_POSITION: ns(0)}, FixStatus.FIXED)
    covariance = 1e-4 * np.eye(18)
    covariance[2, 2] = math.radians(0.1) ** 2
    covariance[6:9, 6:9] = sigma_m**2 * np.eye(3)
    return StateEstimate(HOVER, covariance, control)


def test_position_comes_back_in_equal_steps():
    fusion, belief = Fusion(MEASURED), drifted()
    places, sigmas = [], []
    for k in range(6):
        found = fusion.fuse(fix(12.0 + 0.2 * k, (0.8, 0, 0)), belief, ZERO)
        assert found.verdict.used
        belief = found.belief
        places.append(belief.state.correction_n[0])
        sigmas.append(math.sqrt(belief.covariance[6, 6]))
    # Equal but for the noise's share, 1e-4 of the state's variance, five times.
    assert places[:5] == pytest.approx([0.16, 0.32, 0.48, 0.64, 0.8], abs=5 * 1e-3 * 0.8)
    assert places[5] == pytest.approx(0.8, abs=0.01)
    # What is left to go is never more than the covariance says: 0.8 m was 0.8 sigma.
    left = 0.8 - np.array(places)
    assert (left[:5] <= 1.01 * np.array(sigmas[:5])).all()
    assert sigmas == sorted(sigmas, reverse=True)
    # The fifth is taken in full, and the sixth: of two fixes of a centimetre each.
    assert sigmas[5] == pytest.approx(0.01 / math.sqrt(2), rel=1e-3)


def test_position_that_was_used_lately_is_not_eased():
    belief = drifted()
    control = belief.control.with_track(Source.RTK_POSITION, AidTrack(ns(11.5)))
    control = control.heard(FixStatus.FIXED, ns(11.5), ns(12) - ns(0))
    found = Fusion(MEASURED).fuse(fix(12.0, (0.8, 0, 0)), belief._replace(control=control), ZERO)
    assert found.belief.state.correction_n[0] == pytest.approx(0.8, abs=1e-3)


def test_covariance_of_an_eased_position_is_honest():
    """Monte Carlo: error over sigma, at most one on the way and one at its end."""
    rng = np.random.default_rng(5)
    ratios = []
    for _ in range(300):
        belief, fusion = drifted(1.0), Fusion(MEASURED)
        truth = rng.normal()
        for k in range(6):
            sample = fix(12.0 + 0.2 * k, (truth + 0.01 * rng.normal(), 0, 0))
            belief = fusion.fuse(sample, belief, ZERO).belief
            left = truth - belief.state.correction_n[0]
            ratios.append(left / math.sqrt(belief.covariance[6, 6]))
    found = np.sqrt(np.mean(np.square(np.reshape(ratios, (-1, 6))), axis=0))
    # 300 draws: 4 % one sigma. On the way it is on the safe side: each fix says more than it may.
    assert (found < 1.16).all()
    assert found[5] == pytest.approx(1.0, abs=0.16)


def test_float_positions_weigh_what_their_slow_error_leaves():
    """Monte Carlo over minutes: a Gauss-Markov error of the float, and the sigma after it.

    The state stands still with a random walk of its own, as an inertial position does.
    """
    config = MEASURED
    sigma_m, time_s = config.rtk.float_sigma_m, config.rtk.float_time_s
    rng, step_s, walk = np.random.default_rng(6), 0.2, 0.05
    ratios = []
    for _ in range(20):
        belief, fusion = drifted(0.01), Fusion(config)
        truth = 0.01 * rng.normal()
        error = sigma_m * rng.normal()
        keep = math.exp(-step_s / time_s)
        for k in range(200):
            covariance = belief.covariance.copy()
            covariance[6, 6] += walk**2 * step_s
            belief = belief._replace(covariance=covariance)
            truth += walk * math.sqrt(step_s) * rng.normal()
            error = keep * error + sigma_m * math.sqrt(1 - keep**2) * rng.normal()
            sample = fix(0.2 * (k + 1), (truth + error, 0, 0), status=FixStatus.FLOAT)
            belief = fusion.fuse(sample, belief, ZERO).belief
            if k >= 50:
                left = truth - belief.state.correction_n[0]
                ratios.append(left / math.sqrt(belief.covariance[6, 6]))
    # White noise of the same power over long times is what a slow state sees: the estimate of
    # a state that walks as fast as the error is not far from honest on either side.
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4
