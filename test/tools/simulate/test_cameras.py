"""Other cameras: sizes, lenses, and pictures of 16 bits."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.simulate import simulate
from tirgeo_ros.tools.simulate.ground import Ground
from tirgeo_ros.tools.simulate.renderer import COUNTS_OF_0, COUNTS_PER_GREY, Renderer
from tirgeo_ros.tools.simulate.scenario_ground import VideoScenario

OTHER = """\
duration_s: 6.0
route: {hover_s: 1.0}
video: {width: 320, height: 256, fov_deg: 57.0, distortion: [], bits: 16, rate_hz: 5.0}
park: {resolution_m: 0.2}
scene: {people: 12}
survey: {points: 4, views: 2, after_s: 0.0, apart_s: 0.5, rows_px: [90, 245], side_px: 20}
"""


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    folder = tmp_path_factory.mktemp("other")
    (folder / "other.yaml").write_text(OTHER)
    return folder, simulate(folder / "other.yaml", folder)


def read(path, topic, convert_one):
    cdr = Cdr()
    return [
        convert_one(cdr.deserialize(m.data, m.typename)) for m in BagReader(path).messages([topic])
    ]


def test_the_bag_says_the_camera_of_its_pictures(other):
    folder, summary = other
    assert summary["messages"]["thermal/image_raw"] == 30
    assert "thermal/image_raw/compressed" not in summary["messages"]
    (camera,) = set(read(folder / "flight.mcap", "/thermal/camera_info", convert.camera))
    assert (camera.width, camera.height) == (320, 256)
    assert camera.fx == camera.fy == pytest.approx(160 / np.tan(np.radians(28.5)))
    pictures = read(folder / "flight.mcap", "/thermal/image_raw", convert.image_pixels)
    assert {(picture.shape, picture.dtype.name) for picture in pictures} == {
        ((256, 320), "uint16")
    }
    # Grass to kerbs and people, some ten kelvin: a small part of the range, which no pixel fills.
    low, high = np.percentile(pictures, [1, 99])
    assert 20_500 < low < high < 24_500
    assert np.max(pictures) < 26_000


def test_sixteen_bits_hold_what_eight_do_and_the_fire_beyond():
    ground = Ground([np.full((64, 64), 100, np.uint8)] * 4, 320.0, -320.0, 10.0)
    bare = {"noise_grey": 0.0, "vignetting": 0.0}
    pose = np.array([0.0, 0.0, -20.0]), np.array([0.5, 0.5, 0.5, 0.5])  # level, to the north
    eight, sixteen = (
        Renderer(XT2, ground, VideoScenario(bits=bits, **bare)).frame(
            *pose, np.random.default_rng(0)
        )
        for bits in (8, 16)
    )
    assert (eight.dtype, sixteen.dtype) == (np.uint8, np.uint16)
    # Eight bits round to whole grey levels.
    back = (sixteen - COUNTS_OF_0) / COUNTS_PER_GREY
    np.testing.assert_allclose(eight, back, atol=0.51)
