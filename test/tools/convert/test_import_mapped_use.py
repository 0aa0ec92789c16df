"""tirgeo import --map-topic used wrongly: said before anything is read."""

from __future__ import annotations

import pytest

from tirgeo_ros.tools.cli.main import main


@pytest.mark.parametrize("word", ["/a", "/a=", "=imu/data", "/a=tirgeo/odometry", "/a=/imu"])
def test_a_wrong_pair_is_wrong_use(tmp_path, word, capsys):
    words = ["import", "a.bag", "-o", str(tmp_path / "out.mcap"), "--map-topic", word]
    with pytest.raises(SystemExit, match="2"):
        main(words)
    assert (
        f"--map-topic {word}: not FROM=TO, TO one of imu/data, rtk/fix" in capsys.readouterr().err
    )


def test_axes_without_topics_are_wrong_use(tmp_path, capsys):
    words = ["import", "a.ulg", "-o", str(tmp_path / "out.mcap"), "--imu-rpy", "90", "0", "0"]
    with pytest.raises(SystemExit, match="2"):
        main(words)
    assert "--imu-rpy is for --map-topic" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "why"),
    [
        ("--set-heading 0", "--set-heading is for logs, not for --map-topic"),
        ("--rover-first", "--rover-first is for logs"),
        ("--height msl", "--height is for logs"),
        ("--image-topic /a", "use --map-topic TOPIC=thermal/image_raw, thermal/image_raw/comp"),
    ],
)
def test_options_that_a_bag_does_not_take_are_wrong_use(tmp_path, option, why, capsys):
    words = f"import a.bag -o {tmp_path}/out.mcap --map-topic /a=imu/data {option}"
    with pytest.raises(SystemExit, match="2"):
        main(words.split())
    assert why in capsys.readouterr().err
