"""Faults planted in flights are named with their parameter; clean flights are left in peace."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from checked_flights import Arrived, changed, checked, lost, recorded, simulated

from dev.flight_errors import fitting_config
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.tools.replay.node_configs import node_configs
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import Scenario

NOTE, CAUTION, STOP = Severity
RTK = "rtk/fix rtk/vel rtk/heading"
FORCE, RATE = "imu/data linear_acceleration", "imu/data angular_velocity"
SECOND = "aircraft.second_antenna_m"


@pytest.fixture(scope="module")
def flight(sample):
    return recorded(sample / "flight.mcap")


@pytest.fixture(scope="module")
def config(sample):
    return node_configs([sample / "params.yaml"]).ekf


def heading(turn):
    return changed("rtk/heading", heading_rad=lambda rad: turn(rad) % math.tau)


def stamps(topics, seconds):
    return changed(topics, stamp_ns=lambda ns: ns + round(seconds * 1e9))


def ned_for_enu(velocity_n):
    """As decoded from x = north, y = east, z = down."""
    north, east, down = velocity_n
    return np.array([east, north, -down])


def turned_imu(arrived):
    """The IMU lies on its side: its y is down."""
    rotation = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]).T
    either = changed(
        "imu/data",
        specific_force_b=lambda f: rotation @ f,
        angular_rate_b=lambda w: rotation @ w,
    )
    return either(arrived)


def without_gravity(arrived):
    if arrived.topic != "imu/data":
        return arrived
    sample = arrived.sample
    gravity_b = 9.81 * matrix_from_quat(sample.autopilot_q_nb)[2]
    return arrived._replace(
        sample=replace(sample, specific_force_b=sample.specific_force_b + gravity_b)
    )


def swapped(topic):
    def change(arrived):
        if arrived.topic != topic:
            return arrived
        s = arrived.sample
        there = replace(s, latitude_rad=s.longitude_rad, longitude_rad=s.latitude_rad)
        return arrived._replace(sample=there)

    return change


def every(number, *topics):
    """Only one sample in ``number`` of each topic comes."""
    counts = dict.fromkeys(topics, 0)

    def change(arrived):
        if arrived.topic not in counts:
            return arrived
        counts[arrived.topic] += 1
        return arrived if counts[arrived.topic] % number == 0 else None

    return change


def gaps(arrived):
    """The IMU is silent for 0.4 s in every 5 s."""
    silent = arrived.topic == "imu/data" and arrived.arrival_ns // 10**8 % 50 < 4
    return None if silent else arrived


def scaled(factor):
    return lambda value: value * factor


def axes(*signs):
    return lambda vector: vector * np.array(signs)


PLANTED = {
    "acceleration in g": (
        changed("imu/data", specific_force_b=scaled(1 / 9.80665)),
        ("force_unit", STOP, FORCE, "it is in g"),
    ),
    "gravity taken off": (without_gravity, ("force_unit", STOP, FORCE, "gravity was taken off")),
    "gravity's sign": (
        changed("imu/data", specific_force_b=scaled(-1.0)),
        ("force_axes", STOP, FORCE, "the sign is wrong"),
    ),
    "IMU on its side": (turned_imu, ("force_axes", STOP, FORCE, "aircraft.imu_rpy_deg")),
    "accelerometers 5 % off": (
        changed("imu/data", specific_force_b=scaled(1.05)),
        ("force_scale", CAUTION, FORCE, "calibrate the accelerometers"),
    ),
    "gyroscopes in deg/s": (
        changed("imu/data", angular_rate_b=np.degrees),
        ("gyro_unit", STOP, RATE, "deg/s"),
    ),
    "roll rate's sign": (
        changed("imu/data", angular_rate_b=axes(-1, 1, 1)),
        ("gyro_axes", STOP, RATE, "forward (roll) has the wrong sign"),
    ),
    "yaw rate's sign": (
        changed("imu/data", angular_rate_b=axes(1, 1, -1)),
        ("gyro_axes", STOP, RATE, "up (yaw) has the wrong sign"),
    ),
    "roll and pitch rate swapped": (
        changed("imu/data", angular_rate_b=lambda w: w[[1, 0, 2]]),
        ("gyro_axes", STOP, RATE, "turn the axes"),
    ),
    "heading + 90 deg": (
        heading(lambda rad: rad + math.pi / 2),
        ("heading_offset", STOP, SECOND, "across"),
    ),
    "heading + 180 deg": (
        heading(lambda rad: rad + math.pi),
        ("heading_offset", STOP, SECOND, "swapped"),
    ),
    "heading + 20 deg": (
        heading(lambda rad: rad + math.radians(20)),
        ("heading_offset", CAUTION, SECOND, "measure both antennas"),
    ),
    "azimuth for ENU yaw": (
        heading(lambda rad: math.pi / 2 - rad),
        ("heading_sign", STOP, "rtk/heading", "90 deg less the azimuth"),
    ),
    "heading in degrees": (
        heading(lambda rad: math.pi / 2 - math.degrees(math.pi / 2 - rad)),
        ("heading_jumps", STOP, "rtk/heading", "degrees for radians"),
    ),
    "heading repeated": (
        heading(lambda _: 0.3),
        ("heading_stuck", STOP, "rtk/heading", "repeats one value"),
    ),
    "heading silent": (
        lost("rtk/heading"),
        ("no_rtk_heading", CAUTION, "rtk/heading", "set ekf_node method to ekf"),
    ),
    "RTK above sea level": (
        changed("rtk/fix", height_m=lambda m: m - 47),
        ("height_datum", CAUTION, "geoid_undulation_m", "sea level"),
    ),
    "GPS above sea level": (
        changed("gps/fix", height_m=lambda m: m + 9),
        ("height_datum", CAUTION, "geoid_undulation_m", "sea level"),
    ),
    "another base": (
        changed("rtk/fix", latitude_rad=lambda rad: rad + 30 / 6.37e6),
        ("position_datum", CAUTION, "rtk/fix", "coordinates of the RTK base"),
    ),
    "latitude for longitude": (
        swapped("rtk/fix"),
        ("position_elsewhere", STOP, "latitude, longitude", "swapped"),
    ),
    "rtk/vel NED": (
        changed("rtk/vel", velocity_n=ned_for_enu),
        ("rtk_vel_axes", STOP, "rtk/vel", "NED for ENU"),
    ),
    "gps/vel NED": (
        changed("gps/vel", velocity_n=ned_for_enu),
        ("gps_vel_axes", STOP, "gps/vel", "NED for ENU"),
    ),
    "rtk/vel in km/h": (
        changed("rtk/vel", velocity_n=scaled(3.6)),
        ("rtk_vel_unit", STOP, "rtk/vel", "km/h"),
    ),
    "covariances 0": (
        changed("rtk/fix rtk/vel", covariance_n=np.zeros_like),
        ("covariance_zero", CAUTION, "rtk/fix covariance", "rtk/vel (150 of 150)"),
    ),
    "heading's variance 0": (
        changed("rtk/heading", variance_rad2=lambda _: 0.0),
        ("covariance_zero", CAUTION, "rtk/heading", "heading.sigma_floor_deg"),
    ),
    "stamps zero": (
        changed(RTK, stamp_ns=lambda _: 0),
        ("stamp_zero", CAUTION, "rtk.delay_s", "rtk/fix (150 of 150)"),
    ),
    "all stamps zero": (
        changed(f"imu/data gps/fix gps/vel {RTK}", stamp_ns=lambda _: 0),
        ("stamp_zero", CAUTION, "imu.delay_s", "imu/data"),
    ),
    "RTK stamped 0.5 s early": (
        stamps(RTK, -0.5),
        ("stamp_late", STOP, "rtk.delay_s", "0.58 s behind imu/data (rtk/vel, rtk/heading too)"),
    ),
    "RTK stamped 0.5 s late": (
        stamps(RTK, 0.5),
        ("stamp_ahead", STOP, "rtk.delay_s", "0.42 s ahead of imu/data"),
    ),
    "RTK in GPS time": (stamps(RTK, 18), ("stamp_ahead", STOP, "rtk/fix", "17.92 s ahead")),
    "RTK stamped 0.2 s early": (
        stamps(RTK, -0.2),
        ("rtk_fix_delay", CAUTION, "rtk.delay_s", "earlier"),
    ),
    "IMU at 20 Hz": (every(5, "imu/data"), ("imu_rate", CAUTION, "imu/data", "20 Hz")),
    "RTK at 1 Hz": (every(5, *RTK.split()), ("rtk_rate", CAUTION, "rtk/fix", "1.0 Hz")),
    "gaps of the IMU": (gaps, ("imu_gaps", CAUTION, "imu/data", "longest 0.4 s")),
    "no RTK": (lost("rtk/"), ("no_rtk_fix", NOTE, "rtk/fix", "ordinary GPS")),
    "no position": (
        lost("rtk/", "gps/"),
        ("no_rtk_fix", STOP, "rtk/fix", "nothing gives a position"),
    ),
    "no IMU": (lost("imu/data"), ("no_imu_data", STOP, "imu/data", "nothing in")),
}


@pytest.mark.parametrize("fault", PLANTED)
def test_a_planted_fault_is_named_first(fault, flight, config):
    change, (check, severity, parameter, words) = PLANTED[fault]
    first, *others = checked(flight, config, change)
    assert (first.check, first.severity) == (check, severity)
    assert parameter in first.parameter
    assert words in first.line
    # One fault is told once; only axes that are turned are so for both sensors.
    assert all(one.severity is NOTE or check == "force_axes" for one in others)


def test_a_jump_of_a_clock_is_told_with_its_size(flight, config):
    middle_ns = flight[len(flight) // 2].arrival_ns

    def change(arrived):
        later = arrived.topic in RTK.split() and arrived.arrival_ns > middle_ns
        return stamps(RTK, 0.3)(arrived) if later else arrived

    found = {one.check: one for one in checked(flight, config, change)}
    assert "jumped by -0.30 s" in found["stamp_jump"].evidence


@pytest.mark.parametrize("filtered", [False, True])
def test_the_sample_flight_is_clean(filtered, flight, config):
    assert checked(flight, config, given=(), filtered=filtered) == []


def test_places_that_nobody_gave(flight):
    (known,) = checked(flight, EkfConfig(), given=())
    (unknown,) = checked(flight, EkfConfig())
    assert (known.check, known.severity) == ("antenna_place", CAUTION)
    assert "aircraft.rtk_antenna_m" in known.parameter
    assert unknown.severity is NOTE
    # Somebody says that it is at zero: that contradicts the flight.
    (said,) = checked(flight, EkfConfig(), given=("aircraft.rtk_antenna_m",))
    assert (said.check, said.severity) == ("antenna_place", CAUTION)
    assert "not at (+0.00, +0.00, +0.00)" in said.evidence


def test_without_the_autopilots_attitude_the_course_tells(flight, config):
    bare = changed("imu/data", autopilot_q_nb=lambda _: None)
    assert checked(flight, config, bare, filtered=True) == []

    def change(arrived):
        return heading(lambda rad: rad + math.pi)(bare(arrived))

    (found,) = checked(flight, config, change)
    assert (found.check, found.severity) == ("heading_offset", STOP)
    assert "the course over ground" in found.evidence


def test_without_the_autopilots_attitude_headings_tell_of_the_gyroscopes(flight, config):
    def change(arrived):
        arrived = changed("imu/data", autopilot_q_nb=lambda _: None)(arrived)
        return changed("imu/data", angular_rate_b=lambda w: np.degrees(w) * 0.7)(arrived)

    found = {one.check: one for one in checked(flight, config, change)}
    assert found["heading_unit"].severity is STOP
    assert "imu/data angular_velocity" in found["heading_unit"].parameter


def test_numbers_that_are_none_do_no_harm(flight, config):
    noise = changed(
        "imu/data",
        specific_force_b=lambda f: f * np.nan,
        angular_rate_b=lambda w: w * np.inf,
    )
    nowhere = changed(
        "rtk/fix gps/fix", height_m=lambda _: math.nan, covariance_n=lambda c: c * np.nan
    )
    still = changed("rtk/vel gps/vel", velocity_n=lambda v: v * np.nan)
    headless = heading(lambda _: math.nan)

    def change(arrived: Arrived) -> Arrived:
        for one in (noise, nowhere, still, headless):
            arrived = one(arrived)
        return arrived

    assert checked(flight[:2000], config, change) == []


BASE = Scenario()
CLEAN = {
    "another seed": (BASE, 1),
    "a second seed": (BASE, 2),
    "hover": (replace(BASE, route=replace(BASE.route, shape="hover")), 3),
    "figure eight": (replace(BASE, route=replace(BASE.route, shape="figure_eight")), 4),
    "fast": (
        replace(
            BASE,
            route=replace(
                BASE.route,
                speed_m_s=10.0,
                acceleration_m_s2=4.0,
                leg_length_m=120.0,
                turn_radius_m=12.0,
            ),
        ),
        5,
    ),
    "windy": (replace(BASE, wind=replace(BASE.wind, mean_m_s=(6.0, -5.0), gust_m_s=3.0)), 6),
    "400 Hz": (replace(BASE, imu=replace(BASE.imu, rate_hz=400.0)), 7),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CLEAN)
def test_simulated_flights_are_clean(name):
    scenario, seed = CLEAN[name]
    flown = fly(scenario, seed)
    assert checked(simulated(flown), fitting_config(flown), given=()) == []


@pytest.mark.slow
@pytest.mark.long
def test_real_flights_have_notes_at_most(shared):
    config = replace(EkfConfig(), method="ekf")
    paths = sorted((shared / "real_flights").glob("*.mcap"))
    assert paths
    for path in paths:
        found = checked(recorded(path), config, filtered=True)
        assert [one.line for one in found if one.severity is not NOTE] == [], path.name
