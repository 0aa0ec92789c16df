"""Other simulated flights: nothing is found in them, and what is planted is."""

import json
from dataclasses import replace

import pytest
from checked_flights import checked_flight, picture_findings

from tirgeo_ros.core.checks.gimbal_checks import GimbalChecks
from tirgeo_ros.core.checks.picture_checks import PictureChecks
from tirgeo_ros.tools.simulate import simulate

FLIGHTS = {
    "turns on the spot": {
        "seed": 7,
        "route.shape": "hover",
        "route.height_above_ground_m": 30.0,
        "gimbal.pitch_deg": -40.0,
    },
    "straight down in an eight": {
        "seed": 11,
        "route.shape": "figure_eight",
        "route.turn_radius_m": 15.0,
        "route.legs": 1,
        "route.speed_m_s": 6.0,
        "route.height_above_ground_m": 40.0,
        "gimbal.pitch_deg": -85.0,
    },
    "high and fast": {
        "seed": 3,
        "route.height_above_ground_m": 60.0,
        "route.speed_m_s": 8.0,
        "route.leg_length_m": 60.0,
        "route.leg_spacing_m": 30.0,
        "route.turn_radius_m": 12.0,
        "gimbal.pitch_deg": -45.0,
    },
    "still": {
        "seed": 5,
        "route.shape": "hover",
        "route.hover_s": 600.0,
        "route.hold_error_m": 0.05,
    },
}
TURNING = [name for name in FLIGHTS if name != "still"]

pytestmark = [pytest.mark.slow, pytest.mark.long]  # 25 s of pictures each


@pytest.fixture(scope="module", params=FLIGHTS)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def flight(name, tmp_path_factory):
    folder = tmp_path_factory.mktemp("flight")
    values = {"duration_s": 50.0, "survey.points": 4} | FLIGHTS[name]
    scenario = folder / "scenario.json"  # which is YAML too
    scenario.write_text(json.dumps(dict(nested(values))))
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


def test_a_late_video_is_found_where_the_camera_turns(flight, name):
    overlay = replace(flight.configs.overlay, video_latency_s=0.25)
    findings = picture_findings(flight, overlay=overlay)
    assert [one.check for one in findings] == ["video_latency"] * (name in TURNING)


def test_another_focal_length_is_found_where_the_camera_turns(flight, name):
    findings = picture_findings(
        flight, lens=lambda camera: replace(camera, fx=camera.fx * 1.3, fy=camera.fy * 1.3)
    )
    assert [one.check for one in findings] == ["focal_length"] * (name in TURNING)


def test_ground_far_too_low_is_found_where_the_camera_travels(flight, name):
    overlay = replace(flight.configs.overlay, ground_height_m=11.5 - 47.0)
    findings = picture_findings(flight, overlay=overlay)
    travels = "spot" not in name and name != "still"
    assert [one.check for one in findings] == ["ground_by_motion"] * travels
