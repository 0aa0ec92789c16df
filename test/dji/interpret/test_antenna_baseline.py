"""RTK yaw against the aircraft's own heading: whether the antennas are where they should be."""

from __future__ import annotations

import math

import pytest
from aircraft_readings import KIT, epoch, imu, rtk, wxyz

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.dji.interpret import Interpreter


def interpreter(**config):
    return Interpreter(DjiConfig(geoid_undulation_m=43.25, aircraft=KIT, **config))


def flown(meant, seconds, baseline_deg, *, rate_deg_s=7.0, flag=50):
    """A turning aircraft whose baseline is ``baseline_deg`` from the nose."""
    for k in range(round(20 * seconds)):
        heading = math.radians(rate_deg_s * 0.05 * k)
        meant.take(imu(50 * k, q_nb=wxyz(0.1, -0.1, heading)))
        if k % 4 == 0:
            yaw_deg = round(math.degrees(heading) + baseline_deg)
            parts = epoch(k, yaw_deg=yaw_deg, yaw_flag=flag)
            meant.take(rtk(50 * k, **parts))


@pytest.mark.parametrize("baseline_deg", [0, 180, 270, 110, 60])
def test_a_baseline_mounted_in_another_way_is_told(baseline_deg):
    meant = interpreter()
    flown(meant, 15.0, baseline_deg)
    (warning,) = meant.warnings
    seen = float(meant.diagnostics["baseline_seen_deg"])
    # Whole degrees average out to a few hundredths.
    assert wrap_pi(math.radians(seen - baseline_deg)) == pytest.approx(0, abs=math.radians(0.3))
    assert warning.startswith(
        "by aircraft.rtk_antenna_m and aircraft.second_antenna_m the baseline"
    )
    assert "lies at 90 deg from the nose, but RTK yaw" in warning
    assert f"is {seen:.1f} deg" in warning


@pytest.mark.parametrize("baseline_deg", [90, 80, 100, 450, -270])
def test_a_baseline_as_configured_is_not(baseline_deg):
    """Ten degrees are a compass's."""
    meant = interpreter()
    flown(meant, 15.0, baseline_deg)
    assert meant.warnings == []
    assert "baseline_seen_deg" in meant.diagnostics


def test_it_takes_ten_seconds_and_fixed_yaws():
    for seconds, flag in ((9.5, 50), (30.0, 34)):
        meant = interpreter()
        flown(meant, seconds, 0.0, flag=flag)
        assert meant.warnings == []
        assert "baseline_seen_deg" not in meant.diagnostics
