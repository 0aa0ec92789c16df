"""What pictures show: warm things, clicks on them, a checkerboard, ground that slopes."""

from __future__ import annotations

import csv

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler, quat_multiply
from tirgeo_ros.core.ground.backprojection import first_hit
from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.elevation.elevation_model import load_terrain
from tirgeo_ros.io.surveys.survey import load_observations, load_survey
from tirgeo_ros.tools.simulate import fly, scenario_from, simulate
from tirgeo_ros.tools.simulate.boards import YAW_STD_DEG, camera_angles, main
from tirgeo_ros.tools.simulate.park import Relief
from tirgeo_ros.tools.simulate.renderer import (
    GRASS,
    GREY_PER_K,
    Ground,
    Renderer,
    Target,
    targets_of,
)
from tirgeo_ros.tools.simulate.scenario import VideoScenario
from tirgeo_ros.tools.simulate.survey import sightings

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


def files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*.*"))}


@pytest.mark.slow
def test_the_command_writes_the_same_bytes_for_a_seed(tmp_path, capsys):
    given = ["--views", "2", "--seconds", "1"]
    for name in ("one", "two"):
        main(["-o", str(tmp_path / name), *given, "--seed", "3"])
    assert str(tmp_path / "one" / "wall.mcap") in capsys.readouterr().out
    assert files(tmp_path / "one") == files(tmp_path / "two")
    view = cv2.imread(str(tmp_path / "one/lens/view_01.png"), cv2.IMREAD_UNCHANGED)
    assert view.shape == (512, 640)
    assert view.dtype == np.uint8
    bag = BagReader(tmp_path / "one/wall.mcap")
    assert set(bag.topics()) == {"/thermal/camera_info", "/thermal/image_raw"}
    assert sum(1 for _ in bag.messages(["/thermal/image_raw"])) == 10
    with (tmp_path / "one/wall.csv").open() as file:
        told = [[float(cell) for cell in row] for row in list(csv.reader(file))[1:]]
    truth = np.degrees(camera_angles(np.arange(10) / 10, 1.0, 3))
    np.testing.assert_allclose(np.array(told)[:, 1:], truth, atol=6e-6)  # five decimals


def test_the_angles_are_table_8_s():
    times = np.arange(300) / 10
    roll, pitch, yaw = np.degrees(camera_angles(times, 30.0, 1)).T
    # A sine over whole periods; its samples end a tenth of a second before the last one does.
    assert yaw.std() == pytest.approx(YAW_STD_DEG, rel=0.01)
    # Scaled at other instants, 50 ms apart.
    assert np.sqrt(np.mean(roll**2)) == pytest.approx(0.2704, rel=0.02)
    assert np.sqrt(np.mean(pitch**2)) == pytest.approx(0.4839, rel=0.02)


CAMERA = np.array([0.0, 0.0, -25.0])
SLOPING = """\
duration_s: 8.0
route: {hover_s: 1.0, height_above_ground_m: 30.0}
video: {rate_hz: 3.0}
park: {resolution_m: 0.2, slope_deg: 4.0, uphill_deg: 20.0}
survey: {points: 4, views: 2, after_s: 0.0, apart_s: 0.5}
scene: {people: 20}
"""
SCENARIO = scenario_from({"park.slope_deg": 4.0, "park.uphill_deg": 20.0})


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sloping")
    (folder / "sloping.yaml").write_text(SLOPING)
    simulate(folder / "sloping.yaml", folder, images=False)
    return folder


def test_a_ray_meets_the_ground_that_the_elevation_model_has(flown):
    """Of 200 rays all over the picture."""
    pytest.importorskip("rasterio", reason="elevation models need rasterio")
    terrain, plane = load_terrain(flown / "dem.asc"), SCENARIO.site.plane
    q_pc = quat_multiply(quat_from_euler(*np.radians([0.0, -40.0, 15.0])), Q_BODY_OPTICAL)
    uv = np.random.default_rng(2).uniform([0, 0], [639, 511], (200, 2))
    rays = XT2.rays(uv) @ matrix_from_quat(q_pc).T
    height, loss = Relief(SCENARIO.park).met(CAMERA, rays)
    lengths = [first_hit(terrain, plane, CAMERA, ray / np.linalg.norm(ray)) for ray in rays]
    met_m = height / loss * np.linalg.norm(rays, axis=1)
    # heights in the file to 1 mm, over the sine of 10 deg to the hillside
    np.testing.assert_allclose(met_m, lengths, atol=0.001 / np.sin(np.radians(10.0)))
    level = -CAMERA[2] / rays[:, 2] * np.linalg.norm(rays, axis=1)
    assert np.abs(level - lengths).max() > 3.0  # the slope matters


def test_a_spot_on_a_hillside_is_seen_where_the_camera_projects_it():
    ground = Ground([np.full((64, 64), 92, np.uint8)] * 4, 320.0, -320.0, 10.0)
    still = VideoScenario(noise_grey=0.0, vignetting=0.0)
    relief = Relief(SCENARIO.park)
    q_pc = quat_multiply(quat_from_euler(*np.radians([0.0, -28.0, 0.0])), Q_BODY_OPTICAL)
    for center in ([35.0, 3.0], [48.0, -9.0], [60.0, 8.0]):
        spot = Target("person 1", "person", np.array(center), 15.0, 0.6, 0.0)
        picture = Renderer(XT2, ground, still, [spot], relief).frame(
            CAMERA, q_pc, np.random.default_rng(0)
        )
        warm = np.maximum(picture.astype(float) - 92, 0)
        rows, columns = np.indices(picture.shape)
        found = np.array([(columns * warm).sum(), (rows * warm).sum()]) / warm.sum()
        (place,) = relief.places(np.array([center]))
        expected = XT2.project((place - CAMERA)[None] @ matrix_from_quat(q_pc))[0][0]
        np.testing.assert_allclose(found, expected, atol=0.1)  # as on level ground


def test_a_sloping_flight_is_whole(flown):
    plane, relief = SCENARIO.site.plane, Relief(SCENARIO.park)
    assert "ground_height_m" not in (flown / "params.yaml").read_text()
    for name in ("survey.geojson", "targets.geojson"):
        for point in load_survey(flown / name):
            place = plane.ned_from_geodetic(
                point.latitude_rad, point.longitude_rad, point.height_m
            )
            # surveyed to 2 cm; a centimetre to the side is 1 mm
            np.testing.assert_allclose(place, relief.places(place[None, :2])[0], atol=0.1)
    assert load_observations(flown / "observations.csv")


def test_ground_as_high_as_the_flight_is_refused(tmp_path):
    (tmp_path / "steep.yaml").write_text(SLOPING.replace("slope_deg: 4.0", "slope_deg: 20.0"))
    with pytest.raises(ScenarioError, match=r"park: its ground rises to .* fly 3 m above it"):
        simulate(tmp_path / "steep.yaml", tmp_path / "out")
    assert not (tmp_path / "out").exists()
