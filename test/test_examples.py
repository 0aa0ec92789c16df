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
"""The scripts and the notebook of examples/ run as a user runs them, and make what they say."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

import cv2
import numpy as np
import pytest
from project import PROJECT

import tirgeo_ros

EXAMPLES = PROJECT / "examples"
NOTEBOOK = EXAMPLES / "flight.ipynb"
#: Where the scripts write, which git ignores.
OUTPUT = "examples_output"
README = (EXAMPLES / "README.md").read_text()


def run(name, folder):
    """Run an example in a folder; return what it printed."""
    environment = os.environ | {"PYTHONPATH": str(PROJECT), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, EXAMPLES / name],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    assert [path.name for path in folder.iterdir()] == [OUTPUT]
    return done.stdout


def is_drawing(path):
    """Whether a picture has shapes in it, not one colour."""
    return len(np.unique(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))) > 20


@pytest.mark.slow
@pytest.mark.usefixtures("sample")
class TestScripts:
    def test_filter_csv(self, tmp_path):
        text = run("01_filter_csv.py", tmp_path)
        assert re.match(r"2851 solutions, state running, .*'used': 144", text)
        assert is_drawing(tmp_path / OUTPUT / "heading.png")

    def test_project_survey(self, tmp_path):
        """The points are corners of outlines in the picture: there the grey steps."""
        text = run("02_project_survey.py", tmp_path)
        assert int(re.match(r"(\d+) points in the picture of \d+ ns", text)[1]) >= 5
        assert is_drawing(tmp_path / OUTPUT / "survey.png")

    def test_locate_pixels(self, tmp_path):
        text = run("03_locate_pixels.py", tmp_path)
        result = re.findall(r"P\d\d: (\S+) m from the survey, 95 % within (\S+) m", text)
        inside = [float(error) <= float(radius) for error, radius in result]
        # Of 23 points 19 or more are inside 95 % ellipses with a probability of 99.4 %.
        assert len(inside) == 23
        assert sum(inside) >= 19
        document = json.loads((tmp_path / OUTPUT / "points.geojson").read_text())
        kinds = [feature["properties"]["kind"] for feature in document["features"]]
        assert kinds.count("point") == kinds.count("ellipse") == 23

    def test_rtk_outage(self, tmp_path):
        text = run("04_rtk_outage.py", tmp_path)
        errors = re.findall(r"largest error (\S+) m, sigma then (\S+) m", text)
        (error, _), (longer, sigma) = [tuple(map(float, pair)) for pair in errors]
        assert error < longer < 3 * sigma
        assert is_drawing(tmp_path / OUTPUT / "outage.png")

    def test_own_sensors(self, tmp_path):
        """The circle that the sensors were made of is what comes out."""
        assert run("05_own_sensors.py", tmp_path).startswith("state running, 2850 poses")
        topic = "tirgeo/odometry"
        poses = tirgeo_ros.read_bag(tmp_path / OUTPUT / "own_poses.mcap", [topic])[topic]
        plane = tirgeo_ros.read_bag(tmp_path / OUTPUT / "own.mcap", ["rtk/fix"])["rtk/fix"]
        origin = tirgeo_ros.TangentPlane(
            *(plane[name][0] for name in ("latitude_rad", "longitude_rad", "height_m"))
        )
        seconds = (poses["stamp_ns"] - plane["stamp_ns"][0]) * 1e-9
        angle = 6.0 / 40.0 * seconds
        circle = np.stack([40 * np.sin(angle), 40 - 40 * np.cos(angle)], axis=1)
        apart = circle - np.stack([poses["north_m"], poses["east_m"]], axis=1)
        # The origin is the first fix, of sigma 1 cm; the filter's own sigma is below that.
        assert origin.height_m == pytest.approx(630.0, abs=0.05)
        assert np.abs(apart).max() < 5 * 0.01 * 2**0.5


@pytest.mark.slow
@pytest.mark.usefixtures("sample")
def test_the_notebook_runs_from_the_top(monkeypatch):
    import matplotlib as mpl  # noqa: PLC0415  slow to import

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415  heavy

    monkeypatch.chdir(EXAMPLES)
    plt.close("all")
    namespace = {}
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    for cell in (cell for cell in cells if cell["cell_type"] == "code"):
        exec(compile("".join(cell["source"]), cell["id"], "exec"), namespace)
    assert len(plt.get_fignums()) == 3
    assert all(plt.figure(number).axes[0].has_data() for number in plt.get_fignums())
    plt.close("all")
    inside = [item.ellipse.major_m < 1.0 for item in namespace["located"]]
    assert len(inside) >= 3
    assert all(inside)


def test_the_readme_lists_every_example():
    files = {path.name for path in EXAMPLES.iterdir() if path.suffix in {".py", ".ipynb"}}
    assert set(re.findall(r"^\| `([\w.]+)` \|", README, re.MULTILINE)) == files


def test_examples_use_the_public_interface_alone():
    for path in EXAMPLES.glob("*.*"):
        text = path.read_text()
        assert "from tirgeo_ros" not in text
        named = set(re.findall(r"\btirgeo_ros\.(\w+)", text))
        assert named <= set(tirgeo_ros.__all__), path.name
