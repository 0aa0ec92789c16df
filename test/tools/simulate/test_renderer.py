# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""The contents of pictures: spots, targets, hillsides; the map, other cameras, clicks."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.rotations import (
    Q_BODY_OPTICAL,
    matrix_from_quat,
    quat_from_euler,
    quat_multiply,
)
from tirgeo_ros.core.ground.backprojection import first_hit
from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.elevation.elevation_model import load_terrain
from tirgeo_ros.io.messages import pictures as picture_messages
from tirgeo_ros.io.surveys.survey import load_observations, load_survey
from tirgeo_ros.tools.simulate import fly, scenario_from, simulate
from tirgeo_ros.tools.simulate.park import LEVEL, Relief, lay_out, map_text
from tirgeo_ros.tools.simulate.renderer import (
    COUNTS_OF_0,
    COUNTS_PER_GREY,
    GRASS,
    GREY_PER_K,
    Ground,
    Renderer,
    Target,
    targets_of,
)
from tirgeo_ros.tools.simulate.scenario import ParkScenario, VideoScenario
from tirgeo_ros.tools.simulate.survey import sightings

STILL = VideoScenario(noise_grey=0.0, vignetting=0.0)
GREY = round(GRASS)
GRASS_ALONE = Ground([np.full((64, 64), GREY, np.uint8)] * 4, 320.0, -320.0, 10.0)
PLACE, CAMERA = np.array([0.0, 0.0, -20.0]), np.array([0.0, 0.0, -25.0])
SCENARIO = scenario_from({"park.slope_deg": 4.0, "park.uphill_deg": 20.0})
HILLSIDE = Relief(SCENARIO.park)


def looking(pitch_deg=-30.0, yaw_deg=0.0, roll_deg=0.0):
    q_pg = quat_from_euler(*np.radians([roll_deg, pitch_deg, yaw_deg]))
    return quat_multiply(q_pg, Q_BODY_OPTICAL)


def picture_of(targets, q_pc, ground=GRASS_ALONE, *, video=STILL, relief=LEVEL, place=PLACE):
    drawn = Renderer(XT2, ground, video, targets, relief)
    return drawn.frame(place, q_pc, np.random.default_rng(0))


def projected(points, q_pc, place=PLACE):
    return XT2.project((points - place) @ matrix_from_quat(q_pc))[0]


def centroid(warm):
    rows, columns = np.indices(warm.shape)
    return np.array([(columns * warm).sum(), (rows * warm).sum()]) / warm.sum()


@pytest.mark.parametrize("q_pc", [looking(), looking(-33.0, 12.0, 4.0), looking(-29.0, -9.0)])
def test_a_spot_on_the_ground_is_seen_where_the_camera_projects_it(q_pc):
    spots = np.array([[24.0, 3.0], [28.0, -5.0], [38.0, 6.0], [55.0, -9.0], [70.0, 2.0]])
    canvas = np.zeros((1600, 1200), np.uint8)  # 80 m by 60 m, 10 m to 90 m north
    for north, east in spots:
        center = np.round((np.array([east + 30.0, 90.0 - north]) / 0.05 - 0.5) * 16).astype(int)
        cv2.circle(canvas, tuple(center.tolist()), 8 * 16, 200, -1, cv2.LINE_AA, 4)
    levels = [canvas]
    for _ in range(3):
        levels.append(cv2.resize(levels[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    picture = picture_of([], q_pc, Ground(levels, 90.0, -30.0, 0.05)).astype(float)
    for u, v in projected(np.column_stack([spots, np.zeros(5)]), q_pc):
        column, row = round(u) - 18, round(v) - 15
        result = np.add(centroid(picture[row : row + 31, column : column + 37]), [column, row])
        # The centroid of a disc of 0.4 m lies below its centre's image by the perspective: a
        # fraction r^2 / d^2 of the distance, under 0.05 px; whole grey levels do the rest.
        np.testing.assert_allclose(result, [u, v], atol=0.15)


@pytest.mark.parametrize(
    ("center", "q_pc", "relief"),
    [
        ((30.0, 3.0), looking(), LEVEL),
        ((26.3, -5.2), looking(-33.0, 12.0, 4.0), LEVEL),
        ((45.7, 1.1), looking(-29.0, -9.0), LEVEL),
        ((35.0, 3.0), looking(-28.0), HILLSIDE),
        ((48.0, -9.0), looking(-28.0), HILLSIDE),
        ((60.0, 8.0), looking(-28.0), HILLSIDE),
    ],
)
def test_a_person_is_seen_where_the_camera_projects_them(center, q_pc, relief):
    person = Target("person 1", "person", np.array(center), 13.0, 0.55, 0.4)
    picture = picture_of([person], q_pc, relief=relief, place=CAMERA)
    result = centroid(np.maximum(picture - float(GREY), 0.0))
    (expected,) = projected(relief.places(np.array([center])), q_pc, CAMERA)
    # Perspective moves the centroid by (r / d)^2 of the distance, 0.02 px; whole
    # grey levels do the rest.
    np.testing.assert_allclose(result, expected, atol=0.1)


def test_a_person_is_as_warm_as_asked_and_a_fire_saturates_in_8_bits_and_not_in_16():
    person = Target("person 1", "person", np.array([30.0, 0.0]), 12.0, 0.5, 0.0)
    fire = Target("fire 1", "fire", np.array([34.0, 4.0]), 400.0, 2.0, 0.0)
    picture = picture_of([person, fire], looking())
    u, v = np.round(projected(np.array([[30.0, 0.0, 0.0]]), looking())[0]).astype(int)
    assert picture[v, u] == pytest.approx(GRASS + 12.0 * GREY_PER_K, abs=2.0)  # blur takes some
    # A disc of 2 m, seen at 39 m and 30 deg: pi r^2 f^2 sin(30.6 deg) / d^2, and the blur's rim.
    distance_m = np.linalg.norm([34.0, 4.0, 20.0])
    pixels = np.pi * XT2.fx * XT2.fy * (20.0 / distance_m) / distance_m**2
    assert pixels < (picture == 255).sum() - 100 < 1.35 * pixels
    sixteen = picture_of([], looking(), video=replace(STILL, bits=16))
    eight = picture_of([], looking())
    assert (eight.dtype, sixteen.dtype) == (np.uint8, np.uint16)
    # Eight bits round to whole grey levels.
    np.testing.assert_allclose(eight, (sixteen - COUNTS_OF_0) / COUNTS_PER_GREY, atol=0.51)


def test_one_more_target_leaves_the_others_where_they_are():
    few, many = (
        targets_of(scenario_from({"scene.people": n, "scene.fires": 2, "scene.people_at": []}), 7)
        for n in (2, 3)
    )
    assert [item.id for item in many] == ["person 1", "person 2", "person 3", "fire 1", "fire 2"]
    places = {item.id: item.center.tolist() for item in many}
    assert {item.id: item.center.tolist() for item in few}.items() <= places.items()
    assert len({tuple(place) for place in places.values()}) == 5
    for item in many:
        assert -76 <= item.center[0] <= 106
        assert -36 <= item.center[1] <= 104
        assert item.kind == "person" or (1.0 <= item.size_m <= 3.0 and item.warmer_k >= 300.0)


def test_an_operator_clicks_once_a_pass_at_the_middle():
    scenario = scenario_from({"duration_s": 70.0})
    flight = fly(scenario)
    targets = targets_of(scenario, flight.seed)
    observed = sightings(flight, XT2, targets)
    assert observed
    start_ns = scenario.start_ns
    for item in observed:
        exposed_s = (item.stamp_ns - start_ns) * 1e-9 - scenario.video.latency_s
        position, q_pc = flight.gimbal.camera(exposed_s)
        place = (np.array([*targets[0].center, 0.0]) - position) @ matrix_from_quat(q_pc[0])
        # Stamps are whole nanoseconds.
        np.testing.assert_allclose(XT2.project(place)[0][0], [item.u, item.v], atol=1e-3)
        assert 180 <= item.v <= 490
    apart_s = np.diff([item.stamp_ns for item in observed]) * 1e-9
    assert (apart_s > 1.0).all()
    assert sightings(flight, XT2, []) == []


SLOPING = """\
duration_s: 8.0
route: {hover_s: 1.0, height_above_ground_m: 30.0}
video: {rate_hz: 3.0}
park: {resolution_m: 0.2, slope_deg: 4.0, uphill_deg: 20.0}
survey: {points: 4, views: 2, after_s: 0.0, apart_s: 0.5}
scene: {people: 20}
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sloping")
    (folder / "sloping.yaml").write_text(SLOPING)
    simulate(folder / "sloping.yaml", folder, images=False)
    return folder


def test_a_ray_meets_the_ground_that_the_elevation_model_has(flown):
    """For 200 rays all over the picture."""
    pytest.importorskip("rasterio", reason="elevation models need rasterio")
    terrain, plane = load_terrain(flown / "dem.asc"), SCENARIO.site.plane
    q_pc = looking(-40.0, 15.0)
    uv = np.random.default_rng(2).uniform([0, 0], [639, 511], (200, 2))
    rays = XT2.rays(uv) @ matrix_from_quat(q_pc).T
    height, loss = HILLSIDE.descent(CAMERA, rays)
    lengths = [first_hit(terrain, plane, CAMERA, ray / np.linalg.norm(ray)) for ray in rays]
    met_m = height / loss * np.linalg.norm(rays, axis=1)
    # heights in the file to 1 mm, over the sine of 10 deg to the hillside
    np.testing.assert_allclose(met_m, lengths, atol=0.001 / np.sin(np.radians(10.0)))
    level = -CAMERA[2] / rays[:, 2] * np.linalg.norm(rays, axis=1)
    assert np.abs(level - lengths).max() > 3.0  # the slope matters


def test_a_sloping_flight_is_complete_and_too_high_ground_is_refused(flown, tmp_path):
    plane = SCENARIO.site.plane
    assert "ground_height_m" not in (flown / "params.yaml").read_text()
    for name in ("survey.geojson", "targets.geojson"):
        for point in load_survey(flown / name):
            place = plane.ned_from_geodetic(
                point.latitude_rad, point.longitude_rad, point.height_m
            )
            # surveyed to 2 cm; a centimetre to the side is 1 mm
            np.testing.assert_allclose(place, HILLSIDE.places(place[None, :2])[0], atol=0.1)
    assert load_observations(flown / "observations.csv")
    (tmp_path / "steep.yaml").write_text(SLOPING.replace("slope_deg: 4.0", "slope_deg: 20.0"))
    with pytest.raises(ScenarioError, match=r"park: the ground rises to .* fly 3 m above the"):
        simulate(tmp_path / "steep.yaml", tmp_path / "out")
    assert not (tmp_path / "out").exists()


SMALL = ParkScenario(north_m=(0.0, 60.0), east_m=(-28.0, 28.0), margin_m=20.0, resolution_m=0.05)


def test_the_map_is_the_park_in_rfc_7946():
    plane = SCENARIO.site.plane
    park = lay_out(SMALL, 3)
    document = json.loads(map_text(park, plane))
    kinds = [feature["properties"]["kind"] for feature in document["features"]]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {
        "bed": len(park.beds),
        "path": len(park.paths),
        "hydrant": len(park.hydrants),
    }
    for feature, bed in zip(document["features"], park.beds, strict=False):
        assert feature["properties"]["name"] == bed.name
        rings = feature["geometry"]["coordinates"]
        assert len(rings) == 1 + len(bed.holes)
        for k, ring in enumerate(rings):
            assert ring[0] == ring[-1]
            x, y = np.array(ring).T[:2] - np.array(ring).T[:2, :1]
            area = np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])
            assert (area > 0) == (k == 0)  # the outer ring counterclockwise, holes clockwise
        lon, lat, height = np.array(rings[0][:-1]).T
        placed = plane.ned_from_geodetic(np.radians(lat), np.radians(lon), height)
        true = np.column_stack([bed.outline, np.zeros(len(bed.outline))])
        apart = np.linalg.norm(placed[:, None] - true[None], axis=-1).min(axis=1)
        assert apart.max() < 2e-4  # nine decimals of a degree, four of a metre


OTHER = """\
duration_s: 6.0
route: {hover_s: 1.0}
video: {width: 320, height: 256, fov_deg: 57.0, distortion: [], bits: 16, rate_hz: 5.0}
park: {resolution_m: 0.2}
scene: {people: 12}
survey: {points: 4, views: 2, after_s: 0.0, apart_s: 0.5, rows_px: [90, 245], side_px: 20}
"""


def test_the_bag_contains_the_camera_of_its_pictures(tmp_path):
    (tmp_path / "other.yaml").write_text(OTHER)
    summary = simulate(tmp_path / "other.yaml", tmp_path)
    assert summary["messages"]["thermal/image_raw"] == 30
    assert "thermal/image_raw/compressed" not in summary["messages"]
    cdr, reader = Cdr(), BagReader(tmp_path / "flight.mcap")
    infos, pictures = (
        [form(cdr.deserialize(m.data, m.typename)) for m in reader.messages([f"/thermal/{name}"])]
        for name, form in (
            ("camera_info", picture_messages.camera),
            ("image_raw", picture_messages.image_pixels),
        )
    )
    (camera,) = set(infos)
    assert (camera.width, camera.height) == (320, 256)
    assert camera.fx == camera.fy == pytest.approx(160 / np.tan(np.radians(28.5)))
    assert {(item.shape, item.dtype.name) for item in pictures} == {((256, 320), "uint16")}
    # Grass to kerbs and people, some ten kelvin: a small part of the range, which no pixel fills.
    low, high = np.percentile(pictures, [1, 99])
    assert 20_500 < low < high < 24_500
    assert np.max(pictures) < 26_000
