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
"""No command puts an output in the place of an input, of another output, or of no file.

On a full disk: exit 1, the file named, nothing half-written. A limit of the size of files
(RLIMIT_FSIZE) makes every write beyond it fail, in any library and without a disk of its own; the
reason is then ``File too large``, in place of ``No space left``.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from project import verb_parsers

from tirgeo_ros.core.types.errors import CalibrationError, VideoError
from tirgeo_ros.io.files.whole_files import check_outputs
from tirgeo_ros.io.video.video_file import VideoFile
from tirgeo_ros.tools.cli import main as command
from tirgeo_ros.tools.cli.main import main

#: Options that name what is written, and of commands that write into a folder the files in it.
WRITTEN = {"output", "video", "plot", "csv", "residuals", "geotiff"}
IN_FOLDERS = {
    "budget": ["budget.csv", "height.png"],
    "evaluate": ["observations.csv", "result.json", "report.html"],
    "export": ["mosaic.tif", "summary.json"],
    "simulate": ["flight.mcap", "map.geojson", "params.yaml"],
    "demo": ["recording.mcap", "overlay.mp4", "still.png", "summary.json"],
}
REST = {"board": "9x6", "square": "0.1"}  # what is needed beside files
PARAMETERS = {"params", "boresight"}  # are read first, for what they name
VERBS = verb_parsers()
OUTPUTS = {
    verb: [
        item.dest
        for item in parser._actions
        if item.dest in WRITTEN and (item.type is Path or item.dest == "output")
    ]
    for verb, parser in VERBS.items()
    if verb not in IN_FOLDERS
}


def inputs_of(verb):
    return [
        action
        for action in VERBS[verb]._actions
        if (action.type is Path or action.dest == "dem") and action.dest not in WRITTEN
    ]


def words(verb, folder, **places):
    """The command with every input that it can have, and with outputs where ``places`` says."""
    argv = verb.split()
    for action in inputs_of(verb):
        path = Path(places.pop(action.dest, folder / f"{action.dest}.in"))
        yaml = action.dest in PARAMETERS
        path.write_bytes(b"{}\n" if yaml else b"\xaa" * 100)
        argv += [*action.option_strings[:1], str(path)]
    for action in VERBS[verb]._actions:
        if action.dest in REST:
            argv += [action.option_strings[0], REST[action.dest]]
        if action.dest in places or (action.dest == "output" and action.required):
            place = places.get(action.dest, folder / "first.out")
            argv += [action.option_strings[0], str(place)]
    return argv


def refused(argv, capsys, *names):
    assert command.main(argv) == 1
    reports = capsys.readouterr()
    assert reports.out == ""
    assert reports.err.count("\n") == 1
    for name in names:
        assert str(name) in reports.err
    return reports.err


@pytest.mark.parametrize(
    ("verb", "taken", "output"),
    [
        (verb, action.dest, output)
        for verb in OUTPUTS
        for action, output in itertools.product(inputs_of(verb), OUTPUTS[verb])
    ],
)
def test_an_input_is_not_replaced(tmp_path, capsys, verb, taken, output):
    path, other = tmp_path / "taken.mp4", tmp_path / "other.mp4"
    argv = words(verb, tmp_path, **{taken: path, output: other})
    other.symlink_to(path)
    before = path.read_bytes()
    assert "would overwrite the input" in refused(argv, capsys, path, other)
    assert path.read_bytes() == before
    assert other.is_symlink()


@pytest.mark.parametrize(
    ("verb", "name", "taken"),
    [
        (verb, name, action.dest)
        for verb, names in IN_FOLDERS.items()
        for name, action in itertools.product(names, inputs_of(verb))
    ],
)
def test_an_input_in_the_folder_is_not_replaced(tmp_path, capsys, verb, name, taken):
    (tmp_path / "results").mkdir()
    path = tmp_path / "results" / name
    argv = words(verb, tmp_path, **{taken: path, "output": tmp_path / "results"})
    before = path.read_bytes()
    assert "would overwrite the input" in refused(argv, capsys, path)
    assert path.read_bytes() == before
    assert [item.name for item in path.parent.iterdir()] == [name]


@pytest.mark.parametrize(
    ("verb", "first", "second"),
    [(verb, *pair) for verb in OUTPUTS for pair in itertools.combinations(OUTPUTS[verb], 2)],
)
def test_two_outputs_have_two_names(tmp_path, capsys, verb, first, second):
    path = tmp_path / "out.mp4"
    argv = words(verb, tmp_path, **{first: path, second: tmp_path / "." / "out.mp4"})
    assert "would overwrite the output" in refused(argv, capsys, path)
    assert not path.exists()


@pytest.mark.parametrize(
    ("verb", "output"), [(verb, output) for verb in OUTPUTS for output in OUTPUTS[verb]]
)
def test_a_pipe_a_device_or_a_folder_is_no_place_for_a_file(tmp_path, capsys, verb, output):
    """Root would replace them; what is done to the pipe here is done to a device."""
    path = tmp_path / "pipe.mp4"
    os.mkfifo(path)
    argv = words(verb, tmp_path, **{output: path})
    assert "pipe.mp4: not a file; give the output another name" in refused(argv, capsys, path)
    assert path.is_fifo()


def test_files_in_the_parameters_are_not_replaced(tmp_path, capsys):
    """Maps, their companions, style sheets, elevation models, calibrations."""
    names = {"map": "park.shp", "style": "s.yaml", "dem": "d.tif", "camera": "c.yaml"}
    lines = [f"    {key}: {tmp_path / name}\n" for key, name in names.items()]
    (tmp_path / "given.yaml").write_text("overlay_node:\n  ros__parameters:\n" + "".join(lines))
    for name in (*names.values(), "park.dbf"):
        (tmp_path / name).write_bytes(b"{}")
        bag, params, out = tmp_path / "a.mcap", tmp_path / "given.yaml", tmp_path / name
        argv = ["process", str(bag), "--params", str(params), "-o", str(out)]
        assert "would overwrite the input" in refused(argv, capsys, out)
        assert out.read_bytes() == b"{}"


def test_other_names_of_one_file(tmp_path):
    path, link, hard = (tmp_path / name for name in ("a", "b", "c"))
    path.write_text("a")
    link.symlink_to(path)
    hard.hardlink_to(path)
    for other in (path, link, hard, tmp_path / "x" / ".." / "a"):
        with pytest.raises(CalibrationError, match="would overwrite the input"):
            check_outputs([other], [path], CalibrationError)
        with pytest.raises(CalibrationError, match="would overwrite the input"):
            check_outputs([path], [other], CalibrationError)
    check_outputs([path, None, ""], [tmp_path / "d", None, ""], CalibrationError)


def test_the_commands_own_output_is_not_replaced(tmp_path):
    """As in ``tirgeo locate ... -o points > points``, and for /dev/stdout there."""
    path = tmp_path / "said"
    with path.open("w") as file:
        before = os.dup(1)
        os.dup2(file.fileno(), 1)
        try:
            for name in (path, "/dev/stdout"):
                with pytest.raises(CalibrationError, match="would overwrite standard output"):
                    check_outputs([], [name], CalibrationError)
        finally:
            os.dup2(before, 1)
            os.close(before)


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


def test_a_flight_that_does_not_fit(sample, tmp_path, capsys):
    (tmp_path / "flight.mcap").write_bytes((sample / "flight.mcap").read_bytes()[:2_000_000])
    before = sorted(item.name for item in tmp_path.iterdir())
    words = ["process", str(tmp_path / "flight.mcap"), "-o", str(tmp_path / "out.mcap")]
    words += ["--map", str(sample / "map.geojson"), "--params", str(sample / "params.yaml")]
    with files_below(500_000):
        assert main([*words, "--video", str(tmp_path / "out.mp4")]) == 1
    reports = capsys.readouterr().err
    assert reports.count("\n") == 1
    assert f"{tmp_path / 'out.mcap'}: cannot be written: File too large" in reports
    assert sorted(item.name for item in tmp_path.iterdir()) == before


def frames(video, count=40):
    rng = np.random.default_rng(3)
    for number in range(count):
        video.add(number * 40_000_000, rng.integers(0, 255, (480, 640, 3), np.uint8))


def test_a_video_whose_disk_is_full_for_a_moment(tmp_path):
    """An earlier failure is reported, although there is room again later."""
    path = tmp_path / "out.mp4"
    path.write_bytes(b"what was there")

    def full_for_a_moment():
        with VideoFile(path) as video:
            frames(video)
            with files_below(100_000):
                frames(video)
            frames(video)

    with pytest.raises(VideoError, match=r"out\.mp4: cannot be written: File too large"):
        full_for_a_moment()
    assert path.read_bytes() == b"what was there"
    assert [item.name for item in tmp_path.iterdir()] == ["out.mp4"]


def test_a_name_that_is_not_utf8(tmp_path, capsys):
    """Only FFmpeg refuses such names."""
    name = os.fsdecode(os.fsencode(tmp_path) + b"/\xff")
    with pytest.raises(VideoError, match=r"\.mp4: the name is not UTF-8, as FFmpeg needs it"):
        VideoFile(f"{name}.mp4")
    with open(f"{name}.png", "wb") as file:  # noqa: PTH123  as a user writes it
        file.write(b"no picture")
    words = ["calibrate", "lens", f"{name}.png", "--board", "9x6", "--square", "0.1"]
    assert main([*words, "-o", str(tmp_path / "camera.yaml")]) == 1
    assert "no picture of 1 can be used: 1 x not readable" in capsys.readouterr().err


@pytest.mark.slow
def test_a_result_with_a_name_that_is_not_utf8(sample, tmp_path):
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
