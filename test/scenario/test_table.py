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
"""Every row of the table, on a flight through the estimator's one door; the table's own judge."""

from __future__ import annotations

import numpy as np
import pytest
from flights import config_for
from scenario.runs import FLIGHTS, Run, faulty, run, sizes
from scenario.table import TABLE, Row

from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import smoothed
from tirgeo_ros.core.navigation.timeline.imu_checks import Clipping
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.core.types.verdicts import FilterState


@pytest.mark.slow
@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_row(row: Row):
    flown = FLIGHTS[row.flight]()
    done = run(flown, faulty(flown, row.fault, row.start_s, row.end_s))
    assert complaints(row, done) == []


@pytest.mark.slow
def test_no_fault_is_taken_for_clipping():
    for row in TABLE:
        flown = FLIGHTS[row.flight]()
        clipping = Clipping()
        for delivery in faulty(flown, row.fault, row.start_s, row.end_s):
            if isinstance(delivery.sample, ImuSample) and not fault_of(delivery.sample):
                clipping.add(delivery.sample)
        assert clipping.counts == {}, row.name


#: What good data give, and a fault must leave behind.
GOOD_DEG, GOOD_M, RECOVERY_S = 0.3, 0.05, 5.0
_IMU_HZ = 100.0


def complaints(row: Row, done: Run) -> list[str]:
    """All that a run does that its row does not allow."""
    result = [*_numbers(done), *_states(row, done)]
    if done.published:
        result += [*_bounds(row, done), *_honesty(row, done), *_recovery(row, done)]
    return result


def _numbers(done: Run) -> list[str]:
    """What no filter may ever publish."""
    result = [f"published at {s.stamp_ns}, which never was" for s in done.astray]
    for solution in done.published:
        place = (solution.latitude_rad, solution.longitude_rad, solution.height_m)
        values = [place, solution.velocity_n, solution.q_nb, solution.angular_rate_b]
        values.append(solution.rate_variance_b)
        if not all(np.isfinite(value).all() for value in values):
            result.append(f"not finite at {solution.stamp_ns}")
    covariances = np.array([s.covariance for s in done.published]).reshape(-1, 9, 9)
    if not np.isfinite(covariances).all():
        return [*result, "covariance not finite"]
    sigma = np.sqrt(np.abs(np.einsum("nii->ni", covariances)))
    # Of the correlations, for metres and radians do not compare.
    least = np.linalg.eigvalsh(covariances / sigma[:, :, None] / sigma[:, None, :])[:, 0]
    if (least < 0).any():
        result.append(f"covariance not positive: {least.min():.1e}")
    return result


def _states(row: Row, done: Run) -> list[str]:
    states = done.states_from(row.start_s)
    result = []
    if states != row.states:
        result.append(f"states {', '.join(s.value for s in states)}")
    if any(state is FilterState.LOST for _, state in done.changes):
        result.append("lost")
    if done.resets != row.resets:
        result.append(f"{done.resets} resets: {done.status.last_reset}")
    return result


def _bounds(row: Row, done: Run) -> list[str]:
    inside = (done.errors.t_s >= row.start_s) & (done.errors.t_s < row.end_s + RECOVERY_S)
    limits = (row.bounds.heading_deg, row.bounds.tilt_deg, row.bounds.position_m)
    return _beyond(done, inside, limits, "meanwhile")


def _recovery(row: Row, done: Run) -> list[str]:
    """Good again ``recovery_s`` after the fault, and published without a break from then on."""
    since_s = row.end_s + RECOVERY_S
    after = done.errors.t_s >= since_s
    result = _beyond(done, after, (GOOD_DEG, GOOD_DEG, GOOD_M), "afterwards")
    if since_s < done.flown_s and np.count_nonzero(after) < (done.flown_s - since_s) * _IMU_HZ:
        result.append(f"{np.count_nonzero(after)} solutions in {done.flown_s - since_s:.1f} s")
    return result


def _beyond(
    done: Run, where: np.ndarray, limits: tuple[float, float, float], when: str
) -> list[str]:
    names = ("heading deg", "tilt deg", "position m")
    result = []
    for name, values, limit in zip(names, sizes(done), limits, strict=True):
        worst = values[where].max(initial=0.0)
        if worst > limit:
            at_s = done.errors.t_s[where][values[where].argmax()]
            result.append(f"{when}: {name} {worst:.3g} > {limit:g} at {at_s:.2f} s")
    return result


def _honesty(row: Row, done: Run) -> list[str]:
    """No error that the filter's own sigma calls impossible: no line is drawn where none is."""
    ratios = np.abs(done.errors.state / done.errors.sigma)
    if ratios.max() <= row.bounds.sigmas:
        return []
    at, state = np.unravel_index(ratios.argmax(), ratios.shape)
    name = f"{('position', 'attitude', 'velocity')[state // 3]} {'NED'[state % 3]}"
    return [f"{name}: {ratios.max():.1f} sigmas at {done.errors.t_s[at]:.2f} s"]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_row_smoothed(row: Row):
    flown = FLIGHTS[row.flight]()
    fed = list(faulty(flown, row.fault, row.start_s, row.end_s))
    config, samples = config_for(flown), [delivery.sample for delivery in fed]
    steps, smooth = (
        [navigation.process(sample) for sample in samples]
        for navigation in (Navigation(config), smoothed(config, samples))
    )
    assert [step.verdict for step in smooth] == [step.verdict for step in steps]
    for item, other in zip(steps, smooth, strict=True):
        assert (item.solution is None) == (other.solution is None)
        if other.solution is not None:
            assert item.solution.stamp_ns == other.solution.stamp_ns
            check_smoothed(other.solution)


def check_smoothed(solution):
    """Finite, a unit quaternion, a covariance that is positive."""
    numbers = np.concatenate([np.ravel(part) for part in solution[1:]])
    assert np.isfinite(numbers).all()
    assert np.linalg.norm(solution.q_nb) == pytest.approx(1.0, abs=1e-12)
    sigma = np.sqrt(solution.covariance.diagonal())
    assert np.linalg.eigvalsh(solution.covariance / np.outer(sigma, sigma))[0] > 0
