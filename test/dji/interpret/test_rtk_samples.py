"""RTK readings to samples: status by flag, height, heading, and each measurement once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from aircraft_readings import KIT, epoch, of, place, rtk, t_ms
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.config import AircraftConfig, DjiConfig
from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.dji.interpret import Interpreter
from tirgeo_ros.dji.sources.readings import GeodeticPlace

NAN, INF = math.nan, math.inf
UNDULATION_M = 43.25


def interpreter(**config):
    return Interpreter(DjiConfig(**{"geoid_undulation_m": UNDULATION_M, "aircraft": KIT} | config))


def positions(samples):
    return of(PositionSample, samples)


def test_an_epoch_becomes_three_samples():
    meant = interpreter()
    position, velocity, heading = meant.take(rtk(100, **epoch(0)))
    assert (position.source, velocity.source) == (Source.RTK_POSITION, Source.RTK_VELOCITY)
    assert position.status is FixStatus.FIXED
    assert (position.latitude_rad, position.longitude_rad) == place(0)[:2]
    assert position.height_m == 30.0 + UNDULATION_M
    np.testing.assert_allclose(position.covariance_n, np.diag([1e-4, 1e-4, 4e-4]), rtol=1e-12)
    np.testing.assert_array_equal(velocity.velocity_n, [3.0, -1.0, 0.2])
    np.testing.assert_allclose(velocity.covariance_n, 0.03**2 * np.eye(3), rtol=1e-12)
    assert math.degrees(heading.heading_rad) == pytest.approx(10.0)  # 100 less the kit's 90
    assert heading.variance_rad2 == pytest.approx(math.radians(0.6) ** 2)
    assert [t_ms(s) for s in (position, velocity, heading)] == [100, 100, 100]
    assert meant.counts == {}
    assert meant.diagnostics["rtk_flag"] == "50 narrow-lane integer"


# Flags

STATUS = {
    FixStatus.FIXED: [50],
    FixStatus.FLOAT: [48, 49, 32, 33, 34, 17, 18, 20],
    FixStatus.SINGLE: [16, 19],
    FixStatus.NONE: [0, 1, 2, 8, 3, 7, 15, 21, 31, 35, 47, 51, 128, 255],
}
CASES = [(flag, status) for status, flags in STATUS.items() for flag in flags]


@pytest.mark.parametrize(("flag", "status"), CASES)
def test_status_by_flag(flag, status):
    samples = interpreter().take(rtk(0, **epoch(0, position_flag=flag)))
    (position,) = positions(samples)
    assert position.status is status
    assert fault_of(position) == ""
    assert len(of(VelocitySample, samples)) == (status is not FixStatus.NONE)


def test_covariance_is_always_filled_and_worsens_by_class():
    sigmas = {}
    for flag, _ in CASES:
        (position,) = positions(interpreter().take(rtk(0, **epoch(0, position_flag=flag))))
        diagonal = np.diagonal(position.covariance_n)
        assert (diagonal > 0).all()
        assert np.isfinite(diagonal).all()
        sigmas[flag] = np.sqrt(diagonal[[0, 2]])
    for better, worse in ((50, 48), (48, 34), (49, 34), (34, 17), (17, 16), (16, 0)):
        assert (sigmas[better] < sigmas[worse]).all(), (better, worse)


# Places


@pytest.mark.parametrize(
    "bad",
    [
        GeodeticPlace(0.0, 0.0, 0.0),
        GeodeticPlace(0.0, 0.0, 30.0),
        GeodeticPlace(1e-9, -1e-9, 30.0),
        GeodeticPlace(NAN, 0.07, 30.0),
        GeodeticPlace(0.9, NAN, 30.0),
        GeodeticPlace(0.9, 0.07, NAN),
        GeodeticPlace(0.9, 0.07, INF),
        GeodeticPlace(INF, 0.07, 30.0),
        GeodeticPlace(1.6, 0.07, 30.0),
        GeodeticPlace(-1.6, 0.07, 30.0),
        GeodeticPlace(0.9, 3.2, 30.0),
        GeodeticPlace(0.9, 0.07, 1e6),
        GeodeticPlace(52.0, 4.0, 30.0),  # degrees
    ],
)
def test_what_is_no_place_is_refused(bad):
    meant = interpreter()
    samples = meant.take(rtk(0, **epoch(0) | {"place": bad}))
    assert positions(samples) == []
    assert len(samples) == 2  # velocity and heading are judged by themselves
    assert meant.counts == {"rtk_position_refused": 1}


# Heading


@given(st.integers(-32768, 32767), st.floats(-360, 360))
def test_heading_of_any_turn(yaw_deg, offset_deg):
    second_m = math.cos(math.radians(offset_deg)), -math.sin(math.radians(offset_deg)), 0.3
    meant = interpreter(aircraft=AircraftConfig(second_antenna_m=second_m))
    (heading,) = meant.take(rtk(0, yaw_deg=yaw_deg, yaw_flag=50))
    assert 0 <= heading.heading_rad < math.tau
    # A yaw of 32768 deg has its last digit at 4e-12 deg.
    expected = math.radians((yaw_deg % 360) - offset_deg)
    assert wrap_pi(heading.heading_rad - expected) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("yaw_flag", [0, 16, 34, 48, 49, 51, 255, None])
def test_only_a_fixed_yaw_is_a_heading(yaw_flag):
    meant = interpreter()
    samples = meant.take(rtk(0, **epoch(0, yaw_flag=yaw_flag)))
    assert of(HeadingSample, samples) == []
    assert len(samples) == 2
    assert meant.counts == {"rtk_yaw_not_fixed": 1}


def test_a_flag_of_another_message_holds_for_a_while():
    meant = interpreter()
    assert meant.take(rtk(0, position_flag=50)) == []
    found = [positions(meant.take(rtk(t, place=place(t))))[0].status for t in (10, 1500, 1501)]
    assert found == [FixStatus.FIXED, FixStatus.FIXED, FixStatus.NONE]
