"""An IMU that is turned in its mount: named, with its angles."""

from __future__ import annotations

import re

import numpy as np
import pytest
from checked_flights import changed, checked, simulated
from flights import flight

from dev.flight_errors import fitting_config
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import matrix_from_euler
from tirgeo_ros.core.types.finding import Severity

IMU_RPY = "ekf_node aircraft.imu_rpy_deg"


@pytest.fixture(scope="module")
def flown():
    return flight(3, 60.0)


@pytest.fixture(scope="module")
def arrived(flown):
    return simulated(flown)


def mounted(*rpy_deg):
    """The IMU's readings where it is turned by roll, pitch, yaw about forward, left, up."""
    to_imu = matrix_from_euler(*np.radians(flu_from_frd(np.array(rpy_deg)))).T
    return changed(
        "imu/data", specific_force_b=lambda f: to_imu @ f, angular_rate_b=lambda w: to_imu @ w
    )


def bare(arrived):
    return changed("imu/data", autopilot_q_nb=lambda _: None)(arrived)


def worse(found):
    return [one for one in found if one.severity is not Severity.NOTE]


def angles(finding):
    return [float(text) for text in re.search(r"\[(.*)\]", finding.mend)[1].split(",")]


TURNED = [(90, 0, 0), (0, 90, 0), (0, 0, 90), (0, 0, -90), (0, 0, 180), (90, 0, 90)]


@pytest.mark.parametrize("rpy_deg", TURNED)
def test_a_turned_imu_is_named_with_its_angles(rpy_deg, flown, arrived):
    first, *_ = checked(arrived, fitting_config(flown), mounted(*rpy_deg))
    assert first.severity is Severity.STOP
    assert IMU_RPY in first.parameter
    assert (np.array(angles(first)) - rpy_deg) % 360 == pytest.approx([0, 0, 0])


def test_gravity_alone_shows_no_yaw(flown, arrived):
    def change(one):
        return mounted(90, 0, 90)(bare(one))

    (one,) = worse(checked(arrived, fitting_config(flown), change))
    assert "to [90.0, 0.0, 0.0] (gravity does not show the yaw)" in one.mend
