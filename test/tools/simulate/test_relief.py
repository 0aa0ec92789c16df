"""Ground that is not level: rays, pictures, survey and elevation model agree on it."""

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
from tirgeo_ros.tools.simulate.relief import WGS84_TEXT, Relief, elevation_text
from tirgeo_ros.tools.simulate.renderer import Renderer
from tirgeo_ros.tools.simulate.scenario_ground import ParkScenario, SiteScenario, VideoScenario
from tirgeo_ros.tools.simulate.warm_spots import Patch

PLANE = SiteScenario().plane
PARK = ParkScenario(
    north_m=(-10.0, 80.0),
    east_m=(-40.0, 40.0),
    margin_m=30.0,
    slope_deg=3.0,
    uphill_deg=50.0,
    hills_m=2.0,
    hill_size_m=45.0,
)
PLACE = np.array([0.0, 0.0, -25.0])
HILLY = """\
duration_s: 8.0
route: {hover_s: 1.0, height_above_ground_m: 30.0}
video: {rate_hz: 3.0}
park: {resolution_m: 0.2, slope_deg: 4.0, uphill_deg: 20.0, hills_m: 1.5}
survey: {points: 4, views: 2, after_s: 0.0, apart_s: 0.5}
scene: {people: 20}
"""


@pytest.fixture(scope="module")
def relief():
    return Relief(PARK, 4)


@pytest.fixture(scope="module")
def terrain(relief, tmp_path_factory):
    pytest.importorskip("rasterio", reason="elevation models need rasterio")
    folder = tmp_path_factory.mktemp("dem")
    (folder / "dem.asc").write_text(elevation_text(relief, PLANE))
    (folder / "dem.prj").write_text(WGS84_TEXT)
    return load_terrain(folder / "dem.asc")


def looking(pitch_deg=-30.0, yaw_deg=0.0):
    return quat_multiply(quat_from_euler(*np.radians([0.0, pitch_deg, yaw_deg])), Q_BODY_OPTICAL)


def test_a_ray_meets_the_ground_that_the_elevation_model_has(relief, terrain):
    """Of 500 rays all over the picture; the two surfaces are apart by what bilinear cells lose."""
    uv = np.random.default_rng(2).uniform([0, 0], [639, 511], (500, 2))
    rays = XT2.rays(uv) @ matrix_from_quat(looking(-40.0, 15.0)).T
    met = relief.met(PLACE, rays)[:, None] * rays
    lengths = [first_hit(terrain, PLANE, PLACE, ray / np.linalg.norm(ray)) for ray in rays]
    assert all(isinstance(length, float) for length in lengths)
    off_m = np.linalg.norm(met, axis=1) - lengths
    # Bilinear: curvature 2 (2 pi / 45)^2 * 1.1^2 / 8 = 6 mm a direction, heights to 1 mm, over the
    # sine of 10 deg to the hillside.
    np.testing.assert_allclose(off_m, 0.0, atol=0.013 / np.sin(np.radians(10.0)))
    level = -PLACE[2] / rays[:, 2] * np.linalg.norm(rays, axis=1)
    assert np.abs(level - lengths).max() > 3.0  # the hills matter


def test_a_spot_on_a_hillside_is_seen_where_the_camera_projects_it(relief):
    ground = Ground([np.full((64, 64), 92, np.uint8)] * 4, 320.0, -320.0, 10.0)
    still = VideoScenario(noise_grey=0.0, vignetting=0.0)
    q_pc = looking(-28.0)
    for center in ([35.0, 3.0], [48.0, -9.0], [60.0, 8.0]):
        patch = Patch(np.array(center), (0.3, 0.3), 0.0, 15.0)
        picture = Renderer(XT2, ground, still, [patch], relief).frame(
            PLACE, q_pc, np.random.default_rng(0)
        )
        warm = np.maximum(picture.astype(float) - 92, 0)
        rows, columns = np.indices(picture.shape)
        found = np.array([(columns * warm).sum(), (rows * warm).sum()]) / warm.sum()
        (place,) = relief.places(np.array([center]))
        expected = XT2.project((place - PLACE)[None] @ matrix_from_quat(q_pc))[0][0]
        np.testing.assert_allclose(found, expected, atol=0.1)  # as on level ground


def test_a_ridge_hides_what_is_behind_it():
    ridged = Relief(ParkScenario(hills_m=10.0, hill_size_m=100.0), 0)
    level = np.column_stack([np.linspace(-70.0, 100.0, 300), np.full(300, 5.0)])
    places = ridged.places(level)
    low = np.array([-70.0, 5.0, -ridged.highest_m - 1.0])
    hidden = ridged.hides(low, places)
    # Against each line of sight, walked in steps of a hundredth.
    shares = np.linspace(0.0, 0.985, 400)[:, None, None]
    points = low + shares * (places - low)
    above = -points[..., 2] - ridged.height_m(points[..., 0], points[..., 1])
    walked = (above < 0).any(axis=0)
    assert 10 < walked.sum() < 290
    # A line that dips below a hill for less than a step of the search is either: so deep does a
    # wave of this height bend over half a step.
    level_m = np.linalg.norm((places - low)[:, :2], axis=1) / (places - low)[:, 2]
    step_m = (ridged.highest_m - ridged.lowest_m) * level_m / 32
    bend_m = 10.0 * (2 * np.pi / 100.0) ** 2 * (step_m / 2) ** 2 / 2
    assert (np.abs(above.min(axis=0)) < bend_m)[hidden != walked].all()
    assert (hidden == walked).sum() > 290


def test_a_hilly_flight_is_whole(tmp_path):
    (tmp_path / "hilly.yaml").write_text(HILLY)
    simulate(tmp_path / "hilly.yaml", tmp_path, images=False)
    scenario = scenario_from({})
    plane = scenario.site.plane
    said = (tmp_path / "params.yaml").read_text()
    assert "ground_height_m" not in said
    hills = Relief(
        scenario_from({"park.slope_deg": 4.0, "park.uphill_deg": 20.0, "park.hills_m": 1.5}).park,
        scenario.seed,
    )
    for name in ("survey.geojson", "targets.geojson"):
        for point in load_survey(tmp_path / name):
            place = plane.ned_from_geodetic(
                point.latitude_rad, point.longitude_rad, point.height_m
            )
            # Surveyed to 2 cm; a centimetre to the side is 1 mm.
            assert -place[2] == pytest.approx(float(hills.height_m(*place[:2])), abs=0.1)
    assert load_observations(tmp_path / "observations.csv")
    assert (tmp_path / "dem.asc").is_file()


def test_hills_as_high_as_the_flight_are_refused(tmp_path):
    (tmp_path / "steep.yaml").write_text(HILLY.replace("slope_deg: 4.0", "slope_deg: 20.0"))
    with pytest.raises(ScenarioError, match=r"park: its ground may rise to .* fly 3 m above it"):
        simulate(tmp_path / "steep.yaml", tmp_path / "out")
    assert not (tmp_path / "out").exists()
