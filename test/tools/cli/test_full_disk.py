"""A disk that is full: exit 1, the file named, and nothing half-written.

A limit of the size of files (RLIMIT_FSIZE) makes every write beyond it fail, in any library and
without a disk of its own; the reason is then ``File too large``, in place of ``No space left``.
"""

from __future__ import annotations

import contextlib
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tirgeo_ros.core.types.errors import VideoError
from tirgeo_ros.io.video.video_file import VideoFile
from tirgeo_ros.tools.cli.main import main

SCENARIO = """\
duration_s: 6.0
route: {hover_s: 1.0}
park: {resolution_m: 0.2}
survey: {points: 4, after_s: 0.0, apart_s: 0.5}
"""


def with_files_below(size: int, *words: str) -> subprocess.CompletedProcess[str]:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    # Python does not look whether its compiled modules were written whole.
    command = [sys.executable, "-B", "-m", "tirgeo_ros.tools.cli.main", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=limit)


def test_a_flight_that_does_not_fit(sample, tmp_path):
    (tmp_path / "flight.mcap").write_bytes((sample / "flight.mcap").read_bytes()[:2_000_000])
    before = sorted(one.name for one in tmp_path.iterdir())
    words = ["process", str(tmp_path / "flight.mcap"), "-o", str(tmp_path / "out.mcap")]
    words += ["--map", str(sample / "map.geojson"), "--params", str(sample / "params.yaml")]
    run = with_files_below(500_000, *words, "--video", str(tmp_path / "out.mp4"))
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert f"{tmp_path / 'out.mcap'}: cannot be written: File too large" in run.stderr
    assert sorted(one.name for one in tmp_path.iterdir()) == before


@pytest.mark.slow
def test_a_simulation_that_does_not_fit(tmp_path):
    (tmp_path / "hover.yaml").write_text(SCENARIO)
    words = ["simulate", str(tmp_path / "hover.yaml"), "-o", str(tmp_path / "out"), "--no-images"]
    for size, name in ((1000, "map.geojson"), (100_000, "truth.mcap")):
        run = with_files_below(size, *words)
        assert run.returncode == 1
        assert run.stderr.count("\n") == 1
        assert f"{name}: cannot be written: File too large" in run.stderr
        assert all(one.stat().st_size < size for one in (tmp_path / "out").iterdir())
        assert not (tmp_path / "out" / name).exists()


@contextlib.contextmanager
def files_below(size: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    compiling, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = compiling
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def frames(video, count=40):
    rng = np.random.default_rng(3)
    for number in range(count):
        video.add(number * 40_000_000, rng.integers(0, 255, (480, 640, 3), np.uint8))


def test_a_video_that_does_not_fit(tmp_path):
    with (
        pytest.raises(VideoError, match=r"out\.mp4: cannot be written: File too large"),
        files_below(100_000),
        VideoFile(tmp_path / "out.mp4") as video,
    ):
        frames(video)
    assert list(tmp_path.iterdir()) == []


def full_for_a_moment(path):
    with VideoFile(path) as video:
        frames(video)
        with files_below(100_000):
            frames(video)
        frames(video)


def test_a_video_whose_disk_is_full_for_a_moment(tmp_path):
    """What failed once is told, though later there is room again."""
    path = tmp_path / "out.mp4"
    path.write_bytes(b"what was there")
    with pytest.raises(VideoError, match=r"out\.mp4: cannot be written: File too large"):
        full_for_a_moment(path)
    assert path.read_bytes() == b"what was there"
    assert [one.name for one in tmp_path.iterdir()] == ["out.mp4"]


def test_a_name_that_is_no_utf8(tmp_path, capsys):
    """FFmpeg alone takes none; all else does."""
    name = os.fsdecode(os.fsencode(tmp_path) + b"/\xff")
    with pytest.raises(VideoError, match=r"\.mp4: FFmpeg takes names in UTF-8 alone; give anoth"):
        VideoFile(f"{name}.mp4")
    with open(f"{name}.png", "wb") as file:  # noqa: PTH123
        file.write(b"no picture")
    words = ["calibrate", "lens", f"{name}.png", "--board", "9x6", "--square", "0.1"]
    assert main([*words, "-o", str(tmp_path / "camera.yaml")]) == 1
    assert "no picture of 1 can be used: 1 x not readable" in capsys.readouterr().err


@pytest.mark.slow
def test_a_result_with_a_name_that_is_no_utf8(sample, tmp_path):
    folder = os.fsencode(tmp_path)
    Path(os.fsdecode(folder + b"/\xff.mcap")).symlink_to(sample / "flight.mcap")
    command = [sys.executable, "-m", "tirgeo_ros.tools.cli.main", "calibrate", "imu"]
    run = subprocess.run(
        [*command, folder + b"/\xff.mcap", "-o", folder + b"/\xff.yaml", "--json"],
        capture_output=True,
        check=False,
        env=os.environ | {"LC_ALL": "C.UTF-8"},
    )
    assert run.stderr == b""
    assert run.returncode == 0
    assert b'"input": "' + folder + rb"/\udcff.mcap" in run.stdout
    assert "\\udcff.mcap" in (tmp_path / os.fsdecode(b"\xff.yaml")).read_text(encoding="utf-8")
