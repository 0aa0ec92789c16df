"""Stamps that are late or early, and an IMU that averages over its interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filter_states import ekf_config
from flights import GPS, RTK, config_for, errors, flight, navigation_samples, rms, solutions

from tirgeo_ros.core.navigation.aiding.aids import Delays, longest_hold_s
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.tools.simulate.flight import fly, truth_at
from tirgeo_ros.tools.simulate.scenario import scenario_from
from tirgeo_ros.tools.simulate.sensors import Epochs, imu_bias

DURATION_S = 12.0


def test_headings_have_the_delay_of_rtk_unless_they_have_their_own():
    shared = Delays.from_config(ekf_config(rtk__delay_s=0.08, gps__delay_s=-0.1))
    assert [shared.aid_ns[s] for s in RTK] == [80_000_000] * 3
    assert shared.aid_ns[Source.GPS_VELOCITY] == -100_000_000
    values = {"rtk__delay_s": 0.08, "heading__delay_s": 0.0, "rtk__velocity_delay_s": 0.05}
    own = Delays.from_config(ekf_config(**values))
    assert [own.aid_ns[s] for s in RTK] == [80_000_000, 130_000_000, 0]


@pytest.mark.parametrize(
    ("values", "hold_s"),
    [
        ({}, 0.5),
        ({"max_delay_s": 0.0}, 0.2),
        ({"rtk__delay_s": 1.0, "gps__delay_s": 1.0}, 0.5),
        ({"rtk__delay_s": 1.0, "rtk__velocity_delay_s": -1.5}, 1.0),
        ({"gps__delay_s": -1.0, "imu__delay_s": 0.25}, 1.75),
        # A barometer without a delay does not count; one that is early does.
        ({"rtk__delay_s": 0.1, "gps__delay_s": 0.1, "imu__delay_s": 0.1}, 0.5),
        ({"barometer__delay_s": -0.3, "imu__delay_s": 0.1}, 0.9),
    ],
)
def test_what_delays_bring_ahead_of_the_imu_is_held_for_longer(values, hold_s):
    assert longest_hold_s(ekf_config(**values)) == pytest.approx(hold_s, abs=1e-9)


@pytest.mark.parametrize(
    ("imu_s", "position_s", "velocity_s", "heading_s"),
    [(0.0, -0.3, -0.3, -0.3), (0.005, 0.08, 0.2, -0.25), (-0.4, 0.3, -1.2, 2.0)],
)
def test_stamps_less_their_delay_are_those_of_measurement(
    imu_s, position_s, velocity_s, heading_s
):
    """Each kind has its own: the same solutions to the last bit, from the alignment on."""
    flown = flight(duration_s=DURATION_S)
    kinds = {
        "imu__delay_s": imu_s,
        "rtk__delay_s": position_s,
        "rtk__velocity_delay_s": velocity_s - position_s,
        "heading__delay_s": heading_s,
    }
    by_s = dict(zip(RTK, (position_s, velocity_s, heading_s), strict=True)) | {Source.IMU: imu_s}
    fed = [s for s in navigation_samples(flown) if s.source not in GPS]
    late = [replace(s, stamp_ns=s.stamp_ns + round(by_s[s.source] * 1e9)) for s in fed]
    timely = solutions(flown, config_for(flown), fed)
    moved = solutions(flown, config_for(flown, **kinds), late)
    assert len(moved) == len(timely) > 0
    for a, b in zip(timely, moved, strict=True):
        assert (a.stamp_ns, a.height_m, a.latitude_rad) == (b.stamp_ns, b.height_m, b.latitude_rad)
        assert np.array_equal(a.q_nb, b.q_nb)


def heading_rms_deg(averages, delay_s, seeds):
    squares = []
    for seed in seeds:
        values = {"imu.averages": averages, "route.heading_deg": 360 * seed * 0.618 % 360}
        flown = fly(scenario_from(values), seed)
        found = solutions(flown, config_for(flown, imu__delay_s=delay_s))
        stamps = [one.stamp_ns for one in found]
        t_s = (np.array(stamps) - flown.scenario.start_ns) * 1e-9
        bias = imu_bias(flown.scenario.imu, seed, len(stamps))
        truth = truth_at(flown.trajectory, Epochs(stamps, t_s), bias)
        squares.append(rms(errors(replace(flown, truth=truth), found).after(20.0).rpy[:, 2]) ** 2)
    return float(np.degrees(np.sqrt(np.mean(squares))))


@pytest.mark.slow
@pytest.mark.long
def test_an_imu_that_averages_is_half_its_interval_late():
    """With its delay as good as an IMU that does not average; without, its turns tell.

    Headings alone give 0.062 deg over many flights (docs/accuracy.md); the delay of 5 ms is an
    error of 5 ms times the rate in turns of 45 deg/s and more, 0.2 deg there and less along the
    legs.
    """
    seeds = range(1, 4)
    plain, known = heading_rms_deg(False, 0.0, seeds), heading_rms_deg(True, 0.005, seeds)
    unknown = heading_rms_deg(True, 0.0, seeds)
    assert known <= 0.07
    assert known == pytest.approx(plain, rel=0.02)
    assert unknown > 1.3 * known
