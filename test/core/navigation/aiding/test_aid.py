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
"""H of every aid against differences of its model; records of the aids: silence, steps, resets."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filter_states import (
    ANTENNA_M,
    LEVER_B,
    NOW_NS,
    TIMEOUT_NS,
    ZERO,
    antenna_fix,
    armed_config,
    estimate_of,
    heard,
    ns,
    state_of,
)
from hypothesis import given, settings, strategies as st

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid import StateEstimate
from tirgeo_ros.core.navigation.aiding.aid_status import EASE_STEPS, AidStatus, AidTrack, Receivers
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import Baseline, HeadingAid
from tirgeo_ros.core.navigation.aiding.fusion import AIDS
from tirgeo_ros.core.navigation.ins.error_states import (
    GPS_ERROR,
    feedback,
    states_of,
)
from tirgeo_ros.core.navigation.ins.strapdown import matrix
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample, Source, VelocitySample
from tirgeo_ros.core.types.verdicts import Outcome

RATE_B = np.array([0.2, -0.1, 0.5])
SHIFT_N = np.array([1.0, 2.0, -3.0])
#: Half steps: second-order terms of the models are lever (1 m) times step squared.
STEPS = [1e-4] * 3 + [1e-2] * 3 + [1.0] * 3 + [1e-4] * 3 + [1e-2] * 3 + [1.0] * 4 + [1e-2] * 4

tilts = st.floats(-0.6, 0.6)
headings = st.floats(-math.pi, math.pi)
PLACE = {"aircraft__rtk_antenna_sigma_m": (0.1, 0.2, 0.3)}
with_and_without_more_states = pytest.mark.parametrize(
    "optional", [{}, PLACE], ids=["plain", "antenna"]
)


def second(baseline_m):
    """The second antenna's place for a baseline; none without a baseline."""
    return tuple(a + b for a, b in zip(ANTENNA_M, baseline_m, strict=True)) if baseline_m else ()


def moved(estimate: StateEstimate, error: np.ndarray) -> StateEstimate:
    """The estimate with an error added to all its states, those of the receivers too."""
    aids = estimate.aids._replace(receivers=estimate.aids.receivers.changed(error))
    return StateEstimate(feedback(estimate.state, error), estimate.covariance, aids)


def differences(innovation, estimate: StateEstimate) -> np.ndarray:
    """d(innovation)/d(error) by central differences: what H must be with the opposite sign."""
    columns, states = [], len(estimate.covariance)
    steps = [*STEPS, *[1e-2] * 3]
    for error in np.diag(steps[:states]):
        plus, minus = innovation(moved(estimate, error)), innovation(moved(estimate, -error))
        columns.append((plus - minus) / (2 * error.sum()))
    return np.stack(columns, -1)


@with_and_without_more_states
@pytest.mark.parametrize("source", [Source.RTK_POSITION, Source.GPS_POSITION])
@settings(max_examples=60)
@given(roll=tilts, pitch=tilts, yaw=headings)
def test_position_design(optional, source, roll, pitch, yaw):
    """The ordinary GPS is modelled with its slow error."""
    config = armed_config(**optional)
    error = np.zeros(states_of(config))
    error[GPS_ERROR] = 0.5, -0.7, 2.0
    estimate = moved(estimate_of(state_of(roll, pitch, yaw), states_of(config)), error)
    sample = antenna_fix(estimate.state, SHIFT_N, source)
    aid = AIDS[source](config)
    result = aid.measured(sample, estimate, ZERO)[0].measurement

    def innovation(b: StateEstimate) -> np.ndarray:
        return aid.measured(sample, b, ZERO)[0].measurement.innovation

    # Rounding of 1.4e-9 m over the step of 1e-4 rad gives 1e-5; metres to radians second order
    # in (3 m + 1 m) / 6.4e6 m.
    assert result.design == pytest.approx(-differences(innovation, estimate), abs=3e-5)
    own_n = error[GPS_ERROR] * (source is Source.GPS_POSITION)
    # Curvature over 4 m: 16 / (2 x 6.4e6) = 1.3e-6 m.
    assert result.innovation == pytest.approx(SHIFT_N - own_n, abs=2e-6)


@with_and_without_more_states
@pytest.mark.parametrize("source", [Source.RTK_VELOCITY, Source.GPS_VELOCITY])
@settings(max_examples=40)
@given(roll=tilts, pitch=tilts, yaw=headings)
def test_velocity_design(optional, source, roll, pitch, yaw):
    config = armed_config(**optional)
    estimate = estimate_of(state_of(roll, pitch, yaw), states_of(config))
    sample = VelocitySample(NOW_NS, source, np.array([3.1, -0.9, 0.1]), np.eye(3))
    rtk = source is Source.RTK_VELOCITY

    def innovation(b: StateEstimate) -> np.ndarray:
        rate = RATE_B - np.array(b.state.gyro_bias_b)  # RATE_B is the reading
        estimated_b = np.array(b.aids.receivers.antenna_b) * rtk
        swing_n = matrix(rotation_of(b.state.q_nb)) @ np.cross(rate, LEVER_B + estimated_b)
        slow_n = np.array(b.aids.receivers.gps_velocity_error_n) * (not rtk)
        return sample.velocity_n - (np.array(b.state.velocity_n) + swing_n + slow_n)

    result = AIDS[source](config).measured(sample, estimate, tuple(RATE_B))[0].measurement
    assert result.innovation == pytest.approx(innovation(estimate), abs=1e-12)
    # Second order: lever x rate x step squared is 1e-8 / 2e-4.
    assert result.design == pytest.approx(-differences(innovation, estimate), abs=1e-4)


@with_and_without_more_states
@pytest.mark.parametrize(
    "baseline_m", [(), (1.0, 0.0, 0.0), (0.3, -0.8, 0.0), (0.6, 0.2, 0.25), (-0.5, 0.1, -0.2)]
)
@settings(max_examples=40)
@given(roll=tilts, pitch=tilts, yaw=headings)
def test_heading_design(optional, baseline_m, roll, pitch, yaw):
    """The heading is the azimuth of a baseline in space, level in the body or not."""
    config = armed_config(**optional, aircraft__second_antenna_m=second(baseline_m))
    forward, left, up = baseline_m or (1.0, 0.0, 0.0)
    baseline_b = np.array([forward, -left, -up])
    estimate = estimate_of(state_of(roll, pitch, yaw), states_of(config))

    def reported(b: StateEstimate) -> float:
        """A perfect receiver's heading: the baseline's azimuth less its direction in the body."""
        north, east, _ = matrix(rotation_of(b.state.q_nb)) @ baseline_b
        level = math.atan2(baseline_b[1], baseline_b[0])
        return math.atan2(east, north) - level

    measured = reported(estimate) + 0.3
    # 0.6 rad of roll and pitch leave a baseline mostly horizontal.
    result = HeadingAid(config).measured(HeadingSample(NOW_NS, measured, 1e-4), estimate, ZERO)[0]

    def innovation(b: StateEstimate) -> np.ndarray:
        return np.array([math.remainder(measured - reported(b), 2 * math.pi)])

    assert result.measurement.innovation == pytest.approx([0.3], abs=1e-12)
    # Third order in 1e-4 rad, and rounding 1e-16 over it.
    numeric = differences(innovation, estimate)
    assert result.measurement.design == pytest.approx(-numeric, abs=1e-6)


def heading_aid(state, heading_rad, **values):
    config = armed_config(**values)
    sample = HeadingSample(NOW_NS, heading_rad, 1.0)
    return HeadingAid(config).measured(sample, estimate_of(state, states_of(config)), ZERO)[0]


@pytest.mark.parametrize("turns", [-1, 0, 1, 2])
def test_heading_innovation_wraps(turns):
    measured = math.radians(-179.0) + turns * 2 * math.pi
    aid = heading_aid(state_of(0, 0, math.radians(179.0)), measured)
    assert aid.measurement.innovation[0] == pytest.approx(math.radians(2.0), abs=1e-12)


def test_baseline_of_the_parameters():
    """Second antenna behind, to the left and higher; where the IMU is does not matter."""
    places = {"aircraft__second_antenna_m": second((-1.0, 0.5, 0.25))}
    result = Baseline.from_config(armed_config(**places, aircraft__imu_m=(5.0, 6.0, 7.0)).aircraft)
    length = math.sqrt(1 + 0.25 + 0.0625)
    assert result.direction_b == pytest.approx((-1 / length, -0.5 / length, -0.25 / length))
    assert result.reported_less_azimuth_rad == pytest.approx(-math.atan2(-0.5, -1.0))


def test_upright_baseline_has_no_heading():
    assert heading_aid(state_of(0.0, math.radians(85.0), 0.0), 0.0).outcome is Outcome.INVALID


NEW = AidStatus(Receivers(NOW_NS))


def steps(track, t_s, *innovation):
    """The record after a refusal, as the fusion keeps it, of an innovation that should be zero."""
    zero = (0.0,) * len(innovation)
    track = track.followed(innovation, zero)
    step = track.stepped(innovation, zero)
    return track.refused(ns(t_s), innovation, 0.2, step=step)


def test_a_step_is_distinguished_from_a_drift():
    fitted = AidTrack().used(ns(0), TIMEOUT_NS, (0.1, 0.0))
    assert steps(fitted, 0.2, 0.6, 0.0).step == (0.5, 0.0)
    assert steps(fitted, 0.2, 0.3, 0.0).step == ()  # two thirds of it are new; a step needs 0.7
    assert steps(AidTrack(), 0.2, 0.6, 0.0).step == ()  # nothing was used before


def test_a_step_back_ends_the_step_and_another_step_begins_anew():
    track = steps(AidTrack().used(ns(0), TIMEOUT_NS, (0.0,)), 0.2, 0.5)
    track = steps(track, 0.4, 0.55)
    assert (track.step, track.denied_ns) == ((0.5,), ns(0.2))
    assert track.followed((0.1,), (0.0,)).step == ()
    assert track.followed((0.3,), (0.0,)).step == (0.5,)  # drift, or noise
    other = steps(track, 0.6, -0.55)
    assert other.step == pytest.approx((-0.6,))
    assert other.denied_ns == ns(0.6)


def test_positions_that_are_fixed_again_are_eased_and_no_other_aid():
    aids = heard(heard(NEW, 0.0), 1.0, FixStatus.FLOAT)
    assert not any(t.ease for t in aids.tracks)
    first, *others = (t.ease for t in heard(aids, 2.0).tracks)
    assert (first, any(others)) == (EASE_STEPS, False)


@pytest.mark.parametrize(
    ("source", "size", "text"),
    [
        (Source.RTK_POSITION, 1.5, "position moved by 1.50 m"),
        (Source.RTK_VELOCITY, 1.5, "velocity changed by 1.50 m/s"),
        (Source.RTK_HEADING, math.radians(-20.0), "heading turned by -20.0 deg"),
        (Source.GPS_POSITION, 1.5, "GPS error changed by 1.50 m"),
        (Source.GPS_VELOCITY, 1.5, "velocity changed by 1.50 m/s"),
        (Source.BAROMETER, 1.5, "offset of baro/pressure changed by 1.50 m"),
    ],
)
def test_resets_are_counted_and_worded(source, size, text):
    aids = AIDS[source](EkfConfig()).with_reset(NEW, ns(0), size)
    assert sum(aids.resets) == 1
    assert str(aids.last_reset) == text
    assert aids.track(source) == AidTrack(ns(0))


@pytest.mark.parametrize(("last_s", "hopeless"), [(10.0, True), (10.001, False)])
def test_three_resets_within_ten_seconds_are_hopeless(last_s, hopeless):
    aids = NEW
    for t_s, source in (
        (0.0, Source.RTK_POSITION),
        (4.0, Source.RTK_VELOCITY),
        (5.0, Source.RTK_HEADING),  # neither moves position or velocity
        (5.0, Source.GPS_POSITION),
    ):
        aids = aids.with_reset(source, ns(t_s), "")
        assert aids.hopeless(2.0) == ""
    aids = aids.with_reset(Source.RTK_POSITION, ns(last_s), "position moved")
    aids = aids.with_reset(Source.BAROMETER, ns(last_s), "offset")  # not the reset to name
    why = "reset repeatedly: position moved"
    assert aids.hopeless(2.0) == (why if hopeless else "")


def denied(sources, times_s):
    """Refusals that do not even agree with each other."""
    aids = NEW
    for source in sources:
        track = AidTrack()
        for k, t_s in enumerate(times_s):
            track = track.refused(ns(t_s), (3.0 * k,), 0.1)
        aids = aids.with_track(source, track)
    return aids


FIVE_A_SECOND = tuple(0.2 * k for k in range(11))
BOTH = (Source.RTK_POSITION, Source.RTK_VELOCITY)


@pytest.mark.parametrize(
    ("sources", "times_s", "hopeless"),
    [
        (BOTH, FIVE_A_SECOND, True),
        (BOTH, FIVE_A_SECOND[:-1], False),  # not for long enough
        (BOTH, (0.0, 0.6, 1.2, 2.0), False),  # too few
        (BOTH[:1], FIVE_A_SECOND, False),  # the other source may be right
        (BOTH[1:], FIVE_A_SECOND, False),
    ],
)
def test_position_and_velocity_that_both_contradict_are_hopeless(sources, times_s, hopeless):
    aids = denied(sources, times_s)
    why = "rtk/fix and rtk/vel both contradict the state"
    assert aids.hopeless(2.0) == (why if hopeless else "")
    track = aids.track(sources[-1]).used(ns(2.1), TIMEOUT_NS)  # a use ends the refusals
    assert (track.denied, track.run) == (0, None)
    assert aids.with_track(sources[-1], track).hopeless(2.0) == ""
