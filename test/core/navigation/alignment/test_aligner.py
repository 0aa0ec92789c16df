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
"""The first state: at rest and in motion, with sources missing or in doubt.

An alignment is not deceived by what is wrong for a while, nor held up by it for ever.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from alignments import WAIT_S, aligned, assert_right, duration_s, error, samples_from, spoilt
from flights import RTK, config_for, flight

from tirgeo_ros.core.frames.rotations import quat_from_euler, quat_multiply
from tirgeo_ros.core.navigation.alignment.aligner import Aligner
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

pytestmark = pytest.mark.slow

#: The filter's default for the biases at start is for a worse IMU than the simulated one.
SIMULATED = {"imu__gyro_turn_on_bias": 3e-4, "imu__accel_turn_on_bias": 1e-2}


@pytest.mark.parametrize("shape", ["lawnmower", "hover", "figure_eight"])
def test_error_over_sigma_at_starts_in_motion(shape):
    """Forty starts of each shape, turns among them, within a second and two RTK intervals."""
    ratios = []
    for seed in range(4):
        flown = flight(seed, 50.0, shape)
        config = config_for(flown, **SIMULATED)
        for start_s in np.arange(5.3, 45.0, 4.0):
            samples = samples_from(flown, start_s, length_s=2.0)
            result, _ = aligned(samples, config)
            assert duration_s(samples, result) <= 1.4
            ratios.append(error(flown, result) / np.sqrt(np.diag(result.covariance)))
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    # Forty draws: rms 1 +- 0.11. The heading's sigma stands on a floor and may be too large.
    assert (rms[:9] > 0.65).all()
    assert (rms[:9] < 1.3).all()


def test_the_covariance_is_that_of_the_errors_with_cross_terms():
    """NEES of all 15 states over 100 seeds, with biases unknown and known from before."""
    values = {"duration_s": 2.4, "route.shape": "figure_eight", "route.hover_s": 0.0}
    distances = []
    for seed in range(100):
        flown = fly(scenario_from(values), 1000 + seed)
        samples, config = samples_from(flown, 0.9), config_for(flown, **SIMULATED)
        for prior in (None, known_biases(flown, 1.4)):
            result, _ = aligned(samples, config, prior=prior)
            wrong = error(flown, result)
            distances.append(wrong @ np.linalg.solve(result.covariance, wrong))
    # Mean of chi-square with 15 degrees over 100 draws: 15 +- 0.55; less for the heading's floor,
    # up to one degree of freedom.
    for mean in np.mean(np.reshape(distances, (100, 2)), axis=0):
        assert 15 - 1 - 3 * 0.55 < mean < 15 + 3 * 0.55


def known_biases(flown, t_s):
    """Biases with an error drawn from their covariance."""
    i = round(t_s * flown.scenario.imu.rate_hz)
    root = np.diag([5e-5] * 3 + [3e-3] * 3) @ (np.eye(6) + 0.4)
    drawn = root @ np.random.default_rng(flown.seed).standard_normal(6)
    guess = np.concatenate([flown.truth.gyro_bias_b[i], flown.truth.accel_bias_b[i]]) + drawn
    return Biases(tuple(guess[:3].tolist()), tuple(guess[3:].tolist()), root @ root.T)


@pytest.mark.parametrize(
    ("values", "longest_s"),
    [
        ({"site.latitude_deg": 80.0, "site.longitude_deg": 180.0}, 1.4),
        ({"site.latitude_deg": -33.0, "site.ground_height_m": -300.0}, 1.4),
        ({"imu.rate_hz": 400.0, "route.speed_m_s": 10.0, "route.turn_radius_m": 12.0}, 1.4),
        ({"imu.rate_hz": 50.0}, 1.4),
        ({"rtk.rate_hz": 1.0}, 4.0),  # three instants over more than 2.5 s
    ],
)
def test_anywhere_at_any_rate(values, longest_s):
    flown = fly(scenario_from({"duration_s": 26.0, "route.shape": "figure_eight", **values}), 5)
    for start_s in (0.0, 7.3, 15.3):
        samples = samples_from(flown, start_s)
        result, _ = aligned(samples, config_for(flown))
        assert_right(flown, result)
        assert duration_s(samples, result) <= longest_s


@pytest.mark.parametrize(
    ("missing", "use_heading"),
    [
        ([Source.RTK_VELOCITY], True),
        ([Source.RTK_VELOCITY, Source.GPS_VELOCITY, Source.GPS_POSITION], True),
        ([Source.RTK_POSITION], True),
        ([Source.RTK_HEADING], True),
        (RTK, True),
        (RTK, False),
        ([*RTK, Source.GPS_VELOCITY], True),  # the longest window: 6 s
    ],
)
def test_which_sources_replace_missing_ones_after_the_wait(missing, use_heading):
    flown = flight(6, 50.0, "figure_eight")
    for start_s in (0.0, 17.3):
        samples = samples_from(flown, start_s, missing)
        result, _ = aligned(samples, config_for(flown), use_heading=use_heading)
        assert_right(flown, result)
        assert WAIT_S - 0.3 < duration_s(samples, result) < WAIT_S + 1.6


def test_ordinary_gps_has_its_own_lever_arm():
    """The antennas are more than a metre apart, and there is no other error."""
    perfect = {
        "imu.noise_scale": 0.0,
        "gps.velocity_sigma_m_s": 0.0,
        "gps.position_rms_m": [0.0, 0.0, 0.0],
        "gps.lever_arm_m": [1.5, -1.0, 0.4],
        "duration_s": 14.0,
        "route.shape": "figure_eight",
    }
    flown = fly(scenario_from(perfect), 1)
    result, _ = aligned(samples_from(flown, 4.3, RTK), config_for(flown))
    # With the autopilot's heading 1.8 deg off, an arm of 1.8 m moves by 6 cm.
    assert np.abs(error(flown, result)[6:9]).max() < 0.1


def test_without_antennas_the_autopilot_gives_the_heading_at_once():
    flown = flight(4, 50.0, "figure_eight")
    samples = samples_from(flown, 11.3)
    result, _ = aligned(samples, config_for(flown), use_heading=False)
    assert_right(flown, result)
    assert duration_s(samples, result) <= 1.4
    sigma_deg = math.degrees(math.sqrt(result.covariance[2, 2]))
    assert sigma_deg == pytest.approx(1.7972, rel=0.1)


@pytest.mark.parametrize("q_nb", [None, np.zeros(4), np.full(4, math.nan)])
@pytest.mark.parametrize("use_heading", [True, False])
def test_velocity_gives_no_heading(q_nb, use_heading):
    """Neither antennas nor autopilot: no start, however long the flight and its courses."""
    flown = flight(4, 50.0, "figure_eight")
    samples = samples_from(flown, 5.0, [Source.RTK_HEADING])
    samples = spoilt(samples, Source.IMU, lambda s: replace(s, autopilot_q_nb=q_nb))
    result, aligner = aligned(samples, config_for(flown), use_heading=use_heading)
    assert result is None
    assert "orientation in imu/data" in aligner.reason
    assert "velocity gives no heading while hovering" in aligner.reason
    assert ("rtk/heading" in aligner.reason) == use_heading


@pytest.mark.parametrize(
    ("missing", "length_s", "reason"),
    [
        ([Source.RTK_POSITION], 3.0, "needs rtk/fix"),
        ([Source.RTK_VELOCITY], 3.0, "needs rtk/vel over 1 s"),
        ([Source.RTK_HEADING], 3.0, "needs rtk/heading"),
        ([Source.IMU], 3.0, "needs imu/data"),
        ([Source.RTK_POSITION, Source.GPS_POSITION], 14.0, "needs rtk/fix or gps/fix"),
    ],
)
def test_what_is_missing_is_named(missing, length_s, reason):
    flown = flight(4, 50.0, "figure_eight")
    result, aligner = aligned(samples_from(flown, 0.0, missing, length_s), config_for(flown))
    assert result is None
    assert reason in aligner.reason


def test_samples_after_the_stamp_are_kept():
    """Ordinary GPS comes at once, RTK 150 ms later: that is ahead of the window's end."""
    flown = fly(scenario_from({"duration_s": 3.0, "rtk.arrival_delay_s": 0.15}), 1)
    samples = samples_from(flown)
    result, _ = aligned(samples, config_for(flown))
    end_ns = result.imu[-1].stamp_ns
    after = [s for s in samples if result.stamp_ns < s.stamp_ns <= end_ns]
    assert [s for s in after if isinstance(s, ImuSample)] == list(result.imu[1:])
    assert {s.source for s in result.later} == {Source.GPS_POSITION, Source.GPS_VELOCITY}
    assert result.imu[0].stamp_ns <= result.stamp_ns < result.imu[1].stamp_ns


@pytest.mark.parametrize("before", [FixStatus.FLOAT, FixStatus.SINGLE, FixStatus.NONE])
def test_headings_count_only_once_rtk_is_fixed_for_a_while(before):
    """Headings that are 60 deg off until RTK is fixed are not used."""
    flown = flight(4, 50.0, "figure_eight")
    samples = samples_from(flown, 5.0)
    for source, change in (
        (Source.RTK_HEADING, lambda s: replace(s, heading_rad=s.heading_rad + 1.0)),
        (Source.RTK_POSITION, lambda s: replace(s, status=before)),
    ):
        samples = spoilt(samples, source, change, to_s=1.99)
    result, _ = aligned(samples, config_for(flown))
    assert_right(flown, result)
    # start_after_s, then three headings of 5 Hz
    assert 2.0 + 1.0 < duration_s(samples, result) < 2.0 + 1.0 + 1.2


def test_float_positions_do_not_average_to_nothing():
    flown = flight(4, 50.0, "figure_eight")
    floating = samples_from(flown, 5.0)
    samples = spoilt(floating, RTK[0], lambda s: replace(s, status=FixStatus.FLOAT))
    result, _ = aligned(samples, config_for(flown))
    assert_right(flown, result)
    sigma_m = np.sqrt(np.diag(result.covariance)[6:9])
    assert (sigma_m > 0.3 / math.sqrt(2)).all()  # the half of the variance that lasts
    assert (sigma_m < 0.3).all()


def test_memory_and_cost_are_bounded_while_waiting():
    flown = flight(4, 50.0, "figure_eight")
    aligner = Aligner(config_for(flown), use_heading=True)
    for sample in samples_from(flown, 0.0, [Source.RTK_POSITION, Source.GPS_POSITION], 40.0):
        aligner.add(sample)
    kept = aligner._samples
    # 6 s of window, 0.5 s of delay, 1 s to spare: 100 Hz; rtk/vel, rtk/heading 5 Hz, gps/vel 10.
    assert len(kept._imu) <= 751
    assert len(kept._aiding) <= 7.6 * (5 + 5 + 10) + 3
    for kind in (VelocitySample, HeadingSample):
        assert any(isinstance(s, kind) for s in kept._aiding)
    assert not any(isinstance(s, PositionSample) for s in kept._aiding)


def test_trials_become_rarer_while_only_motion_is_missing(monkeypatch):
    """An IMU turned by 90 deg in its mount looks like biases that no motion ever shows."""
    flown = flight(3, 60.0, "lawnmower")
    trials_s: list[float] = []
    tried = Aligner._outcome

    def outcome(aligner, plan):
        trials_s.append(aligner._samples.imu_s)
        return tried(aligner, plan)

    monkeypatch.setattr(Aligner, "_outcome", outcome)
    aligner = Aligner(config_for(flown, **SIMULATED), use_heading=True)
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

    def mounted(s):
        force_b, rate_b = turn @ s.specific_force_b, turn @ s.angular_rate_b
        return replace(s, specific_force_b=force_b, angular_rate_b=rate_b)

    for sample in spoilt(samples_from(flown, 10.0, length_s=40.0), Source.IMU, mounted):
        assert aligner.add(sample) is None
    assert "needs motion" in aligner.reason
    late_s = np.array([at_s for at_s in trials_s if at_s > 20.0])
    assert 5 <= len(late_s) <= 20  # 40 with two a second


def higher(metres):
    return lambda s: replace(s, height_m=s.height_m + metres)


def aside(metres):
    return lambda s: replace(s, latitude_rad=s.latitude_rad + metres / 6.37e6)


def faster(metres_s):
    return lambda s: replace(s, velocity_n=s.velocity_n + np.array([metres_s, 0.0, 0.0]))


def backwards(s):
    return replace(s, velocity_n=-s.velocity_n)


def turned(deg):
    return lambda s: replace(s, heading_rad=s.heading_rad + math.radians(deg))


def swung(roll_deg=0.0, yaw_deg=0.0):
    """The autopilot's attitude with an error."""
    roll = quat_from_euler(math.radians(roll_deg), 0.0, 0.0)
    yaw = quat_from_euler(0.0, 0.0, math.radians(yaw_deg))
    return lambda s: replace(
        s, autopilot_q_nb=quat_multiply(yaw, quat_multiply(s.autopilot_q_nb, roll))
    )


def upside_down(s):
    flip = np.array([1.0, -1.0, -1.0])
    q_nb = quat_multiply(s.autopilot_q_nb, quat_from_euler(np.pi, 0.0, 0.0))
    return ImuSample(s.stamp_ns, flip * s.specific_force_b, flip * s.angular_rate_b, q_nb)


def every_other_turned(s):
    """Neither half of the headings, at 5 Hz, is right by its number."""
    return turned(180.0)(s) if round(5e-9 * s.stamp_ns) % 2 else s


def outcome(shape, source, change, *times_s, start_s=5.3, use_heading=True):
    """A flight, its samples with a source changed between two times, the result, the aligner."""
    flown = flight(7, 50.0, shape)
    samples = spoilt(samples_from(flown, start_s), source, change, *times_s)
    return flown, samples, *aligned(samples, config_for(flown), use_heading=use_heading)


@pytest.mark.parametrize("at_s", [0.2, 0.5, 0.7, 0.9])
@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (Source.RTK_POSITION, aside(30.0)),
        (Source.RTK_POSITION, higher(0.5)),
        (Source.RTK_VELOCITY, faster(3.0)),
        (Source.RTK_VELOCITY, faster(-0.5)),
        (Source.RTK_HEADING, turned(180.0)),
        (Source.RTK_HEADING, turned(20.0)),
    ],
)
@pytest.mark.parametrize("shape", ["hover", "figure_eight"])
def test_one_wrong_measurement_does_no_harm(shape, kind, change, at_s):
    flown, samples, result, _ = outcome(shape, kind, change, at_s, at_s + 0.19, start_s=9.3)
    clean = samples_from(flown, 9.3)
    assert sum(a is not b for a, b in zip(samples, clean, strict=True)) == 1
    assert_right(flown, result)
    assert duration_s(samples, result) < 3.0  # once the wrong sample has left the window of 1 s


@pytest.mark.parametrize(
    ("shape", "source", "change", "times_s", "earliest_s", "latest_s"),
    [
        # Longer than the window: all headings in it agree, but not with the autopilot.
        ("hover", Source.RTK_HEADING, turned(180.0), (0.0, 2.0), 2.0, 4.0),
        # Never right, and doubted from the first window on: positions are used instead.
        ("figure_eight", Source.RTK_VELOCITY, backwards, (), WAIT_S, WAIT_S + 3.0),
        ("figure_eight", Source.IMU, swung(roll_deg=20.0), (), WAIT_S, WAIT_S + 1.6),
        ("figure_eight", Source.IMU, swung(yaw_deg=15.0), (), WAIT_S, WAIT_S + 1.6),
    ],
)
def test_a_long_fault_delays_but_does_not_block(
    shape, source, change, times_s, earliest_s, latest_s
):
    flown, samples, result, _ = outcome(shape, source, change, *times_s)
    assert_right(flown, result)
    assert earliest_s < duration_s(samples, result) < latest_s


@pytest.mark.parametrize(
    ("shape", "source", "change", "lasts_s", "reason"),
    [
        ("figure_eight", Source.IMU, swung(roll_deg=20.0), 3.0, "tilt and the orientation in"),
        ("figure_eight", Source.IMU, swung(yaw_deg=15.0), 3.0, "rtk/heading and the orientation"),
        # Antennas or compass may be wrong: this doubt does not end by itself, a person must look.
        *(
            ("figure_eight", Source.IMU, swung(yaw_deg=yaw_deg), 14.0, "aircraft.second_antenna_m")
            for yaw_deg in (25.0, -90.0, 180.0)
        ),
        ("hover", Source.IMU, upside_down, 4.0, "upside down: check its axes"),
        ("hover", Source.RTK_HEADING, every_other_turned, 4.0, "rtk/heading disagree"),
    ],
)
def test_a_contradicting_source_is_refused_and_named(shape, source, change, lasts_s, reason):
    flown = flight(7, 50.0, shape)
    samples = spoilt(samples_from(flown, 5.3, length_s=lasts_s), source, change)
    result, aligner = aligned(samples, config_for(flown))
    assert result is None
    assert reason in aligner.reason


def test_a_fault_of_the_imu_is_not_reported_as_a_missing_source():
    """An aircraft without ordinary GPS, its acceleration in g; also after the wait."""
    flown = flight(4, 50.0, "hover")
    samples = samples_from(flown, 0.0, [Source.GPS_POSITION, Source.GPS_VELOCITY], 12.0)
    in_g = spoilt(
        samples, Source.IMU, lambda s: replace(s, specific_force_b=s.specific_force_b / 9.81)
    )
    result, aligner = aligned(in_g, config_for(flown))
    assert result is None
    assert aligner.reason == "imu/data: a mean force of 1.0 m/s2 is not gravity"


def test_a_single_wrong_attitude_of_the_autopilot_is_not_used():
    """Method ekf: the last attitude before the window's end is 90 deg off."""
    flown, _, result, _ = outcome(
        "hover", Source.IMU, swung(yaw_deg=90.0), 0.995, 1.005, use_heading=False
    )
    assert_right(flown, result)


def test_an_attitude_that_stays_while_the_aircraft_turns_is_refused():
    """It turns at 35 deg/s."""
    q_nb = samples_from(flight(7, 50.0, "figure_eight"), 9.3)[0].autopilot_q_nb
    *_, result, aligner = outcome(
        "figure_eight",
        Source.IMU,
        lambda s: replace(s, autopilot_q_nb=q_nb),
        start_s=9.3,
        use_heading=False,
    )
    assert result is None
    assert "follows the gyroscopes" in aligner.reason


def test_a_frozen_imu_does_not_align():
    flown = flight(7, 50.0, "hover")
    samples = samples_from(flown, 0.0)
    first = samples[0]
    same = {"specific_force_b": first.specific_force_b, "angular_rate_b": first.angular_rate_b}
    # The sensor was live for a moment; constant from the first sample on, it would be a bench.
    frozen = spoilt(samples, Source.IMU, lambda s: replace(s, **same), 0.05, 4.0)
    early = [s for s in frozen if s.stamp_ns < first.stamp_ns + 4_000_000_000]
    result, aligner = aligned(early, config_for(flown))
    assert result is None
    assert "frozen" in aligner.reason
    result, aligner = aligned(frozen, config_for(flown))
    assert_right(flown, result)
    assert 4.0 + 1.0 < duration_s(samples, result) < 4.0 + 1.0 + 0.5
    assert result.imu[0].stamp_ns > first.stamp_ns + 4_000_000_000


@pytest.mark.parametrize(("end_s", "begins_s"), [(0.95, 0.95), (0.85, 0.0)])
def test_no_window_spans_a_gap_of_the_imu(end_s, begins_s):
    """One of 0.25 s; 0.15 s are bridged."""
    flown = flight(7, 50.0, "hover")
    samples = samples_from(flown, 0.0)
    first = samples[0].stamp_ns
    holed = [
        s
        for s in samples
        if not (isinstance(s, ImuSample) and 0.7 < (s.stamp_ns - first) * 1e-9 < end_s)
    ]
    result, _ = aligned(holed, config_for(flown))
    assert_right(flown, result)
    assert begins_s + 1.0 <= duration_s(samples, result) < begins_s + 1.0 + 0.5
