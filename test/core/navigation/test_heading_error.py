"""A slow error of the headings, estimated where the flight makes it observable."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, errors, flight, navigation_samples

from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.types.measurements import HeadingSample

pytestmark = pytest.mark.slow

SIGMA_DEG = 2.0


@functools.lru_cache(maxsize=16)
def flown_with(error_deg, shape, seed, duration_s=60.0):
    """Errors of the filter, and the estimated error of the headings with its sigma (N, 2)."""
    flown = flight(seed, duration_s, shape)
    config = config_for(flown, heading__bias_sigma_deg=SIGMA_DEG, publish_rate_hz=2.0)
    navigation, found, estimates = Navigation(config), [], []
    for given in navigation_samples(flown):
        sample = given
        if isinstance(given, HeadingSample):
            sample = replace(given, heading_rad=given.heading_rad + math.radians(error_deg))
        solution = navigation.process(sample).solution
        if solution is not None:
            found.append(solution)
            belief = navigation._ekf.belief()
            estimate = belief.control.receivers.heading_error_rad
            estimates.append((estimate, math.sqrt(belief.covariance[18, 18])))
    return errors(flown, found), np.degrees(estimates), navigation.status()


@pytest.mark.parametrize("error_deg", [2.0, -3.0])
def test_found_in_turns(error_deg):
    """Accelerations and RTK velocities tell the heading too."""
    found, estimates, status = flown_with(error_deg, "figure_eight", 61)
    assert status.resets == {}
    estimate, sigma = estimates[-1]
    assert sigma < 0.2 * SIGMA_DEG
    assert estimate == pytest.approx(error_deg, abs=3 * sigma)
    assert np.degrees(np.abs(found.rpy[-20:, 2])).max() < 0.8
    plain_error = np.abs(found.state[-20:, 5] / found.sigma[-20:, 5])
    assert plain_error.max() < 3.0


def test_error_over_sigma_of_heading_and_its_error():
    """Monte Carlo: errors drawn as the parameter says, over three shapes."""
    rng = np.random.default_rng(11)
    headings, estimated = [], []
    for seed in range(9):
        shape = ["figure_eight", "lawnmower", "hover"][seed % 3]
        error_deg = SIGMA_DEG * float(rng.normal())
        found, estimates, _ = flown_with(error_deg, shape, 70 + seed, 30.0)
        late = found.t_s > 5.0
        headings.append(np.mean(np.square(found.state[late, 5] / found.sigma[late, 5])))
        left = (error_deg - estimates[late, 0]) / estimates[late, 1]
        estimated.append(np.mean(np.square(left)))
    # Nine flights, each hardly more than one draw: 24 % one sigma.
    assert 0.5 < math.sqrt(np.mean(headings)) < 1.6
    assert 0.5 < math.sqrt(np.mean(estimated)) < 1.6
