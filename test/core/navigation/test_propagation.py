"""Beliefs through intervals: the covariance's own rate, parts of an interval, bridged gaps."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from motions import difference, state_at

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, Receivers
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.delayed_measurements import Epoch
from tirgeo_ros.core.navigation.ins_error_model import CovariancePropagation
from tirgeo_ros.core.navigation.propagation import Propagation
from tirgeo_ros.core.navigation.strapdown import propagate
from tirgeo_ros.core.navigation.vibration_noise import VibrationMeter
from tirgeo_ros.core.types.measurements import ImuSample

CONFIG = config_from(EkfConfig, {"aircraft.rtk_antenna_sigma_m": (0.0, 0.0, 0.0)})
START = state_at(0.695, 2.04, 31.5, (3.0, -1.0, 0.2), (0.05, -0.03, 0.4))
SIGMAS = np.r_[[2e-3] * 3, [0.03] * 3, [0.02] * 3, [3e-4] * 3, [5e-3] * 3, [0.5] * 3]


def belief(state=START, states=18) -> StateEstimate:
    sigmas = np.r_[SIGMAS, 0.02][:states]
    return StateEstimate(state, np.diag(sigmas**2), AidStatus(Receivers(0)))


def turning(t_s):
    """Readings of an aircraft that rolls, brakes and turns."""
    force = np.array(
        [1.5 * math.sin(3 * t_s), 1.0 * math.cos(2 * t_s), -9.8 + 0.5 * math.sin(t_s)]
    )
    rate = np.array([0.5 * math.cos(4 * t_s), 0.3 * math.sin(3 * t_s), 0.6 * math.cos(t_s)])
    return force, rate


def epochs_of(stamps_s, readings=turning, first=None):
    first_sample, *samples = (ImuSample(round(t * 1e9), *readings(t)) for t in stamps_s)
    epochs = [Epoch.first(first_sample.stamp_ns, first_sample, first or belief())]
    meter = VibrationMeter()
    for sample in samples:
        epochs.append(Epoch.after(epochs[-1], sample, meter))
    return epochs


def carried_through(epochs):
    """The belief at the last epoch, its covariance too."""
    mechanisation, carried = Propagation(CONFIG), epochs[0].carried
    for start, end in pairwise(epochs):
        start.carried = carried
        carried = mechanisation.whole(carried, start, end)
    return mechanisation.followed(carried)


@pytest.mark.parametrize("rate_hz", [50, 100, 200, 400])
def test_covariance_at_its_own_rate_is_that_of_small_steps(rate_hz):
    """Two seconds of turns, against a covariance that follows at 400 Hz."""
    stamps = np.arange(0, 2.0 + 1e-9, 1 / rate_hz)
    found = carried_through(epochs_of(stamps))
    state, covariance = belief()[:2]
    propagation = CovariancePropagation(CONFIG)
    for k in range(800):
        force, rate = turning((k + 0.5) / 400)
        after, rates = propagate(state, tuple(force), tuple(rate), 1 / 400)
        covariance = propagation.step(covariance, state, rates, rates.specific_force_n, 1 / 400)
        state = after
    sigmas = np.sqrt(np.diag(covariance))
    # Steps of 50 ms in turns of 1 rad/s: of second order, (0.05)^2 / 2 at each quarter turn.
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), sigmas, rtol=5e-3)
    correlations = (found.covariance - covariance) / np.outer(sigmas, sigmas)
    assert np.abs(correlations).max() < 0.02


@pytest.mark.parametrize("cuts_s", [(0.004,), (0.001, 0.0035, 0.0081), (0.01,)])
def test_parts_of_an_interval_are_the_whole(cuts_s):
    """Readings are linear in between, so the way does not matter to second order."""
    epochs = epochs_of([0.0, 0.01])
    mechanisation = Propagation(CONFIG)
    start, end = epochs
    whole = mechanisation.whole(start.carried, start, end)
    carried, now_ns = start.carried, 0
    for cut_s in (*cuts_s, 0.01):
        carried = mechanisation.part(carried, start, end, now_ns, round(cut_s * 1e9))
        now_ns = round(cut_s * 1e9)
    # Third order: 0.01^3 x (2 m/s3 x 1 rad/s) / 12.
    np.testing.assert_allclose(carried.state.velocity_n, whole.state.velocity_n, atol=1e-6)
    np.testing.assert_allclose(carried.state.q_nb, whole.state.q_nb, atol=1e-7)
    assert carried.lag_s == pytest.approx(whole.lag_s, abs=1e-12)


# Gaps


@pytest.mark.parametrize(("gap_s", "bridged"), [(0.02, False), (0.035, False), (0.04, True)])
def test_lost_samples_make_less_certain(gap_s, bridged):
    """One sample of a 50 Hz IMU with jitter is not a loss, two are."""
    found = carried_through(epochs_of([0.0, gap_s]))
    plain = np.diag(belief().covariance)[:3]
    widened = np.diag(found.covariance)[:3] - plain > (0.05 * gap_s) ** 2 * 0.9
    assert widened.all() == bridged


def flown(rng, seconds, rate_hz=400):
    """A manoeuvre drawn at random: sums of sines as the gusts and the pilot make them."""
    times = np.arange(0, seconds + 1e-9, 1 / rate_hz)
    force = np.tile([0.0, 0.0, -9.8], (len(times), 1))
    rate = np.zeros((len(times), 3))
    for hz in (0.3, 0.7, 1.5):
        phase = rng.uniform(0, 2 * math.pi, 6)
        waves = np.sin(2 * math.pi * hz * times[:, None] + phase)
        force += waves[:, :3] * 0.8 * rng.normal(size=3) / (1 + hz)
        rate += waves[:, 3:] * 0.25 * rng.normal(size=3) / (1 + hz)
    return times, force, rate


@pytest.mark.parametrize("gap_s", [0.06, 0.12, 0.2])
def test_monte_carlo_of_lost_samples(gap_s):
    """What the bridge adds covers the errors that it makes: error over sigma at most one."""
    rng = np.random.default_rng(9)
    ratios = []
    for _ in range(60):
        times, force, rate = flown(rng, 0.5)
        begin, end = 40, 40 + round(gap_s * 400)
        truth = START
        for k in range(end):
            if k == begin:
                certain = StateEstimate(truth, np.zeros((18, 18)), AidStatus(Receivers(0)))
            mean = tuple((force[k] + force[k + 1]) / 2), tuple((rate[k] + rate[k + 1]) / 2)
            truth, _ = propagate(truth, *mean, 1 / 400)
        read = {times[k]: (force[k], rate[k]) for k in (begin, end)}
        found = carried_through(epochs_of(read, read.get, certain))
        error = difference(truth, found.state)[:9]
        ratios.append(error / np.sqrt(np.diag(found.covariance)[:9]))
    blocks = np.sqrt(np.mean(np.square(ratios), axis=0)).reshape(3, 3)
    assert (blocks <= 1.1).all()


def test_a_gap_covers_a_clock_that_was_set_forward():
    """Nothing was lost, 0.15 s never were: the state is too far on, and says that it may be."""
    readings = np.array([0.5, 0, -9.8]), np.zeros(3)
    found = carried_through(epochs_of([0.0, 0.15], lambda _: readings))
    moved_m = 0.15 * math.hypot(*START.velocity_n)
    sigma_m = math.sqrt(max(np.diag(found.covariance)[6:9]))
    assert moved_m < 3 * sigma_m
