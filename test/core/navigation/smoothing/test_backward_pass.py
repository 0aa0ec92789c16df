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
"""The smoother on linear systems with Gaussian noise, against the joint distribution of all."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.navigation.ins.kalman import Change, Measurement, cut, update
from tirgeo_ros.core.navigation.smoothing import smoothed_navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import BackwardPass
from tirgeo_ros.core.navigation.timeline.flight_record import FlightRecord

STATES = 5
#: Two solutions of 300 linear equations in doubles; their condition is below 1e5.
TOLERANCE = 1e-9
NO_GATE = 1e9


class LinearFilter:
    """A Kalman filter that feeds its errors back, and the joint distribution of all states."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        root = self.rng.normal(size=(STATES, STATES))
        self.covariance = root @ root.T
        self.estimate = self.rng.normal(size=STATES)
        self.record = FlightRecord(STATES)
        self.record.add(Change(self.covariance))
        self.estimates = [self.estimate]
        self.mean, self.joint = self.estimate.copy(), self.covariance.copy()
        self.places = [0]  # where in the joint vector the state after each change begins
        self.measurements = []  # place, H, R, value

    def changed(self, change):
        self.covariance = change.covariance
        self.record.add(change)
        self.estimates.append(self.estimate)

    def moved(self, transition, noise, offset=0.0):
        """The next state is ``transition`` times this one, plus an offset, plus noise."""
        old = slice(self.places[-1], self.places[-1] + STATES)
        cross = transition @ self.joint[old]
        corner = transition @ self.joint[old, old] @ transition.T + noise
        self.places.append(len(self.mean))
        self.mean = np.concatenate([self.mean, transition @ self.mean[old] + offset])
        self.joint = np.block([[self.joint, cross.T], [cross, corner]])
        self.estimate = transition @ self.estimate + offset
        return transition @ self.covariance @ transition.T + noise

    def propagate(self):
        transition = np.eye(STATES) + 0.3 * self.rng.normal(size=(STATES, STATES))
        noise = np.diag(self.rng.uniform(0.0, 0.2, STATES))
        covariance = self.moved(transition, noise)
        self.changed(Change(covariance, transition, step_s=0.1))

    def correct(self, rows, ease=0.0):
        design = self.rng.normal(size=(rows, STATES))
        noise = np.diag(self.rng.uniform(0.1, 1.0, rows))
        value = self.rng.normal(size=rows)
        innovation = value - design @ self.estimate
        result = update(self.covariance, Measurement(innovation, design, noise, NO_GATE, ease))
        self.measurements.append((self.places[-1], design, noise + ease * result.predicted, value))
        self.places.append(self.places[-1])
        self.estimate = self.estimate + result.error
        self.changed(Change(result.covariance, correction=result.correction))

    def reset(self, block):
        """Set some states to a value, with a noise of its own."""
        offset, noise = np.zeros(STATES), np.zeros((STATES, STATES))
        offset[block], noise[block, block] = self.rng.normal(size=3), 0.5 * np.eye(3)
        transition = cut(STATES, block)
        covariance = self.moved(transition, noise, offset)
        self.changed(Change(covariance, transition))

    def doubt(self):
        """Make a state more uncertain."""
        noise = np.diag([0.0, 2.0, 0.0, 0.0, 0.0])
        self.changed(Change(self.moved(np.eye(STATES), noise)))

    def conditioned(self):
        """Means (changes, n) and covariances (changes, n, n), given every measurement."""
        rows = sum(len(value) for *_, value in self.measurements)
        design, noise = np.zeros((rows, len(self.mean))), np.zeros((rows, rows))
        at = 0
        for place, h, r, value in self.measurements:
            design[at : at + len(value), place : place + STATES] = h
            noise[at : at + len(value), at : at + len(value)] = r
            at += len(value)
        values = np.concatenate([value for *_, value in self.measurements])
        gain = np.linalg.solve(design @ self.joint @ design.T + noise, design @ self.joint).T
        mean = self.mean + gain @ (values - design @ self.mean)
        joint = self.joint - gain @ design @ self.joint
        parts = [slice(place, place + STATES) for place in self.places]
        return np.array([mean[p] for p in parts]), np.array([joint[p, p] for p in parts])


def flown(seed, steps=20):
    """Propagations and updates of one to three rows, some eased; a reset and a doubt inside."""
    result = LinearFilter(seed)
    for step in range(steps):
        result.propagate()
        if step % 3 != 1:
            result.correct(1 + step % 3, ease=2.0 * (step == 5))
        if step == 8:
            result.reset(slice(1, 4))
        if step == 12:
            result.doubt()
            result.correct(2)
    return result


def square(record, lower):
    full = np.zeros((len(lower), STATES, STATES))
    full[:, record.lower[0], record.lower[1]] = lower
    full[:, record.lower[1], record.lower[0]] = lower
    return full


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("block", [4096, 7])
def test_the_smoother_gives_mean_and_covariance_under_all_measurements(seed, block, monkeypatch):
    monkeypatch.setattr(smoothed_navigation, "_BLOCK", block)
    result = flown(seed)
    mean, covariance = result.conditioned()
    errors = BackwardPass(result.record).smoothed()
    np.testing.assert_allclose(result.estimates + errors, mean, atol=TOLERANCE)
    smoothed = square(result.record, result.record.covariances)
    np.testing.assert_allclose(smoothed, covariance, atol=TOLERANCE)
    # The last one is the filter's, of whose covariance one triangle is stored.
    assert (errors[-1] == 0).all()
    np.testing.assert_allclose(smoothed[-1], result.covariance, atol=1e-15)


@pytest.mark.parametrize("variance", [np.nan, -1e-9])
def test_an_impossible_covariance_is_left_out(variance):
    """The record of a lost filter is smoothed as if it ended where the filter was lost."""
    sound, lost = flown(1), flown(1)
    nothing = np.full((STATES, STATES), variance)
    lost.record.add(Change(nothing, nothing))
    errors = BackwardPass(lost.record).smoothed()
    np.testing.assert_array_equal(
        errors, [*BackwardPass(sound.record).smoothed(), np.zeros(STATES)]
    )
    np.testing.assert_array_equal(lost.record.covariances[:-1], sound.record.covariances)
