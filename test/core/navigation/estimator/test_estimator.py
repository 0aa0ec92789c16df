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
"""The estimator: verdicts on bad data, methods, the map's origin, clocks, resets, the track."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, errors, filtered, flight, navigation_samples, rms, without

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.estimator.track import MOST_POINTS, Track
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import FixStatus, ImuSample, Source
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.core.types.verdicts import FilterState

DURATION_S = 8.0


def test_states_and_reasons():
    flown = flight(duration_s=DURATION_S)
    navigation = Navigation(config_for(flown))
    assert navigation.status().state is FilterState.WAITING
    assert "imu/data" in navigation.status().reason
    observed, imu_ns = {}, 0
    for sample in navigation_samples(flown):
        navigation.process(sample)
        imu_ns = sample.stamp_ns if isinstance(sample, ImuSample) else imu_ns
        observed.setdefault(navigation.state_and_resets()[0], imu_ns)
        assert navigation.status().state is navigation.state_and_resets()[0]
    assert list(observed) == [FilterState.WAITING, FilterState.ALIGNING, FilterState.RUNNING]
    status = navigation.status()
    assert status.reason == ""
    assert status.state_s == pytest.approx(
        (imu_ns - observed[FilterState.RUNNING]) * 1e-9, abs=1e-6
    )
    counts = status.counts  # every IMU sample is counted once
    assert counts["imu", "used"] + counts["imu", "waiting"] == len(flown.truth.stamp_ns)
    assert 0 < math.degrees(status.heading_sigma_rad) < 1
    assert set(status.test_ratios) == {
        "rtk_position",
        "rtk_velocity",
        "rtk_heading",
        "gps_position",  # used once a second while RTK is used
    }
    assert status.resets == {}
    assert status.last_reset == ""


def test_silent_receiver_has_no_status():
    flown = flight(duration_s=DURATION_S)
    navigation = filtered(flown).navigation
    imu = [s for s in navigation_samples(flown) if isinstance(s, ImuSample)][-1]
    for step in range(1, 251):  # a live IMU goes on: every sample a little different
        rate_b = imu.angular_rate_b + 1e-5 * (step % 7)
        stamp_ns = imu.stamp_ns + step * 10_000_000
        navigation.process(replace(imu, stamp_ns=stamp_ns, angular_rate_b=rate_b))
        if step in {1, 150}:
            assert navigation.status().rtk_status is FixStatus.FIXED
    assert navigation.status().rtk_status is FixStatus.NONE


def test_a_bag_played_again_starts_again():
    """Stamps that go back by more than a second mean another run, so a new alignment."""
    flown = flight(duration_s=DURATION_S)
    navigation = filtered(flown).navigation
    result = [navigation.process(s).solution for s in navigation_samples(flown)]
    assert navigation.status().counts["imu", "time_jump"] == 1
    assert navigation.status().state is FilterState.RUNNING
    late = errors(flown, [s for s in result if s is not None]).after(5.0)
    assert np.degrees(rms(late.rpy)).max() < 0.5


def test_origin_is_the_first_accepted_position_and_outlives_a_reset():
    flown = flight(duration_s=DURATION_S)
    navigation = Navigation(config_for(flown))
    fixes = [s for s in navigation_samples(flown) if is_rtk(s)]
    navigation.process(replace(fixes[0], status=FixStatus.NONE))
    assert navigation.plane is None
    navigation.process(fixes[1])
    assert navigation.plane.latitude_rad == fixes[1].latitude_rad
    navigation.reset()
    assert navigation.status().state is FilterState.WAITING
    assert navigation.plane.latitude_rad == fixes[1].latitude_rad


def test_configured_origin_must_be_on_earth():
    plane = Navigation(config_from(EkfConfig, {"origin_lat_lon_h": (39.8, 116.7, 12.0)})).plane
    assert math.degrees(plane.latitude_rad) == pytest.approx(39.8, abs=1e-12)
    for origin, reason in (
        ((116.7, 39.8, 12.0), "not a latitude"),
        ((39.8, 116.7, 1e300), "no height"),
    ):
        config = config_from(EkfConfig, {"origin_lat_lon_h": origin})
        with pytest.raises(ConfigError, match=f"origin_lat_lon_h: .* {reason}"):
            Navigation(config)


@pytest.mark.parametrize(
    ("method", "unused"),
    [
        ("raw", {"rtk_position", "rtk_velocity", "rtk_heading"}),
        ("rtk", {"gps_position", "gps_velocity", "rtk_heading"}),
        ("ekf", {"rtk_heading"}),
        ("ekf_heading", set()),
    ],
)
def test_each_method_uses_its_sources(method, unused):
    counts = filtered(flight(duration_s=DURATION_S), method=method).status.counts
    assert {source for source, outcome in counts if outcome == "unused"} == unused


def raised(sample, metres):
    return replace(sample, height_m=sample.height_m + metres) if is_rtk(sample) else sample


def test_a_wrong_start_is_noticed_and_corrected():
    """The alignment's fixes are 50 m off: later fixes are refused, and cause a reset."""

    def change(sample, t_s):
        return raised(sample, 50.0 if t_s <= 1.3 else 0.0)

    result, _, navigation = filtered(flight(duration_s=20.0), change)
    result, status = result.after(18.0), navigation.status()
    assert status.state is FilterState.RUNNING
    # One reset of that state (none where the start waits its doubt out), and the filter goes on.
    # A position 50 m off makes that of the ordinary GPS an error of 50 m for a while, too.
    assert status.resets.get("rtk_position", 0) <= 1
    assert set(status.resets) <= {"rtk_position", "gps_position"}
    assert ("imu", "restart") not in status.counts
    assert np.degrees(rms(result.rpy)).max() < 1.0  # as after an alignment with 0.49 deg headings
    assert rms(result.state[:, :3]).max() < 0.1


@pytest.mark.parametrize(("gps", "patience_s"), [(False, 2.0), (True, 20.0)])
def test_a_position_that_stays_away_is_followed_after_a_counted_reset(gps, patience_s):
    """3 m down for good from 5 s on; ordinary GPS, which may err as much, delays the reset."""

    dropped = without(*(() if gps else (Source.GPS_POSITION,)))

    def change(sample, t_s):
        return dropped(raised(sample, 3.0 if t_s > 5.0 else 0.0), t_s)

    result, _, navigation = filtered(flight(duration_s=5.0 + patience_s + 4.0), change)
    status = navigation.status()
    assert status.resets == {"rtk_position": 1}
    assert navigation.state_and_resets() == (status.state, 1)
    assert status.last_reset.startswith("position moved by 3.")
    # Refusals at 5 Hz, the first at 5.2 s; the first one after the patience sets the state.
    assert status.counts["rtk_position", "gated"] == round(5 * patience_s)
    before = (result.t_s > 5.4) & (result.t_s < 5.2 + patience_s)
    # The receiver's motion is used, so the state stays right: five sigma of 2 cm.
    assert np.abs(result.state[before, 2]).max() < 0.1
    assert (result.sigma[before, 2] > 2.9).all()  # but its sigma covers the 3 m
    assert result.after(5.5 + patience_s).state[:, 2] == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize(
    ("duration_s", "change", "said", "most_m"),
    [
        (  # further than ordinary GPS errs
            40.0,
            lambda s, t_s: raised(s, 30.0 if t_s > 5.0 else 0.0),
            (FilterState.DEGRADED, "rtk/fix refused: 30.0 m off"),
            0.1,
        ),
        (  # to and fro: four steps are measured, each by two heights of 2 cm: three sigmas
            20.0,
            lambda s, t_s: raised(s, (20.0, -20.0)[int(t_s / 2.4) % 2] * (4.0 < t_s < 12.0)),
            (FilterState.RUNNING, ""),
            0.17,
        ),
    ],
)
def test_a_position_that_jumps_is_not_followed(duration_s, change, said, most_m):
    result, _, navigation = filtered(flight(duration_s=duration_s), change)
    status = navigation.status()
    assert (status.state, status.reason) == said
    assert status.resets == {}
    assert np.abs(result.after(3.0).state[:, 2]).max() < most_m


def test_every_verdict_is_reported_also_those_on_samples_that_were_held():
    """Each fix comes before the IMU sample of its time, so its first verdict is WAITING."""
    flown = flight(duration_s=DURATION_S)
    verdicts = []
    navigation = Navigation(config_for(flown), verdicts.append)
    samples = sorted(navigation_samples(flown), key=lambda s: s.stamp_ns - 10**7 * is_rtk(s))
    answered = [navigation.process(sample).verdict for sample in samples]
    counts = Counter((v.source.value, v.outcome.value) for v in verdicts)
    reports = dict(navigation.status().counts)
    assert reports.pop(("imu", "used")) > 0
    assert counts == reports
    assert counts["rtk_position", "used"] > counts["rtk_position", "gated"] == 0
    assert not any(v.used for v in answered if v.source is Source.RTK_POSITION)
    fixes = [v for v in verdicts if v.used and v.source is Source.RTK_POSITION]
    assert all(len(v.innovation) == 3 for v in fixes)


def is_rtk(sample):
    return sample.source is Source.RTK_POSITION


def pose(stamp_ns: int, north_m: float) -> BodyPose:
    return BodyPose(stamp_ns, np.array([north_m, 0.0, -20.0]), np.eye(4)[0], np.eye(6))


def track_of_norths() -> Track:
    return Track(lambda body: float(body.position_n[0]))


def test_points_are_a_metre_apart_and_the_last_is_the_aircraft():
    track = track_of_norths()
    assert track.points() == []
    for k in range(45):
        track.add(pose(k, 0.1 * k))
    np.testing.assert_allclose(track.points(), [0.0, 1.0, 2.0, 3.0, 4.0, 4.4], atol=1e-9)
    for k in range(45, 1000):
        track.add(pose(k, 4.4))  # a hover adds nothing
    assert len(track.points()) == 6


def test_the_track_of_a_long_flight_is_whole_in_few_points():
    track = track_of_norths()
    longest = 0
    for k in range(5000):
        track.add(pose(k, float(k)))
        longest = max(longest, len(track.points()))
    result = track.points()
    assert longest <= MOST_POINTS + 1
    assert (result[0], result[-1]) == (0.0, 4999.0)
    assert set(np.diff(result[:-1])) == {8.0}
    assert len(result) > MOST_POINTS / 2


def test_a_stamp_that_goes_back_begins_a_new_track():
    track = track_of_norths()
    for k in range(5):
        track.add(pose(k, float(k)))
    track.add(pose(1, 50.0))
    assert track.points() == [50.0]
    track.clear()
    assert track.points() == []
