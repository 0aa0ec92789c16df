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
"""``tirgeo calibrate lens`` on rendered thermal boards with the lens of Ren et al., Table 9."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from process_bags import picture_bag

from dev.checkerboards import BoardLook, board_views
from tirgeo_ros.core.calibration.checkerboard import Checkerboard
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.io.pictures.camera_file import load_camera
from tirgeo_ros.tools.calibrate.board_pictures import files_of
from tirgeo_ros.tools.calibrate.lens import calibrate_lens
from tirgeo_ros.tools.cli.main import main

BOARD = Checkerboard(9, 6, 0.1)
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
TRUTH = np.array([XT2.fx, XT2.fy, XT2.cx, XT2.cy, *XT2.distortion])


def write(folder, images):
    folder.mkdir(exist_ok=True)
    for name, image in images.items():
        assert cv2.imwrite(str(folder / f"{name}.png"), image)
    return folder


def off_sigmas(result):
    assert tuple(result["parameters"]) == NAMES
    outcome = np.array([result["parameters"][name] for name in NAMES])
    return (outcome - TRUTH) / [result["sigma"][name] for name in NAMES]


@pytest.fixture(scope="module")
def views():
    return board_views(XT2, BOARD, 10, 4)


@pytest.fixture(scope="module")
def folder(views, tmp_path_factory):
    images = {f"view_{number}": view.image for number, view in enumerate(views)}
    images["wall"] = np.full((512, 640), 105, np.uint8)
    images["again"] = views[0].image
    images["wide"] = cv2.resize(views[0].image, None, fx=1.5, fy=1.5)
    folder = write(tmp_path_factory.mktemp("lens") / "pictures", images)
    (folder / "broken.png").write_bytes(b"no picture")
    (folder / "notes.txt").write_text("not looked at")
    return folder


@pytest.mark.slow
def test_the_lens_is_found_within_its_sigmas(folder, tmp_path):
    output, plot = tmp_path / "camera.yaml", tmp_path / "coverage.png"
    result = calibrate_lens([folder], BOARD, output, plot=plot)
    assert np.abs(off_sigmas(result)).max() < 3
    assert result["reprojection_rms_px"] < 0.6  # and far below: the corners are good to 0.05 px
    camera = load_camera(output)
    assert camera.fx == pytest.approx(result["parameters"]["fx"])
    assert camera.distortion[4] == 0.0
    assert cv2.imread(str(plot)).shape[0] > 500
    # Every picture that is not used has its reason.
    refused = result["refused"]
    assert {"wall.png", "broken.png"} < set(refused)
    assert len({"again.png", "view_0.png"} & set(refused)) == 1
    assert refused["wall.png"].startswith("no board")
    assert refused["broken.png"].startswith("not readable")
    assert refused["wide.png"] == "another picture size: 960x768 pixels"
    assert result["image_size"] == [640, 512]
    assert result["pictures"] == 14
    assert result["views"] == 14 - len(refused)
    assert set(result["view_rms_px"]).isdisjoint(refused)


@pytest.mark.slow
def test_the_command_prints_json_and_text(folder, tmp_path, capsys):
    pictures = [str(folder / f"view_{number}.png") for number in range(6)]
    argv = ["calibrate", "lens", *pictures, "--board", "9x6", "--square", "0.1"]
    argv += ["-o", str(tmp_path / "camera.yaml")]
    assert main([*argv, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["views"] + result["views_spare"] + len(result["refused"]) == 6
    assert "views are too few: take 20" in result["warning"]
    assert main(argv) == 0
    text = capsys.readouterr().out
    assert "fx" in text
    assert "reprojection error" in text


@pytest.mark.slow
def test_a_16_bit_video_is_calibrated_from_its_sharpest_pictures(tmp_path):
    views = board_views(XT2, BOARD, 6, 8, BoardLook(bits=16))
    stamps = [k * 1_000_000_000 + n * 100_000_000 for k in range(10, 16) for n in range(3)]
    images = [
        cv2.GaussianBlur(view.image, (0, 0), blur_px) if blur_px else view.image
        for view in views
        for blur_px in (3.0, 0.0, 4.0)
    ]
    bag = picture_bag(tmp_path / "board.mcap", stamps, images, info=False, namespace="/uav")
    result = calibrate_lens([bag], BOARD, tmp_path / "camera.yaml", namespace="uav")
    assert set(result["view_rms_px"]) <= {f"{10 + number}.100" for number in range(6)}
    assert np.abs(off_sigmas(result)).max() < 4
    with pytest.raises(BagError, match="give --namespace if the topics have one"):
        calibrate_lens([bag], BOARD, tmp_path / "camera.yaml")


@pytest.mark.slow
def test_nothing_is_written_where_no_lens_is_found(folder, tmp_path):
    output = tmp_path / "camera.yaml"
    with pytest.raises(CalibrationError, match="no picture of 1 can be used: 1 x no board"):
        calibrate_lens([folder / "wall.png"], BOARD, output)
    with pytest.raises(CalibrationError, match="2 usable views are left"):
        calibrate_lens([folder / "view_1.png", folder / "view_2.png"], BOARD, output)
    assert not output.exists()


@pytest.mark.slow
@pytest.mark.long
def test_sigmas_hold_over_many_boards(tmp_path):
    look, z = BoardLook(noise=3.0, blur_px=1.4), []
    for seed in range(20, 24):
        images = {f"{n}": v.image for n, v in enumerate(board_views(XT2, BOARD, 20, seed, look))}
        folder = write(tmp_path / f"{seed}", images)
        z.append(off_sigmas(calibrate_lens([folder], BOARD, tmp_path / "camera.yaml")))
    # Four times eight parameters, correlated as fx and fy are: 1 +- 0.5 of a root mean square.
    rms = np.sqrt((np.array(z) ** 2).mean())
    assert 0.5 < rms < 1.5
    assert np.abs(z).max() < 3.9  # one in 10 000 of a normal distribution


def test_absent_files_are_named(tmp_path):
    with pytest.raises(CalibrationError, match="there is no such file or folder"):
        files_of([tmp_path / "none"])
    with pytest.raises(CalibrationError, match="no pictures in it"):
        files_of([tmp_path])
    with pytest.raises(CalibrationError, match="give either one bag"):
        calibrate_lens([tmp_path / "a.mcap", tmp_path], BOARD, tmp_path / "camera.yaml")
