"""Ground that slopes: pictures, survey and elevation model agree on it."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler, quat_multiply
from tirgeo_ros.core.ground.dem_intersection import first_hit
from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.io.elevation.elevation_model import load_terrain
from tirgeo_ros.io.surveys.survey import load_observations, load_survey
from tirgeo_ros.tools.simulate import scenario_from, simulate
from tirgeo_ros.tools.simulate.ground import Ground
from tirgeo_ros.tools.simulate.relief import Relief
from tirgeo_ros.tools.simulate.renderer import Renderer
from tirgeo_ros.tools.simulate.scenario_ground import VideoScenario
from tirgeo_ros.tools.simulate.targets import Target

PLACE = np.array([0.0, 0.0, -25.0])
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
    height, loss = Relief(SCENARIO.park).met(PLACE, rays)
    lengths = [first_hit(terrain, plane, PLACE, ray / np.linalg.norm(ray)) for ray in rays]
    met_m = height / loss * np.linalg.norm(rays, axis=1)
    # heights in the file to 1 mm, over the sine of 10 deg to the hillside
    np.testing.assert_allclose(met_m, lengths, atol=0.001 / np.sin(np.radians(10.0)))
    level = -PLACE[2] / rays[:, 2] * np.linalg.norm(rays, axis=1)
    assert np.abs(level - lengths).max() > 3.0  # the slope matters


def test_a_spot_on_a_hillside_is_seen_where_the_camera_projects_it():
    ground = Ground([np.full((64, 64), 92, np.uint8)] * 4, 320.0, -320.0, 10.0)
    still = VideoScenario(noise_grey=0.0, vignetting=0.0)
    relief = Relief(SCENARIO.park)
    q_pc = quat_multiply(quat_from_euler(*np.radians([0.0, -28.0, 0.0])), Q_BODY_OPTICAL)
    for center in ([35.0, 3.0], [48.0, -9.0], [60.0, 8.0]):
        spot = Target("person 1", "person", np.array(center), 15.0, 0.6, 0.0)
        picture = Renderer(XT2, ground, still, [spot], relief).frame(
            PLACE, q_pc, np.random.default_rng(0)
        )
        warm = np.maximum(picture.astype(float) - 92, 0)
        rows, columns = np.indices(picture.shape)
        found = np.array([(columns * warm).sum(), (rows * warm).sum()]) / warm.sum()
        (place,) = relief.places(np.array([center]))
        expected = XT2.project((place - PLACE)[None] @ matrix_from_quat(q_pc))[0][0]
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
