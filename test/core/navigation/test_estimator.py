"""The one door: verdicts on bad data, methods, the map's origin, clocks, publishing."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, errors, flight, navigation_samples, rms, solutions

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import FilterState, Outcome

DURATION_S = 8.0


def fed(config=None, upto: int | None = None):
    flown = flight(duration_s=DURATION_S)
    navigation = Navigation(config or config_for(flown))
    for sample in navigation_samples(flown)[:upto]:
        navigation.process(sample)
    return flown, navigation


def newest(flown, kind, source=None):
    return next(
        s
        for s in reversed(navigation_samples(flown))
        if isinstance(s, kind) and (source is None or s.source is source)
    )


def broken_samples():
    flown = flight(duration_s=DURATION_S)
    imu = newest(flown, ImuSample)
    fix = newest(flown, PositionSample, Source.RTK_POSITION)
    velocity = newest(flown, VelocitySample, Source.RTK_VELOCITY)
    heading = newest(flown, HeadingSample)
    nan3 = np.array([0.0, math.nan, 0.0])
    inf3 = np.array([0.0, 0.0, math.inf])
    return [
        replace(imu, specific_force_b=nan3),
        replace(imu, angular_rate_b=inf3),
        replace(fix, latitude_rad=math.nan),
        replace(fix, latitude_rad=2.0),
        replace(fix, height_m=math.inf),
        replace(fix, latitude_rad=0.0, longitude_rad=0.0),
        replace(fix, covariance_n=np.full((3, 3), math.nan)),
        replace(velocity, velocity_n=nan3),
        replace(velocity, covariance_n=np.diag([1.0, math.inf, 1.0])),
        replace(heading, heading_rad=math.nan),
        replace(heading, variance_rad2=math.inf),
    ]


@pytest.mark.parametrize("number", range(11))
def test_what_is_no_number_changes_nothing(number):
    sample = broken_samples()[number]
    flown, navigation = fed()
    later = replace(sample, stamp_ns=flown.truth.stamp_ns[-1] + 10_000_000)
    before = navigation._ekf.belief()
    step = navigation.process(later)
    assert step.verdict.outcome is Outcome.INVALID
    assert step.verdict.reason
    assert step.solution is None
    after = navigation._ekf.belief()
    assert after.state == before.state
    assert after.control == before.control
    assert np.array_equal(after.covariance, before.covariance)


def test_every_imu_sample_is_counted_once():
    flown, navigation = fed()
    counts = navigation.status().counts
    during_alignment = counts["imu", "waiting"]
    assert during_alignment > 0
    assert counts["imu", "used"] + during_alignment == len(flown.truth.stamp_ns)


def test_states_and_reasons():
    flown = flight(duration_s=DURATION_S)
    navigation = Navigation(config_for(flown))
    assert navigation.status().state is FilterState.WAITING
    assert "imu/data" in navigation.status().reason
    samples = navigation_samples(flown)
    seen = []
    for sample in samples:
        navigation.process(sample)
        state = navigation.status().state
        if not seen or seen[-1] is not state:
            seen.append(state)
    assert seen == [FilterState.WAITING, FilterState.ALIGNING, FilterState.RUNNING]
    status = navigation.status()
    assert status.reason == ""
    assert 0 < math.degrees(status.heading_sigma_rad) < 1
    assert set(status.test_ratios) == {
        "rtk_position",
        "rtk_velocity",
        "rtk_heading",
        "gps_position",  # looked at once a second while RTK is there
    }
    assert status.resets == {}
    assert status.last_reset == ""


def test_heading_only_while_fixed():
    flown, navigation = fed()
    fix = newest(flown, PositionSample, Source.RTK_POSITION)
    heading = newest(flown, HeadingSample)
    newest_ns = flown.truth.stamp_ns[-1]
    floating = replace(
        fix, stamp_ns=newest_ns - 20_000_000, status=FixStatus.FLOAT, height_m=fix.height_m + 0.1
    )
    assert navigation.process(floating).verdict.outcome is Outcome.USED
    later = replace(
        heading, stamp_ns=newest_ns - 10_000_000, heading_rad=heading.heading_rad + 1e-3
    )
    verdict = navigation.process(later).verdict
    assert (verdict.outcome, verdict.reason) == (Outcome.NOT_FIXED, "rtk/fix is not fixed")
    assert navigation.status().rtk_status is FixStatus.FLOAT


@pytest.mark.parametrize("status", [FixStatus.NONE, FixStatus.SINGLE])
def test_position_without_fix_is_not_used(status):
    flown, navigation = fed()
    fix = newest(flown, PositionSample, Source.RTK_POSITION)
    bad = replace(
        fix, stamp_ns=fix.stamp_ns - 10_000_000, status=status, height_m=fix.height_m + 0.1
    )
    verdict = navigation.process(bad).verdict
    name = status.name.lower()
    assert (verdict.outcome, verdict.reason) == (Outcome.NOT_FIXED, f"status {name}")


def imu_after(imu, seconds, rate_hz=100.0):
    """A live IMU that goes on: every sample a little different."""
    steps = range(1, round(seconds * rate_hz) + 1)
    return [
        replace(
            imu,
            stamp_ns=imu.stamp_ns + round(step * 1e9 / rate_hz),
            angular_rate_b=imu.angular_rate_b + 1e-5 * (step % 7),
        )
        for step in steps
    ]


def test_silent_receiver_has_no_status():
    flown, navigation = fed()
    assert navigation.rtk_status is FixStatus.FIXED
    samples = imu_after(newest(flown, ImuSample), 2.5)
    for sample in samples[:150]:
        navigation.process(sample)
    assert navigation.rtk_status is FixStatus.FIXED
    for sample in samples[150:]:
        navigation.process(sample)
    assert navigation.rtk_status is FixStatus.NONE


def test_imu_stamps_out_of_order_are_counted_and_dropped():
    flown, navigation = fed()
    imu = newest(flown, ImuSample)
    for shift in (0, -10_000_000, -900_000_000):
        step = navigation.process(replace(imu, stamp_ns=imu.stamp_ns + shift))
        assert step.verdict.outcome is Outcome.OUT_OF_ORDER
        assert step.solution is None
    assert navigation.status().state is FilterState.RUNNING


def test_a_bag_played_again_starts_again():
    """Stamps that go back by more than a second: another run, so a new alignment."""
    flown, navigation = fed()
    found = [navigation.process(s).solution for s in navigation_samples(flown)]
    counts = navigation.status().counts
    assert counts["imu", "time_jump"] == 1
    assert navigation.status().state is FilterState.RUNNING
    late = errors(flown, [s for s in found if s is not None]).after(5.0)
    assert np.degrees(rms(late.rpy)).max() < 0.5


def test_reset_keeps_the_origin():
    _, navigation = fed()
    plane = navigation.plane
    navigation.reset()
    assert navigation.status().state is FilterState.WAITING
    assert navigation.plane == plane


def test_origin_is_the_first_accepted_position():
    flown = flight(duration_s=DURATION_S)
    navigation = Navigation(config_for(flown))
    assert navigation.plane is None
    fixes = [
        s for s in navigation_samples(flown) if getattr(s, "source", None) is Source.RTK_POSITION
    ]
    navigation.process(replace(fixes[0], status=FixStatus.NONE))
    assert navigation.plane is None
    navigation.process(fixes[1])
    assert navigation.plane is not None
    assert navigation.plane.latitude_rad == fixes[1].latitude_rad


def test_configured_origin():
    config = config_from(EkfConfig, {"origin_lat_lon_h": (39.8, 116.7, 12.0)})
    plane = Navigation(config).plane
    assert plane is not None
    assert math.degrees(plane.latitude_rad) == pytest.approx(39.8, abs=1e-12)


def test_origin_must_be_on_earth():
    for origin, reason in (
        ((116.7, 39.8, 12.0), "no latitude"),
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
    flown = flight(duration_s=DURATION_S)
    _, navigation = fed(config_for(flown, method=method))
    counts = navigation.status().counts
    assert {source for source, outcome in counts if outcome == "unused"} == unused


@pytest.mark.slow
def test_methods_rank_in_position_and_heading():
    """raw has GPS's errors; rtk the RTK's; the autopilot's heading stays in both."""
    flown = flight(duration_s=60.0)
    found = {
        method: errors(flown, solutions(flown, config_for(flown, method=method))).after(20.0)
        for method in ("raw", "rtk", "ekf", "ekf_heading")
    }
    position = {m: np.linalg.norm(rms(e.state[:, :3])) for m, e in found.items()}
    heading = {m: rms(e.rpy)[2] for m, e in found.items()}
    assert position["raw"] > 10 * position["rtk"]
    assert position["rtk"] > position["ekf"]
    assert heading["raw"] == pytest.approx(heading["rtk"])
    assert heading["rtk"] > heading["ekf"] > heading["ekf_heading"]


@pytest.mark.parametrize(("rate_hz", "expected"), [(100.0, 100), (10.0, 10), (30.0, 30)])
def test_publish_rate(rate_hz, expected):
    """IMU stamps at 100 Hz with a millisecond of jitter."""
    flown = flight(duration_s=DURATION_S)
    rng = np.random.default_rng(5)
    navigation = Navigation(config_for(flown, method="rtk", publish_rate_hz=rate_hz))
    stamps = []
    for sample in navigation_samples(flown):
        moved = sample
        if isinstance(sample, ImuSample):
            moved = replace(sample, stamp_ns=sample.stamp_ns + int(rng.integers(-(10**6), 10**6)))
        solution = navigation.process(moved).solution
        if solution is not None:
            stamps.append(solution.stamp_ns)
    span_s = (stamps[-1] - stamps[0]) * 1e-9
    assert len(stamps) / span_s == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("method", ["raw", "rtk"])
@pytest.mark.parametrize("q_nb", [None, np.zeros(4), np.full(4, math.nan)])
def test_baselines_refuse_an_imu_sample_without_attitude(method, q_nb):
    flown, navigation = fed(config_for(flight(duration_s=DURATION_S), method=method), upto=400)
    imu = newest(flown, ImuSample)
    before = navigation.status().counts["imu", "used"]
    step = navigation.process(
        replace(imu, stamp_ns=navigation_samples(flown)[401].stamp_ns, autopilot_q_nb=q_nb)
    )
    assert step.solution is None
    assert (step.verdict.outcome, step.verdict.reason) == (Outcome.INVALID, "no orientation")
    assert navigation.status().counts["imu", "used"] == before
    assert navigation.status().reason == "imu/data has no orientation"


def odometry_error(flown, navigation, samples):
    """Errors of what is published over samples."""
    found = [navigation.process(s).solution for s in samples]
    return errors(flown, [s for s in found if s is not None])


@pytest.mark.parametrize("kind", ["position", "heading"])
def test_a_wrong_start_is_noticed_and_mended(kind):
    """The alignment's fixes 50 m off, or its headings 90 deg: refused later, so reset."""
    flown = flight(duration_s=20.0)
    start_ns = flown.truth.stamp_ns[0]

    def spoilt(sample):
        if sample.stamp_ns > start_ns + 1_300_000_000:
            return sample
        if kind == "position" and getattr(sample, "source", None) is Source.RTK_POSITION:
            return replace(sample, height_m=sample.height_m + 50.0)
        if kind == "heading" and isinstance(sample, HeadingSample):
            return replace(sample, heading_rad=sample.heading_rad + math.pi / 2)
        return sample

    navigation = Navigation(config_for(flown))
    samples = [spoilt(s) for s in navigation_samples(flown)]
    found = odometry_error(flown, navigation, samples).after(18.0)
    status = navigation.status()
    assert status.state is FilterState.RUNNING
    # One reset of that state (none where the start waits its doubt out), and the filter goes on.
    # A position 50 m off makes that of the ordinary GPS an error of 50 m for a while, too.
    assert status.resets.get(f"rtk_{kind}", 0) <= 1
    assert set(status.resets) <= {f"rtk_{kind}", "gps_position"}
    assert ("imu", "restart") not in status.counts
    assert np.degrees(rms(found.rpy)).max() < 1.0  # as after an alignment with 0.49 deg headings
    assert rms(found.state[:, :3]).max() < 0.1


def spoilt_between(flown, kind, first_s, last_s, **changes):
    """All samples; those of a kind (a type, a source) in between with attributes changed."""
    start_ns = flown.truth.stamp_ns[0]

    def is_meant(sample):
        if kind is HeadingSample or kind is ImuSample:
            return isinstance(sample, kind)
        return getattr(sample, "source", None) is kind

    return [
        replace(s, **{name: change(getattr(s, name)) for name, change in changes.items()})
        if is_meant(s) and first_s < (s.stamp_ns - start_ns) * 1e-9 < last_s
        else s
        for s in navigation_samples(flown)
    ]


def test_one_jumping_position_is_ignored():
    flown = flight(duration_s=DURATION_S)
    samples = spoilt_between(
        flown, Source.RTK_POSITION, 5.0, 5.3, height_m=lambda height_m: height_m + 3.0
    )
    navigation = Navigation(config_for(flown))
    late = odometry_error(flown, navigation, samples).after(5.0)
    status = navigation.status()
    assert status.counts["rtk_position", "gated"] == 1
    assert status.resets == {}
    assert np.abs(late.state[:, 2]).max() < 0.1  # five sigma of the 2 cm


@pytest.mark.parametrize(("gps", "patience_s"), [(False, 2.0), (True, 20.0)])
def test_a_position_that_stays_away_is_followed_after_a_counted_reset(gps, patience_s):
    """3 m down for good from 5 s on; ordinary GPS, which may err by that, gives it less credit."""
    flown = flight(duration_s=5.0 + patience_s + 4.0)
    samples = spoilt_between(
        flown, Source.RTK_POSITION, 5.0, 99.0, height_m=lambda height_m: height_m + 3.0
    )
    if not gps:
        samples = [s for s in samples if getattr(s, "source", None) is not Source.GPS_POSITION]
    navigation = Navigation(config_for(flown))
    found = odometry_error(flown, navigation, samples)
    status = navigation.status()
    assert status.resets == {"rtk_position": 1}
    assert status.last_reset.startswith("position moved by 3.")
    # Refusals at 5 Hz, the first at 5.2 s; the one after so long sets the state.
    assert status.counts["rtk_position", "gated"] == round(5 * patience_s)
    height = found.state[:, 2]
    before = (found.t_s > 5.4) & (found.t_s < 5.2 + patience_s)
    # What the receiver says of motion is taken, so the state has held: five of 2 cm.
    assert np.abs(height[before]).max() < 0.1
    sigma_m = found.sigma[before, 2]
    assert (sigma_m > 2.9).all()  # but its own word is that it may be 3 m elsewhere
    assert found.after(5.5 + patience_s).state[:, 2] == pytest.approx(3.0, abs=0.1)


def test_a_position_is_not_followed_further_than_ordinary_gps_errs():
    flown = flight(duration_s=40.0)
    samples = spoilt_between(
        flown, Source.RTK_POSITION, 5.0, 99.0, height_m=lambda height_m: height_m + 30.0
    )
    navigation = Navigation(config_for(flown))
    found = odometry_error(flown, navigation, samples).after(2.0)
    status = navigation.status()
    assert status.resets == {}
    assert (status.state, status.reason) == (FilterState.DEGRADED, "rtk/fix refused: 30.0 m off")
    assert np.abs(found.state[:, 2]).max() < 0.1


def test_short_refusals_do_not_reset():
    """A second of wrong headings is ridden out."""
    flown = flight(duration_s=DURATION_S)
    samples = spoilt_between(
        flown, HeadingSample, 4.0, 5.0, heading_rad=lambda heading_rad: heading_rad + 1.0
    )
    navigation = Navigation(config_for(flown))
    found = odometry_error(flown, navigation, samples).after(5.5)
    status = navigation.status()
    assert status.counts["rtk_heading", "gated"] >= 4
    assert status.resets == {}
    assert ("rtk_heading", "restart") not in status.counts
    assert np.degrees(rms(found.rpy)).max() < 0.5


def test_a_position_that_jumps_to_and_fro_is_never_followed():
    flown = flight(duration_s=20.0)
    start_ns = flown.truth.stamp_ns[0]
    navigation = Navigation(config_for(flown))
    samples = []
    for given in navigation_samples(flown):
        t_s, sample = (given.stamp_ns - start_ns) * 1e-9, given
        if getattr(given, "source", None) is Source.RTK_POSITION and 4.0 < t_s < 12.0:
            side = -1 if int(t_s / 2.4) % 2 else 1
            sample = replace(given, height_m=given.height_m + side * 20.0)
        samples.append(sample)
    found = odometry_error(flown, navigation, samples).after(3.0)
    status = navigation.status()
    assert (status.state, status.resets) == (FilterState.RUNNING, {})
    # Four steps are measured, each by the difference of two heights of 2 cm: three sigmas.
    assert np.abs(found.state[:, 2]).max() < 0.17


def test_time_in_a_state():
    flown = flight(duration_s=DURATION_S)
    navigation = Navigation(config_for(flown))
    newest_ns = 0
    for sample in navigation_samples(flown):
        begun = navigation.status().state is FilterState.RUNNING
        navigation.process(sample)
        newest_ns = sample.stamp_ns if isinstance(sample, ImuSample) else newest_ns
        status = navigation.status()
        if status.state is FilterState.RUNNING and not begun:
            begun_ns = newest_ns
            assert status.state_s == 0.0
    passed_s = (flown.truth.stamp_ns[-1] - begun_ns) * 1e-9
    assert status.state_s == pytest.approx(passed_s, abs=1e-6)


def test_stamps_at_arrival_with_their_delay_are_stamps_of_measurement():
    """All stamped 80 ms late, and delay_s of that: the same solutions to the last bit."""
    flown = flight(duration_s=DURATION_S)
    delayed = [
        replace(s, stamp_ns=s.stamp_ns + 80_000_000) if not isinstance(s, ImuSample) else s
        for s in navigation_samples(flown)
    ]
    timely = solutions(flown, config_for(flown))
    late = solutions(flown, config_for(flown, rtk__delay_s=0.08, gps__delay_s=0.08), delayed)
    assert len(late) == len(timely) > 0
    for a, b in zip(timely, late, strict=True):
        assert (a.stamp_ns, a.height_m, a.latitude_rad) == (b.stamp_ns, b.height_m, b.latitude_rad)
        assert np.array_equal(a.q_nb, b.q_nb)


def test_every_verdict_is_heard_also_those_on_samples_that_were_held():
    """Each fix comes before the IMU's sample of its time, so that its own answer says: held."""
    flown = flight(duration_s=DURATION_S)
    heard = []
    navigation = Navigation(config_for(flown), heard.append)
    samples = sorted(navigation_samples(flown), key=lambda s: s.stamp_ns - 10**7 * is_rtk(s))
    answered = [navigation.process(sample).verdict for sample in samples]
    counts = Counter((v.source.value, v.outcome.value) for v in heard)
    told = dict(navigation.status().counts)
    assert told.pop(("imu", "used")) > 0
    assert counts == told
    assert counts["rtk_position", "used"] > counts["rtk_position", "gated"] == 0
    assert not any(v.used for v in answered if v.source is Source.RTK_POSITION)
    fixes = [v for v in heard if v.used and v.source is Source.RTK_POSITION]
    assert all(len(v.innovation) == 3 for v in fixes)


def is_rtk(sample):
    return isinstance(sample, PositionSample) and sample.source is Source.RTK_POSITION
