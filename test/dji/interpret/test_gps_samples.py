"""Readings of the ordinary GPS to samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from aircraft_readings import gps, of, place, t_ms

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.config.dji import DjiDelayConfig
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source, VelocitySample
from tirgeo_ros.dji.interpret import Interpreter

SIGMAS = {"horizontal_sigma_m": 0.8, "vertical_sigma_m": 1.6, "velocity_sigma_m_s": 0.09}


def interpreter(**config):
    return Interpreter(DjiConfig(geoid_undulation_m=43.0, **config))


def whole(number=0, fix=3, **other):
    return {
        "place": place(number),
        "velocity_n": (1.0, 2.0, 1e-3 * number),
        "fix": fix,
        **SIGMAS,
        **other,
    }


def test_a_reading_becomes_two_samples():
    meant = interpreter(delay=DjiDelayConfig(gps_s=0.1))
    position, velocity = meant.take(gps(400, **whole()))
    assert (position.source, velocity.source) == (Source.GPS_POSITION, Source.GPS_VELOCITY)
    assert position.status is FixStatus.SINGLE
    assert position.height_m == 73.0
    np.testing.assert_allclose(position.covariance_n, np.diag([0.64, 0.64, 2.56]))
    np.testing.assert_allclose(velocity.covariance_n, 0.0081 * np.eye(3))
    assert [t_ms(position), t_ms(velocity)] == [300, 300]


@pytest.mark.parametrize(
    ("fix", "status"),
    [(0, -1), (1, -1), (2, 0), (3, 0), (4, 0), (5, -1), (6, -1), (-1, -1), (255, -1)],
)
def test_status_by_fix(fix, status):
    samples = interpreter().take(gps(0, **whole(fix=fix)))
    (position,) = of(PositionSample, samples)
    assert position.status == status
    assert fault_of(position) == ""
    assert len(of(VelocitySample, samples)) == (status == 0)


@pytest.mark.parametrize("unknown", [None, 0.0, math.nan, -1.0, math.inf])
def test_accuracy_that_is_not_told_is_not_known(unknown):
    """Zero in a message: the filter has its own."""
    position, velocity = interpreter().take(gps(0, **whole() | dict.fromkeys(SIGMAS, unknown)))
    assert not position.covariance_n.any()
    assert not velocity.covariance_n.any()
    assert position.status is FixStatus.SINGLE
