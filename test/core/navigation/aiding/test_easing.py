"""Positions that come back after a silence, and the honesty of what they leave."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filter_states import LEVEL, MEASURED, ZERO, fix, ns, used_at

from tirgeo_ros.core.navigation.aiding.aid_status import AidTrack
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.types.measurements import FixStatus, Source


def drifted(sigma_m: float = 1.0) -> StateEstimate:
    """After an outage: the position is known to a metre, RTK was used 12 s ago."""
    control = used_at({Source.RTK_POSITION: ns(0)}, FixStatus.FIXED)
    covariance = 1e-4 * np.eye(18)
    covariance[2, 2] = math.radians(0.1) ** 2
    covariance[6:9, 6:9] = sigma_m**2 * np.eye(3)
    return StateEstimate(LEVEL, covariance, control)


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
