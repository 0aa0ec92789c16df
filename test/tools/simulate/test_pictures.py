"""The park, and that things stand in the picture where the camera sees them; other cameras."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler, quat_multiply
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.simulate import simulate
from tirgeo_ros.tools.simulate.park import lay_out, map_text
from tirgeo_ros.tools.simulate.renderer import COUNTS_OF_0, COUNTS_PER_GREY, Ground, Renderer
from tirgeo_ros.tools.simulate.scenario import ParkScenario, SiteScenario, VideoScenario

SMALL = ParkScenario(north_m=(0.0, 60.0), east_m=(-28.0, 28.0), margin_m=20.0, resolution_m=0.05)
HEIGHT_M = 20.0


def looking(pitch_deg=-30.0, yaw_deg=0.0, roll_deg=0.0):
    q_pg = quat_from_euler(*np.radians([roll_deg, pitch_deg, yaw_deg]))
    return np.array([0.0, 0.0, -HEIGHT_M]), quat_multiply(q_pg, Q_BODY_OPTICAL)


def projected(place, position, q_pc):
    return XT2.project((place - position) @ matrix_from_quat(q_pc))[0]


@pytest.mark.parametrize("pose", [looking(), looking(-33.0, 12.0, 4.0), looking(-29.0, -9.0)])
def test_a_spot_on_the_ground_is_seen_where_the_camera_projects_it(pose):
    spots = np.array([[24.0, 3.0], [28.0, -5.0], [38.0, 6.0], [55.0, -9.0], [70.0, 2.0]])
    canvas = np.zeros((1600, 1200), np.uint8)  # 80 m by 60 m, 10 m to 90 m north
    for north, east in spots:
        center = np.round((np.array([east + 30.0, 90.0 - north]) / 0.05 - 0.5) * 16).astype(int)
        cv2.circle(canvas, tuple(center.tolist()), 8 * 16, 200, -1, cv2.LINE_AA, 4)
    levels = [canvas]
    for _ in range(3):
        levels.append(cv2.resize(levels[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    still = VideoScenario(noise_grey=0.0, vignetting=0.0)
    picture = Renderer(XT2, Ground(levels, 90.0, -30.0, 0.05), still).frame(
        *pose, np.random.default_rng(0)
    )
    for place, (u, v) in zip(
        np.column_stack([spots, np.zeros(5)]),
        projected(np.column_stack([spots, np.zeros(5)]), *pose),
        strict=True,
    ):
        column, row = round(u), round(v)
        window = picture[row - 15 : row + 16, column - 18 : column + 19].astype(float)
        rows, columns = np.mgrid[-15:16, -18:19]
        weights = window / window.sum()
        found = [column + (columns * weights).sum(), row + (rows * weights).sum()]
        # The centroid of a disc of 0.4 m lies below its centre's image by the perspective: a
        # fraction r^2 / d^2 of the distance, under 0.05 px; whole grey levels do the rest.
        np.testing.assert_allclose(found, [u, v], atol=0.15, err_msg=str(place))


def test_the_map_is_the_park_in_rfc_7946():
    plane = SiteScenario().plane
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


def test_the_bag_says_the_camera_of_its_pictures(tmp_path):
    (tmp_path / "other.yaml").write_text(OTHER)
    summary = simulate(tmp_path / "other.yaml", tmp_path)
    assert summary["messages"]["thermal/image_raw"] == 30
    assert "thermal/image_raw/compressed" not in summary["messages"]
    cdr, reader = Cdr(), BagReader(tmp_path / "flight.mcap")
    infos, pictures = (
        [form(cdr.deserialize(m.data, m.typename)) for m in reader.messages([f"/thermal/{name}"])]
        for name, form in (("camera_info", convert.camera), ("image_raw", convert.image_pixels))
    )
    (camera,) = set(infos)
    assert (camera.width, camera.height) == (320, 256)
    assert camera.fx == camera.fy == pytest.approx(160 / np.tan(np.radians(28.5)))
    assert {(one.shape, one.dtype.name) for one in pictures} == {((256, 320), "uint16")}
    # Grass to kerbs and people, some ten kelvin: a small part of the range, which no pixel fills.
    low, high = np.percentile(pictures, [1, 99])
    assert 20_500 < low < high < 24_500
    assert np.max(pictures) < 26_000


def test_sixteen_bits_hold_what_eight_do():
    ground = Ground([np.full((64, 64), 100, np.uint8)] * 4, 320.0, -320.0, 10.0)
    bare = {"noise_grey": 0.0, "vignetting": 0.0}
    eight, sixteen = (
        Renderer(XT2, ground, VideoScenario(bits=bits, **bare)).frame(
            *looking(), np.random.default_rng(0)
        )
        for bits in (8, 16)
    )
    assert (eight.dtype, sixteen.dtype) == (np.uint8, np.uint16)
    # Eight bits round to whole grey levels.
    np.testing.assert_allclose(eight, (sixteen - COUNTS_OF_0) / COUNTS_PER_GREY, atol=0.51)
