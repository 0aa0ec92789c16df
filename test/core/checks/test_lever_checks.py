"""Where the flight puts the RTK antenna, and how late its stamps are, without the filter."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from arrived_flights import Arrived, changed, checked, simulated
from flights import flight

from tirgeo_ros.core.attitude import quat_from_euler
from tirgeo_ros.core.checks.finding import Severity
from tirgeo_ros.core.checks.imu_blocks import ImuBlock
from tirgeo_ros.core.checks.lever_checks import LeverChecks
from tirgeo_ros.core.checks.lever_fit import Normal, by_positions, by_velocities, integrated
from tirgeo_ros.core.checks.lever_solution import Windows, solved
from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.frames import flu_from_frd
from tirgeo_ros.tools.flight_errors import fitting_config
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import Scenario

LEVER_FLU_M = np.array((-0.10, 0.32, 0.38))  # the scenario's


@pytest.fixture(scope="module")
def flown():
    return flight(1, 60.0)


@pytest.fixture(scope="module")
def arrived(flown):
    return simulated(flown)


def misplaced(config, signs):
    """Both antennas with signs (3,) of their places turned."""
    aircraft = config.aircraft
    both = {
        name: tuple((np.array(getattr(aircraft, name)) * signs).tolist())
        for name in ("rtk_antenna_m", "second_antenna_m")
    }
    return replace(config, aircraft=replace(aircraft, **both))


@pytest.mark.parametrize(
    ("signs", "axis"), [((1, -1, 1), "left"), ((1, 1, -1), "up"), ((-1, -1, 1), "left")]
)
def test_a_wrong_sign_of_the_antennas_place_is_named(signs, axis, flown, arrived):
    found = checked(arrived, misplaced(fitting_config(flown), signs))
    (one,) = (one for one in found if one.check == "antenna_place")
    assert one.severity is Severity.CAUTION
    assert one.parameter == "ekf_node aircraft.rtk_antenna_m"
    assert one.mend == f"is the sign of {axis} wrong?"


def place_found(arrived: list[Arrived], config):
    checks = LeverChecks(config, None)
    navigation = NavigationChecks(config, None)
    navigation._levers = checks  # its own are as good; these are at hand
    for one in arrived:
        navigation.take(*one)
    found = checks.found
    assert found is not None
    return found


def test_the_place_is_found_within_its_sigmas(flown, arrived):
    found = place_found(arrived, fitting_config(flown))
    off = flu_from_frd(found.lever_b) - LEVER_FLU_M
    assert (np.abs(off) < 4 * found.lever_sigma_b).all()  # 3 values, 4 sigma: once in 5000
    assert (found.lever_sigma_b < 0.05).all()  # a third of what is told
    assert (np.abs(found.delays_s) < np.maximum(4 * found.delay_sigmas_s, 0.01)).all()


@pytest.mark.parametrize("late_s", [-0.1, 0.1])
def test_late_stamps_are_found_and_taken_off(late_s, flown, arrived):
    move = changed("rtk/fix rtk/vel", stamp_ns=lambda ns: ns + round(late_s * 1e9))
    late = [move(one) for one in arrived]
    found = place_found(late, fitting_config(flown))
    # Of the first order in the delay: what the motion changes within it is left, a third here.
    assert found.delays_s == pytest.approx([late_s, 0.0], abs=0.4 * abs(late_s))
    # The parameter takes them off.
    known = place_found(late, fitting_config(flown, rtk__delay_s=late_s))
    assert (np.abs(known.delays_s) < np.maximum(4 * known.delay_sigmas_s, 0.01)).all()


def windows_of(*normals, most=150):
    """Windows (positions, velocities) in the order in which they came."""
    windows = Windows(most)
    for positions, velocities in normals:
        windows.add(positions, velocities)
    return windows


def test_a_flight_without_turns_or_tilts_says_nothing():
    still = ImuBlock(0, 0.05, (0.0, 0.0, -9.81), (0.0, 0.0, 0.0), None, True)
    path = integrated([still] * 80, quat_from_euler(0, 0, 0), None, np.zeros(3))
    times_s = np.arange(0.2, 3.9, 0.2)
    fixes = np.random.default_rng(1).normal(0, 0.01, (len(times_s), 3))
    normal = by_positions(path, times_s, fixes)
    found = solved(windows_of(*[(normal, by_velocities(path, times_s, fixes))] * 6))
    assert found is not None
    assert (found.lever_sigma_b > 5).all()  # what is believed before: 10 m


def test_too_few_windows_or_fixes_are_none():
    still = ImuBlock(0, 0.05, (0.0, 0.0, -9.81), (0.0, 0.0, 0.0), None, True)
    path = integrated([still] * 80, quat_from_euler(0, 0, 0), None, np.zeros(3))
    assert by_positions(path, np.array((1.0, 2.0)), np.zeros((2, 3))) is None
    assert solved(windows_of(*[(None, None)] * 9)) is None


def test_the_newest_windows_count_alone_and_take_no_more_memory():
    rng = np.random.default_rng(3)

    def normal():
        rows, off = rng.normal(size=(20, 4)), rng.normal(0, 0.01, 20)
        return Normal(rows.T @ rows, rows.T @ off, float(off @ off), 20)

    came = [(normal(), normal() if k % 3 else None) for k in range(20)]
    windows = windows_of(*came[:1], most=8)
    tracemalloc.start()
    for one in came[1:]:
        windows.add(*one)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Of the numbers that say where the next one goes; each window as objects took 1000 and more.
    assert grown < 500
    newest, alone = solved(windows), solved(windows_of(*came[-8:], most=8))
    assert newest is not None
    assert alone is not None
    assert newest.windows == 8
    for one, other in zip(newest, alone, strict=True):  # their order differs: rounding
        assert one == pytest.approx(other, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_another_antenna_and_another_baseline(seed):
    base = Scenario()
    lever_m = (0.3, -0.2, 0.5)
    rtk = replace(base.rtk, lever_arm_m=lever_m, second_antenna_m=(0.3, 0.8, 0.5))
    flown = fly(replace(base, rtk=rtk), seed)
    config = fitting_config(flown)
    found = place_found(simulated(flown), config)
    off = flu_from_frd(found.lever_b) - np.array(lever_m)
    assert (np.abs(off) < 5 * found.lever_sigma_b).all()
    assert checked(simulated(flown), config, given=()) == []


def test_the_imus_own_axes_are_taken_off(flown, arrived):
    """An IMU turned by 90 deg to the right, and a parameter that says so."""
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    move = changed(
        "imu/data", specific_force_b=lambda f: turn @ f, angular_rate_b=lambda w: turn @ w
    )
    config = fitting_config(flown)
    aircraft = replace(config.aircraft, imu_rpy_deg=(0.0, 0.0, -90.0))
    assert checked(arrived, replace(config, aircraft=aircraft), move) == []
    wrong = [one.check for one in checked(arrived, config, move)]
    assert "gyro_axes" in wrong
