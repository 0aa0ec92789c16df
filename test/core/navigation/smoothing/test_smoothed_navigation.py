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
"""The smoother on simulated flights: the filter's verdicts, and poses from both sides."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from flights import GPS, RTK, config_for, errors, flight, navigation_samples

from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import (
    RecordingNavigation,
    SmoothedNavigation,
    smoothed,
)
from tirgeo_ros.core.types.measurements import ImuSample, PositionSample, Source
from tirgeo_ros.core.types.verdicts import Outcome

LENGTH_S = 22.0
SILENT = (*RTK, *GPS)


def changed(*, lost=(), lost_s=(0.0, 0.0), moved_m=0.0, moved_from_s=1e9):
    """Samples of a flight; ``lost`` sources are missing for a time, RTK's height has a step."""
    flown, result = flight(5, LENGTH_S), []
    for sample in navigation_samples(flown):
        t_s = (sample.stamp_ns - flown.truth.stamp_ns[0]) * 1e-9
        if sample.source in lost and lost_s[0] <= t_s < lost_s[1]:
            continue
        if sample.source is Source.RTK_POSITION and t_s > moved_from_s:
            result.append(replace(sample, height_m=sample.height_m + moved_m))
        else:
            result.append(sample)
    return result


#: Ordinary; without any position, velocity or heading for 6 s; a step of RTK that is followed at
#: last; an IMU that is silent for 2 s, after which the filter aligns anew.
WAYS = {
    "ordinary": {},
    "outage": {"lost": SILENT, "lost_s": (12.0, 18.0)},
    "reset": {"moved_m": 6.0, "moved_from_s": 13.0, "lost": GPS, "lost_s": (0.0, 99.0)},
    "two runs": {"lost": (Source.IMU,), "lost_s": (12.0, 14.0)},
}


def run(navigation, samples):
    return [navigation.process(sample) for sample in samples]


@functools.cache
def both(way, **values):
    """The steps of the filter and the smoother over a flight, and the two estimators."""
    config = config_for(flight(5, LENGTH_S), **values)
    samples = changed(**WAYS[way])
    pair = Navigation(config), smoothed(config, samples)
    return *(run(item, samples) for item in pair), *pair


def solutions(steps):
    return [step.solution for step in steps if step.solution is not None]


@pytest.mark.parametrize("way", WAYS)
def test_verdicts_status_and_plane_are_the_filters(way):
    steps, smooth, navigation, second = both(way)
    assert [step.verdict for step in smooth] == [step.verdict for step in steps]
    stamps = [step.solution and step.solution.stamp_ns for step in steps]
    assert [step.solution and step.solution.stamp_ns for step in smooth] == stamps
    assert second.plane == navigation.plane
    of_filter, of_smoother = navigation.status(), second.status()
    assert of_smoother.counts == of_filter.counts
    assert of_smoother.state is of_filter.state


def test_the_filter_is_not_changed_by_being_recorded():
    steps = both("ordinary")[0]
    recorded = run(RecordingNavigation(config_for(flight(5, LENGTH_S))), changed())
    for item, other in zip(solutions(recorded), solutions(steps), strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(item, other, strict=True))


@pytest.mark.parametrize("way", WAYS)
def test_covariances_are_symmetric_and_positive(way):
    for solution in solutions(both(way)[1]):
        covariance = solution.covariance
        assert np.array_equal(covariance, covariance.T)
        sigma = np.sqrt(covariance.diagonal())
        assert np.linalg.eigvalsh(covariance / np.outer(sigma, sigma))[0] > 0
        assert min(solution.rate_variance_b) > 0


@pytest.mark.parametrize("way", ["ordinary", "reset", "two runs"])
def test_the_last_pose_is_the_filters(way):
    """No measurement follows the last IMU sample; late measurements are in both."""
    navigation, samples = both(way)[2], changed(**WAYS[way])
    last_ns = max(sample.stamp_ns for sample in samples if isinstance(sample, ImuSample))
    result = next(item for item in solutions(both(way)[1]) if item.stamp_ns == last_ns)
    expected = navigation._ekf.solution()
    assert expected.stamp_ns == last_ns
    for item, other in zip(result, expected, strict=True):
        # 1e-15: the feedback of an error of zero normalises the attitude once more.
        np.testing.assert_allclose(item, other, rtol=1e-9, atol=1e-15)


def test_smoothed_poses_and_sigmas_are_smaller_than_the_filters():
    """With white noise, a smoother's variance in the middle is half of a filter's."""
    result = {}
    for name, steps in zip(("filter", "smoother"), both("ordinary"), strict=False):
        late = errors(flight(5, LENGTH_S), solutions(steps)).after(8.0)
        result[name] = late
        assert np.abs(late.state / late.sigma).max() < 5
    assert (result["smoother"].sigma.mean(0) < 0.8 * result["filter"].sigma.mean(0)).all()
    off = {name: np.linalg.norm(item.state[:, :3]) for name, item in result.items()}
    assert off["smoother"] < 0.7 * off["filter"]


def test_an_outage_is_bridged_from_both_ends():
    """The filter's sigma grows to the end of 6 s, the smoother's to the middle and back."""
    of_filter, of_smoother = (
        errors(flight(5, LENGTH_S), solutions(steps)) for steps in both("outage")[:2]
    )
    inside = (of_filter.t_s > 12.0) & (of_filter.t_s < 18.0)
    for result, worst_s in ((of_filter, (17.9, 18.0)), (of_smoother, (13.9, 16.1))):
        sigma = result.sigma[inside, 0]
        assert worst_s[0] <= result.t_s[inside][sigma.argmax()] <= worst_s[1]
        assert np.abs(result.state / result.sigma)[inside].max() < 4
    off_m = [
        np.linalg.norm(item.state[inside, :3], axis=1).max() for item in (of_filter, of_smoother)
    ]
    assert off_m[1] < 0.3 * off_m[0]
    sigma_m = [item.sigma[inside, 0].max() for item in (of_filter, of_smoother)]
    assert sigma_m[1] < 0.3 * sigma_m[0]


def test_a_reset_does_not_change_the_poses_before_it():
    """RTK's step of 6 m is followed from the reset on; the poses before stay where they were."""
    steps, smooth, *_ = both("reset")
    outcomes = [step.verdict.outcome for step in steps]
    assert Outcome.RESET in outcomes
    reset_ns = next(s for s in solutions(steps[: outcomes.index(Outcome.RESET)][::-1])).stamp_ns
    result = errors(flight(5, LENGTH_S), solutions(smooth))
    start_ns = flight(5, LENGTH_S).truth.stamp_ns[0]
    reset_s = (reset_ns - start_ns) * 1e-9
    usual = (result.t_s > 8.0) & (result.t_s < reset_s - 1.0)
    assert np.abs(result.state[usual, 2]).max() < 0.3
    after = result.t_s > reset_s + 1.0
    assert np.abs(result.state[after, 2] - 6.0).max() < 0.3


def test_each_run_is_smoothed_by_itself():
    """Samples after a restart of the filter do not change the poses before it."""
    steps, smooth, *_ = both("two runs")
    assert Outcome.GAP in [step.verdict.outcome for step in steps]
    config, samples = config_for(flight(5, LENGTH_S)), changed(**WAYS["two runs"])
    again_ns = flight(5, LENGTH_S).truth.stamp_ns[0] + 13_500_000_000
    first = [sample for sample in samples if sample.stamp_ns < again_ns]
    alone = solutions(run(smoothed(config, first), first))
    for item, other in zip(alone, solutions(smooth), strict=False):
        assert all(np.array_equal(a, b) for a, b in zip(item, other, strict=True))
    assert len(alone) < len(solutions(smooth))


@pytest.mark.slow
def test_late_measurements_count_at_their_own_time():
    """RTK that arrives half a second late gives the same result, except for rounding."""
    config = config_for(flight(5, LENGTH_S))
    timely = sorted(changed(), key=lambda s: (s.stamp_ns, not isinstance(s, ImuSample)))
    late_ns = dict.fromkeys(RTK, 500000000)
    late = sorted(timely, key=lambda s: s.stamp_ns + late_ns.get(s.source, 0))
    end_ns = timely[-1].stamp_ns - 1_000_000_000  # some of the last would come after the end
    result = [
        {s.stamp_ns: s for s in solutions(run(smoothed(config, order), order))}
        for order in (timely, late)
    ]
    common = [ns for ns in result[0] if ns in result[1] and ns < end_ns]
    assert len(common) > 1000
    for stamp_ns in common[::50]:
        item, other = result[0][stamp_ns], result[1][stamp_ns]
        assert math.isclose(item.latitude_rad, other.latitude_rad, rel_tol=1e-12)
        np.testing.assert_allclose(item.q_nb, other.q_nb, atol=1e-9)
        np.testing.assert_allclose(item.covariance, other.covariance, rtol=1e-4, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"position_update": "rtk_direct", "rtk__median_window": 3},
        {"aircraft__rtk_antenna_sigma_m": (0.05, 0.05, 0.05)},
    ],
)
def test_other_forms_of_the_filter(values):
    """The paper's own cycle, and with more error states: within four of its sigmas."""
    steps, smooth, *_ = both("ordinary", **values)
    assert [step.verdict for step in smooth] == [step.verdict for step in steps]
    late = errors(flight(5, LENGTH_S), solutions(smooth)).after(8.0)
    assert np.abs(late.state / late.sigma)[:, 3:].max() < 5
    assert np.linalg.norm(late.state[:, :3], axis=1).max() < 0.1


def test_a_method_without_filter_has_no_runs():
    config = config_for(flight(5, LENGTH_S), method="rtk")
    recording = RecordingNavigation(config)
    run(recording, [s for s in changed() if isinstance(s, (ImuSample, PositionSample))][:500])
    assert recording.smoothed() == []


def test_what_was_recorded_must_be_what_is_replayed():
    config, samples = config_for(flight(5, LENGTH_S)), changed()
    recording = RecordingNavigation(config)
    run(recording, samples[:1500])
    navigation = SmoothedNavigation(config, recording.smoothed())
    with pytest.raises(KeyError):
        run(navigation, samples)
