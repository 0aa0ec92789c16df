"""An IMU that is turned in its mount, and headings that are off: named, with the angle."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from checked_flights import changed, checked, simulated
from flights import flight

from dev.flight_errors import fitting_config
from tirgeo_ros.core.checks.navigation_checks import nearest_causes
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import matrix_from_euler
from tirgeo_ros.core.types.finding import Finding, Severity

IMU_RPY = "ekf_node aircraft.imu_rpy_deg"
#: The autopilot's own tilt error, 0.3 deg rms on each axis over a flight, and its noise.
OFF_DEG = 0.8


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


def heading(off_deg):
    return changed("rtk/heading", heading_rad=lambda rad: (rad + math.radians(off_deg)) % math.tau)


def bare(arrived):
    return changed("imu/data", autopilot_q_nb=lambda _: None)(arrived)


def worse(found):
    return [one for one in found if one.severity is not Severity.NOTE]


def angles(finding):
    return [float(text) for text in re.search(r"\[(.*)\]", finding.mend)[1].split(",")]


@pytest.mark.parametrize("rpy_deg", [(5, 0, 0), (0, -5, 0), (0, 10, 0), (-20, 0, 0), (7, 7, 0)])
def test_a_tilted_imu_is_named_alone_and_with_its_angles(rpy_deg, flown, arrived):
    (one,) = worse(checked(arrived, fitting_config(flown), mounted(*rpy_deg)))
    assert (one.check, one.severity, one.parameter) == ("imu_tilt", Severity.STOP, IMU_RPY)
    assert angles(one) == pytest.approx(rpy_deg, abs=OFF_DEG)


def test_a_tilt_is_on_top_of_what_the_parameter_says(flown, arrived):
    config = fitting_config(flown)
    set_to = replace(config, aircraft=replace(config.aircraft, imu_rpy_deg=(0.0, 0.0, 90.0)))
    assert worse(checked(arrived, set_to, mounted(0, 0, 90))) == []
    (one,) = worse(checked(arrived, set_to, mounted(6, 0, 90)))
    assert angles(one) == pytest.approx((6, 0, 90), abs=OFF_DEG)


def test_an_autopilot_that_errs_as_much_as_real_ones_is_no_fault(flown, arrived):
    """2.2 deg of difference were seen in twelve recorded flights."""
    assert worse(checked(arrived, fitting_config(flown), mounted(1.6, -1.4, 0))) == []


def test_without_the_autopilots_attitude_the_tilt_is_not_known(flown, arrived):
    def change(one):
        return mounted(0, 10, 0)(bare(one))

    (one,) = checked(arrived, fitting_config(flown), change)
    assert (one.check, one.severity, one.parameter) == ("imu_tilt", Severity.NOTE, IMU_RPY)
    assert "not known" in one.evidence


@pytest.mark.parametrize("off_deg", [4, -4, 7])
def test_headings_that_are_off_are_named_with_the_angle(off_deg, flown, arrived):
    (one,) = worse(checked(arrived, fitting_config(flown), heading(off_deg)))
    assert (one.check, one.severity) == ("heading_offset", Severity.STOP)
    assert one.parameter == "ekf_node aircraft.second_antenna_m"
    off, sigma = map(float, re.search(r"is (.*) deg \(sigma (.*)\)", one.evidence).groups())
    assert sigma < 1.0  # a quarter of what is told
    assert off == pytest.approx(off_deg, abs=3 * sigma)


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


def finding(check, severity=Severity.STOP):
    return Finding(check, severity, "", "", "")


def test_the_camera_is_not_blamed_for_the_bodys_attitude():
    camera, motion = finding("boresight_by_motion"), finding("picture_motion")
    heading, latency = finding("heading_offset"), finding("video_latency")
    assert nearest_causes([camera, heading, latency, motion]) == [heading, latency]
    compass = finding("heading_offset", Severity.CAUTION)
    assert nearest_causes([compass, camera]) == [compass, camera]
