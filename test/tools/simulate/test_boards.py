"""The rendered pictures and video of a checkerboard, and the truth beside them."""

from __future__ import annotations

import csv

import cv2
import numpy as np
import pytest

from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.simulate.boards import YAW_STD_DEG, camera_angles, main


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
