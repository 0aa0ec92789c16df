"""Warm things: where they are in the picture, in the file, and when an operator clicks on them."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler, quat_multiply
from tirgeo_ros.tools.simulate import fly, scenario_from
from tirgeo_ros.tools.simulate.ground import GRASS, GREY_PER_K, Ground
from tirgeo_ros.tools.simulate.renderer import Renderer
from tirgeo_ros.tools.simulate.scenario_ground import VideoScenario
from tirgeo_ros.tools.simulate.survey import sightings
from tirgeo_ros.tools.simulate.targets import Target, targets_of

STILL = VideoScenario(noise_grey=0.0, vignetting=0.0)
GREY = round(GRASS)
GRASS_ALONE = Ground([np.full((64, 64), GREY, np.uint8)] * 4, 320.0, -320.0, 10.0)
PLACE = np.array([0.0, 0.0, -20.0])


def looking(pitch_deg=-30.0, yaw_deg=0.0, roll_deg=0.0):
    q_pg = quat_from_euler(*np.radians([roll_deg, pitch_deg, yaw_deg]))
    return quat_multiply(q_pg, Q_BODY_OPTICAL)


def picture_of(targets, q_pc):
    drawn = Renderer(XT2, GRASS_ALONE, STILL, targets)
    return drawn.frame(PLACE, q_pc, np.random.default_rng(0)).astype(float)


def projected(center, q_pc):
    place = np.array([*center, 0.0])
    return XT2.project((place - PLACE)[None] @ matrix_from_quat(q_pc))[0][0]


@pytest.mark.parametrize(
    ("center", "pose"),
    [
        ((30.0, 3.0), looking()),
        ((26.3, -5.2), looking(-33.0, 12.0, 4.0)),
        ((45.7, 1.1), looking(-29.0, -9.0)),
    ],
)
def test_a_person_is_seen_where_the_camera_projects_them(center, pose):
    person = Target("person 1", "person", np.array(center), 12.0, 0.5, 0.4)
    warm = np.maximum(picture_of([person], pose) - GREY, 0.0)
    rows, columns = np.indices(warm.shape)
    found = np.array([(columns * warm).sum(), (rows * warm).sum()]) / warm.sum()
    # Perspective moves the centroid by (r / d)^2 of the distance, 0.02 px; whole
    # grey levels do the rest.
    np.testing.assert_allclose(found, projected(center, pose), atol=0.1)


def test_a_person_is_as_warm_as_asked_and_a_fire_saturates():
    person = Target("person 1", "person", np.array([30.0, 0.0]), 12.0, 0.5, 0.0)
    fire = Target("fire 1", "fire", np.array([34.0, 4.0]), 400.0, 2.0, 0.0)
    picture = picture_of([person, fire], looking())
    u, v = np.round(projected(person.center, looking())).astype(int)
    assert picture[v, u] == pytest.approx(GRASS + 12.0 * GREY_PER_K, abs=2.0)  # blur takes some
    # A disc of 2 m, seen at 39 m and 30 deg: pi r^2 f^2 sin(30.6 deg) / d^2, and the blur's rim.
    distance_m = np.linalg.norm([34.0, 4.0, 20.0])
    pixels = np.pi * XT2.fx * XT2.fy * (20.0 / distance_m) / distance_m**2
    assert pixels < (picture == 255).sum() - 100 < 1.35 * pixels


def test_one_more_target_leaves_the_others_where_they_are():
    few, many = (
        targets_of(scenario_from({"scene.people": n, "scene.fires": 2, "scene.people_at": []}), 7)
        for n in (2, 3)
    )
    assert [one.id for one in many] == ["person 1", "person 2", "person 3", "fire 1", "fire 2"]
    places = {one.id: one.center.tolist() for one in many}
    assert {one.id: one.center.tolist() for one in few}.items() <= places.items()
    assert len({tuple(place) for place in places.values()}) == 5
    for one in many:
        assert -76 <= one.center[0] <= 106
        assert -36 <= one.center[1] <= 104
        assert one.kind == "person" or (1.0 <= one.size_m <= 3.0 and one.warmer_k >= 300.0)


def test_an_operator_clicks_once_a_pass_at_the_middle():
    scenario = scenario_from({"duration_s": 70.0})
    flight = fly(scenario)
    targets = targets_of(scenario, flight.seed)
    seen = sightings(flight, XT2, targets)
    assert seen
    start_ns = scenario.start_ns
    for one in seen:
        exposed_s = (one.stamp_ns - start_ns) * 1e-9 - scenario.video.latency_s
        position, q_pc = flight.gimbal.camera(exposed_s)
        place = (np.array([*targets[0].center, 0.0]) - position) @ matrix_from_quat(q_pc[0])
        # Stamps are whole nanoseconds.
        np.testing.assert_allclose(XT2.project(place)[0][0], [one.u, one.v], atol=1e-3)
        assert 180 <= one.v <= 490
    apart_s = np.diff([one.stamp_ns for one in seen]) * 1e-9
    assert (apart_s > 1.0).all()
    assert sightings(flight, XT2, []) == []
