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
"""``tirgeo calibrate gimbal`` on rendered videos of a board on a wall (Ren et al., Table 8)."""

from __future__ import annotations

import csv
import json

import cv2
import numpy as np
import pytest
from process_bags import picture_bag
from recorded_bags import segments_of

from dev.checkerboards import BoardLook, BoardRenderer, gimbal_pose
from tirgeo_ros.core.calibration.checkerboard import Checkerboard
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.io.pictures.camera_file import camera_yaml
from tirgeo_ros.tools.calibrate.board_pictures import Picture, thinned
from tirgeo_ros.tools.calibrate.gimbal import calibrate_gimbal
from tirgeo_ros.tools.cli.main import main

pytestmark = pytest.mark.slow

BOARD = Checkerboard(9, 6, 0.1)
FRAMES, FPS = 24, 10
STD_DEG = np.array([0.2704, 0.4839, 13.8857])  # roll, pitch, yaw of Table 8


def wobble(count, seed=5):
    """(count, 3) rad with the standard deviations of Table 8, to the last digit."""
    rng = np.random.default_rng(seed)
    raw = rng.normal(size=(count, 3))
    raw[:, 2] = np.sign(np.sin(np.arange(count) * 0.7 + 0.2)) + 0.1 * raw[:, 2]
    raw = (raw - raw.mean(0)) / raw.std(0, ddof=1)
    return np.radians(raw * STD_DEG)


@pytest.fixture(scope="module")
def video():
    """Stamps, pictures, and the truth."""
    angles = wobble(FRAMES)
    draw, rng = BoardRenderer(XT2, BOARD), np.random.default_rng(6)
    look = BoardLook()
    images = [draw.view(*gimbal_pose(BOARD, a, 2.2, 0.7), look, rng).image for a in angles]
    stamps = [5_000_000_000 + round(n * 1e9 / FPS) for n in range(FRAMES)]
    return stamps, images, angles


def test_table_8_and_the_time_series_come_out_within_the_noise(video, tmp_path):
    stamps, images, _ = video
    images = list(images)
    images[7] = np.full_like(images[7], 100)  # the board is lost for a moment
    bag, table = picture_bag(tmp_path / "wall.mcap", stamps, images), tmp_path / "attitude.csv"
    result = calibrate_gimbal([bag], BOARD, output=table)
    kept = np.delete(np.degrees(video[2]), 7, axis=0)
    truth = kept.std(0, ddof=1)
    for axis, name in enumerate(("roll", "pitch", "yaw")):
        noise = result["noise_deg"][name]
        # What noise n does to a standard deviation s of N: n / sqrt(N), and n^2 / 2s of bias.
        allowed = 4 * noise / np.sqrt(len(kept)) + noise**2 / truth[axis]
        assert result["std_deg"][name] == pytest.approx(truth[axis], abs=allowed)
        assert noise < 0.1 * truth[axis]
    assert result["used"] == FRAMES - 1
    assert next(iter(result["refused"].values())).startswith("no board")
    with table.open() as file:
        rows = list(csv.DictReader(file))
    outcome = np.array(
        [[float(row[f"{a}_deg"]) for a in ("roll", "pitch", "yaw")] for row in rows]
    )
    sigma = np.array(
        [[float(row[f"sigma_{a}_deg"]) for a in ("roll", "pitch", "yaw")] for row in rows]
    )
    assert np.abs((outcome - kept) / sigma).max() < 4.5
    assert [float(row["time_s"]) for row in rows][5:9] == [0.5, 0.6, 0.8, 0.9]


def test_pictures_with_a_calibration_file_and_the_command(video, tmp_path, capsys):
    for number, image in enumerate(video[1][:12]):
        cv2.imwrite(str(tmp_path / f"f{number}.png"), image)
    (tmp_path / "camera.yaml").write_text(camera_yaml(XT2), encoding="utf-8")
    argv = ["calibrate", "gimbal", str(tmp_path), "--board", "9x6", "--square", "0.1"]
    argv += ["--camera", str(tmp_path / "camera.yaml"), "--rate", "5"]
    assert main([*argv, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["duration_s"] == pytest.approx(11 / 5)
    truth = np.degrees(video[2][:12].std(0, ddof=1))
    assert result["std_deg"]["yaw"] == pytest.approx(truth[2], rel=0.01)
    assert main(argv) == 0
    text = capsys.readouterr().out
    assert text.index("pitch") < text.index("yaw") < text.index("roll")


def test_missing_inputs_are_named(video, tmp_path):
    stamps, images, _ = video
    picture = tmp_path / "a.png"
    picture.write_bytes(b"")
    with pytest.raises(CalibrationError, match="give --camera"):
        calibrate_gimbal([picture], BOARD)
    few = picture_bag(tmp_path / "few.mcap", stamps[:3], images[:3])
    with pytest.raises(CalibrationError, match="3 pictures of 3 show the board, 10 are needed"):
        calibrate_gimbal([few], BOARD)
    bare = picture_bag(tmp_path / "bare.mcap", stamps[:3], images[:3], info=False)
    with pytest.raises(BagError, match=r"topic absent: /thermal/camera_info; give --camera"):
        calibrate_gimbal([bare], BOARD)
    small = picture_bag(tmp_path / "small.mcap", stamps[:1], [images[0][:256, :320].copy()])
    with pytest.raises(CalibrationError, match="320x256 pixels, the camera's calibration 640x512"):
        calibrate_gimbal([small], BOARD)


def test_a_damaged_bag_is_used_as_far_as_it_can_be_read(video, tmp_path, capsys):
    stamps, images, _ = video
    bag = picture_bag(tmp_path / "wall.mcap", stamps, images)
    words = ["calibrate", "gimbal", str(bag), "--board", "9x6", "--square", "0.1"]
    segments = segments_of(bag)
    damage(bag, segments[3:4])
    assert main(words) == 1
    reports = capsys.readouterr()
    assert "pictures used, over" in reports.out
    assert (
        f"wall.mcap: the chunk at byte {segments[3].offset} is cut off or damaged" in reports.err
    )
    assert reports.err.count("\n") == 1
    damage(bag, segments)
    assert main(words) == 1
    reports = capsys.readouterr()
    assert "wall.mcap: no message of /thermal/camera_info can be read; give --ca" in reports.err
    assert (reports.out, reports.err.count("\n")) == ("", 1)


def damage(bag, segments):
    data = bytearray(bag.read_bytes())
    for segment in segments:
        middle = segment.offset + segment.length // 2
        data[middle : middle + 20] = bytes(20)
    bag.write_bytes(data)


@pytest.mark.parametrize(("fps", "rate", "expected"), [(30, 10, 20), (9, 10, 18), (25, 10, 20)])
def test_videos_are_thinned_evenly(fps, rate, expected):
    stamps = [round(n * 1e9 / fps) for n in range(2 * fps)]
    kept = list(thinned((Picture(str(s), s, None) for s in stamps), rate))
    assert abs(len(kept) - expected) <= 1

    back = [stamp * 1_000_000 for stamp in (0, 100, 200, 0, 100, 200)]  # it does not stop there
    assert len(list(thinned((Picture(str(s), s, None) for s in back), 10))) >= 5
