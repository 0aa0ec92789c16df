"""Other simulated flights: nothing is found in them, and what is planted is."""

import json

import pytest
from checked_flights import checked_flight

from tirgeo_ros.core.checks.gimbal_checks import GimbalChecks
from tirgeo_ros.core.checks.picture_checks import PictureChecks
from tirgeo_ros.tools.simulate import simulate

BASE = {"duration_s": 50.0, "survey.points": 4}
EIGHT = {"route.shape": "figure_eight", "route.turn_radius_m": 15.0, "route.legs": 1}
LEGS = {"route.leg_length_m": 60.0, "route.leg_spacing_m": 30.0, "route.turn_radius_m": 12.0}
HOVER = {"route.shape": "hover"}


def of(seed, height_m, pitch_deg, **route):
    """Values of a scenario, of its route without ``route.``."""
    values = {"seed": seed, "gimbal.pitch_deg": pitch_deg}
    values["route.height_above_ground_m"] = height_m
    return BASE | values | {f"route.{name}": value for name, value in route.items()}


FLIGHTS = {
    "turns on the spot": of(7, 30.0, -40.0) | HOVER,
    "straight down in an eight": of(11, 40.0, -85.0, speed_m_s=6.0) | EIGHT,
    "high and fast": of(3, 60.0, -45.0, speed_m_s=8.0) | LEGS,
    "still": BASE | HOVER | {"seed": 5, "route.hover_s": 600.0, "route.hold_error_m": 0.05},
}

pytestmark = [pytest.mark.slow, pytest.mark.long]  # 25 s of pictures each


@pytest.fixture(scope="module", params=FLIGHTS)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def flight(name, tmp_path_factory):
    folder = tmp_path_factory.mktemp("flight")
    scenario = folder / "scenario.json"  # which is YAML too
    scenario.write_text(json.dumps(dict(nested(FLIGHTS[name]))))
    simulate(scenario, folder, start_s=15.0, duration_s=25.0)
    return checked_flight(folder)


def nested(values):
    groups = {}
    for key, value in values.items():
        group, _, rest = key.partition(".")
        if rest:
            groups.setdefault(group, {})[rest] = value
        else:
            yield group, value
    yield from groups.items()


def test_nothing_is_found_at_any_second(flight):
    overlay = flight.configs.overlay
    pictures = PictureChecks(overlay, overlay.ground_height_m)
    gimbal = GimbalChecks(flight.configs.gimbal)
    asked_ns = 0
    for kind, what, arrival_ns in flight.events:
        give(pictures, gimbal, kind, what, arrival_ns)
        if arrival_ns - asked_ns >= 10**9:
            asked_ns = arrival_ns
            assert pictures.findings() + gimbal.findings() == []


def give(pictures, gimbal, kind, what, arrival_ns):
    if kind == "frame":
        pictures.frame(*what, arrival_ns)
    elif kind in {"camera", "pose", "plane"}:
        getattr(pictures, kind)(what)
    elif kind == "body":
        pictures.body(what)
        gimbal.body(what)
    elif kind == "gimbal/joint_states":
        gimbal.joints(what)
    elif kind == "gimbal/attitude":
        gimbal.reported(what)
    elif kind == "imu/data":
        gimbal.autopilot(what.stamp_ns, what.autopilot_q_nb)
