"""The filter over simulated flights: accuracy, consistency, gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, errors, flight, rms, solutions

from tirgeo_ros.tools.simulate.flight import fly


def test_paper_flight_after_20_s():
    """The figures that the method is held to: 0.12 deg and 2 cm."""
    flown = flight()
    late = errors(flown, solutions(flown, config_for(flown))).after(20.0)
    assert np.degrees(rms(late.rpy)).max() <= 0.12
    assert rms(late.state[:, :3]).max() <= 0.02


@pytest.mark.slow
def test_direct_position_flies_too():
    """The paper's own cycle, with its median filter: within the RTK's noise in position."""
    flown = flight()
    config = config_for(flown, position_update="rtk_direct", rtk__median_window=3)
    late = errors(flown, solutions(flown, config)).after(20.0)
    assert np.degrees(rms(late.rpy)).max() <= 0.12
    assert (rms(late.state[:, :3]) <= 1.5 * np.array([0.01, 0.01, 0.02])).all()


@pytest.mark.slow
def test_methods_rank_in_position_and_heading():
    """raw has GPS's errors; rtk the RTK's; the autopilot's heading stays in both."""
    flown = flight()
    found = {
        method: errors(flown, solutions(flown, config_for(flown, method=method))).after(20.0)
        for method in ("raw", "rtk", "ekf", "ekf_heading")
    }
    position = {m: np.linalg.norm(rms(e.state[:, :3])) for m, e in found.items()}
    heading = {m: rms(e.rpy)[2] for m, e in found.items()}
    assert position["raw"] > 10 * position["rtk"]
    assert position["rtk"] > position["ekf"]
    assert heading["raw"] == pytest.approx(heading["rtk"])
    assert heading["rtk"] > heading["ekf"] >= 3 * heading["ekf_heading"]


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [50.0, 400.0])
def test_other_imu_rates(rate_hz):
    base = flight(duration_s=40.0).scenario
    flown = fly(replace(base, imu=replace(base.imu, rate_hz=rate_hz)), 3)
    late = errors(flown, solutions(flown, config_for(flown))).after(20.0)
    assert np.degrees(rms(late.rpy)).max() <= 0.15  # a short flight: fewer turns to learn from
    assert rms(late.state[:, :3]).max() <= 0.02


def test_angular_rate_is_within_its_own_sigma():
    """The rate's variance: white noise of one sample and the bias's; per axis over a flight."""
    flown = flight(duration_s=40.0)
    index = {stamp: i for i, stamp in enumerate(flown.truth.stamp_ns)}
    found = [s for s in solutions(flown, config_for(flown)) if index[s.stamp_ns] > 2000]
    error = [s.angular_rate_b - flown.truth.angular_rate_b[index[s.stamp_ns]] for s in found]
    ratio = rms(np.array(error) / np.sqrt([s.rate_variance_b for s in found]))
    # 2000 white samples: 1.6 % one sigma; the slow bias adds little beside the white noise.
    assert ratio == pytest.approx([1.0] * 3, abs=0.08)
