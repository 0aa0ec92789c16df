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
"""Short flights of the sample, and a run over them and a broken one."""

from __future__ import annotations

import json

import pytest
from process_bags import IMAGES, rewritten

from tirgeo_ros.tools.cli import main as command


@pytest.fixture(scope="session")
def flights(sample, tmp_path_factory):
    """Two flights of some seconds without pictures, of one name in two folders."""
    folder = tmp_path_factory.mktemp("flights")
    bags = [folder / name / "flight.mcap" for name in ("east", "west")]
    for bag, seconds in zip(bags, (4.0, 3.0), strict=True):
        bag.parent.mkdir()
        rewritten(sample / "flight.mcap", bag, seconds=seconds, without=[IMAGES])
    return bags


@pytest.fixture(scope="session")
def broken(tmp_path_factory):
    path = tmp_path_factory.mktemp("broken") / "broken.mcap"
    path.write_bytes(b"no bag")
    return path


@pytest.fixture(scope="session")
def words(sample):
    """The options of the runs."""
    return ["--params", str(sample / "params.yaml"), "--no-images"]


@pytest.fixture(scope="session")
def run(words):
    """Run ``tirgeo process`` over flights; return its exit code."""

    def process(bags, folder, *more):
        return command.main(["process", *map(str, bags), "-o", str(folder), *words, *more])

    return process


@pytest.fixture(scope="session")
def season(flights, broken, run, tmp_path_factory):
    """The folder of a run, its exit code and its records."""
    folder = tmp_path_factory.mktemp("out") / "season"
    code = run([*flights, broken], folder)
    return (
        folder,
        code,
        {path.stem: json.loads(path.read_text()) for path in folder.glob("*.json")},
    )
