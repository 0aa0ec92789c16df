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
"""Without any extra the core works, and what needs one names it, in one line, before it begins."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from project import PROJECT, verb_parsers

from tirgeo_ros.core.types.missing_package import PACKAGES

#: Runs verbs, given as lists in JSON; prints the exit code and stderr of each, as JSON.
RUN = """
import contextlib, io, json, sys
from tirgeo_ros.tools.cli.main import main
def run(words):
    out, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
        try:
            return main(words), said.getvalue()
        except SystemExit as ended:
            return ended.code, said.getvalue()
print(json.dumps([run(words) for words in json.loads(sys.argv[1])]))
"""
FLIGHT, PARAMS = "bags/sample/flight.mcap", ("--params", "bags/sample/params.yaml")
CLICKS = "bags/sample/observations.csv"
POINTS = ("--survey", "bags/sample/survey.geojson", "--observations", CLICKS)
BOARD = ("--board", "9x6", "--square", "0.1")
PROCESS = ("process", FLIGHT, "-o", "{0}/out.mcap", *PARAMS)
#: Words of a verb, and its line; {0} is a folder.
LINES = {
    (*PROCESS, "--map", "{0}/a.gpkg"): "reading {0}/a.gpkg needs pyogrio [maps]",
    (*PROCESS, "--map", "{0}/a.zip"): "reading {0}/a.zip needs pyogrio [maps]",
    (*PROCESS, "--video", "{0}/out.mp4"): "writing {0}/out.mp4 needs av [video]",
    (*PROCESS, "--raw-images", "--dem", "{0}/a.tif"): "reading {0}/a.tif needs rasterio [dem]",
    ("process", FLIGHT, "-o", "{0}/many/", "--video"): "writing mp4 videos needs av [video]",
    ("process", FLIGHT, "-o", "{0}/many/", "--scheduler", "tcp://127.0.0.1:9"): (
        "--scheduler tcp://127.0.0.1:9 needs distributed [cluster]"
    ),
    ("export", FLIGHT, "-o", "{0}/out", *PARAMS): (
        "writing orthophotos and mosaics needs rasterio [dem]"
    ),
    ("locate", FLIGHT, "--pixels", CLICKS, "-o", "{0}/a.kml"): (
        "writing {0}/a.kml needs mgrs [page]"
    ),
    ("evaluate", FLIGHT, *POINTS, "-o", "{0}/out"): "comparing the methods needs scipy [plots]",
    ("budget", "-o", "{0}/out"): "drawing maps into {0}/out needs matplotlib [plots]",
    ("calibrate", "lens", "docs", *BOARD, "-o", "{0}/a.yaml"): (
        "fitting the board's corners needs scipy [plots]"
    ),
    ("calibrate", "gimbal", "docs", *BOARD): "fitting the board's corners needs scipy [plots]",
    ("calibrate", "imu", FLIGHT): "estimating the noise needs scipy [plots]",
    ("calibrate", "allan", FLIGHT, "-o", "{0}/a.yaml"): "estimating the noise needs scipy [plots]",
    ("simulate", "config/scenarios/paper_flight.yaml", "-o", "{0}/out"): (
        "the Python package scipy is missing [plots]"
    ),
    ("import", "{0}/a.ulg", "-o", "{0}/out.mcap"): "reading {0}/a.ulg needs pyulog [logs]",
    ("import", "{0}/a.bin", "-o", "{0}/out.mcap"): "reading {0}/a.bin needs pymavlink [logs]",
    ("import", "{0}/a.ubx", "-o", "{0}/out.mcap"): "reading {0}/a.ubx needs pyubx2 [logs]",
    ("import", "{0}/a.nmea", "-o", "{0}/out.mcap"): "reading {0}/a.nmea needs pynmeagps [logs]",
    ("import", "{0}/a.MP4", "-o", "{0}/out.mcap"): "reading {0}/a.MP4 needs av [video]",
    (
        "import",
        "{0}/a.dat",
        "-o",
        "{0}/out.mcap",
        "--key",
        "ab" * 32,
    ): "key needs cryptography [dji]",
    ("dump", "{0}/a.dat", "--key", "ab" * 32): "key needs cryptography [dji]",
    ("demo", "-o", "{0}/out"): "writing {0}/out/overlay.mp4 needs av [video]",
    ("demo", "-o", "{0}/out", "--serial"): "--serial needs pyserial [dji]",
    ("demo", "-o", "{0}/out", "--page"): "--page needs aiohttp [page]",
    ("run", "--page"): "--page needs aiohttp [page]",
}
#: First bytes of files that are recognised by them.
HEADS = {
    "a.ulg": b"ULog\x01\x12\x35" + bytes(9),
    "a.bin": b"\xa3\x95\x80" + bytes(86),
    "a.ubx": b"\xb5\x62\x01\x07\x00\x00\x08\x19",
    "a.nmea": b"$GPHDT,25.50,T*37\r\n",
    "a.MP4": b"\0\0\0\x18ftypmp42",
    "a.dat": b"\xaa" * 40,
    "a.gpkg": b"SQLite format 3\0",
    "a.zip": b"PK\x03\x04",
    "a.tif": b"II*\0",
}


@pytest.fixture(scope="module")
def blocked(tmp_path_factory):
    """The environment of a process, and of its children, that cannot import any extra."""
    folder = tmp_path_factory.mktemp("blocked")
    for name, (_, extra, _) in PACKAGES.items():
        if extra:
            text = f"raise ModuleNotFoundError('{name} is blocked', name='{name}')\n"
            (folder / f"{name}.py").write_text(text)
    return os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{PROJECT}"}


def python(environment, *words):
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=PROJECT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def results(environment, lines):
    """The exit code and stderr of each list of words."""
    done = python(environment, "-c", RUN, json.dumps(lines))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.usefixtures("sample")
def test_each_verb_names_its_extra_in_one_line_before_it_begins(blocked, tmp_path):
    for name, head in HEADS.items():
        (tmp_path / name).write_bytes(head)
    given = [[word.format(tmp_path) for word in words] for words in LINES]
    for words, line, (code, said) in zip(
        given, LINES.values(), results(blocked, given), strict=True
    ):
        lack, _, extra = line.format(tmp_path).rpartition(" ")
        verb = " ".join(words[: 2 if words[0] == "calibrate" else 1])
        assert (code, said) == (1, f'tirgeo {verb}: {lack}: pip install "tirgeo{extra}"\n')
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == HEADS.keys()
    named = {line.rpartition("[")[2][:-1] for line in LINES.values()}
    assert named == {extra for _, extra, _ in PACKAGES.values() if extra}


def test_the_help_of_each_verb_needs_no_extra(blocked):
    verbs = [words.split() for words in verb_parsers()]
    assert len(verbs) > 15
    assert results(blocked, [[*words, "--help"] for words in verbs]) == [[0, ""]] * len(verbs)


def test_a_check_of_a_flight_reports_the_map_that_it_cannot_read(blocked, cut, params, tmp_path):
    (tmp_path / "a.gpkg").write_bytes(HEADS["a.gpkg"])
    words = ["check", cut, "--params", params, "--map", tmp_path / "a.gpkg"]
    done = python(blocked, "-m", "tirgeo_ros.tools.cli.main", *words)
    assert 'a.gpkg needs pyogrio: pip install "tirgeo[maps]"' in done.stdout


def test_a_flight_is_processed_with_its_map_as_with_all_extras(blocked, sample, cut, tmp_path):
    written = []
    for name, environment in (("without", blocked), ("with", os.environ)):
        out = tmp_path / f"{name}.mcap"
        words = ["process", cut, "-o", out, *PARAMS, "--map", sample / "map.geojson"]
        done = python(environment, "-m", "tirgeo_ros.tools.cli.main", *words)
        assert done.returncode == 0, done.stderr
        written.append(out.read_bytes())
    assert written[0] == written[1]


NODES = {
    "viewer_node": 'the Python package aiohttp is missing: pip install "tirgeo[page]"',
    "dji_node": 'reading a serial port needs pyserial: pip install "tirgeo[dji]"',
}


@pytest.mark.graph
@pytest.mark.parametrize("node", NODES)
def test_a_node_names_its_extra(blocked, node):
    done = python(blocked, "-c", f"from tirgeo_ros.nodes import start; exit(start.{node}())")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == f"{node}: {NODES[node]}"
