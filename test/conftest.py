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
"""What all tests share: seeded hypothesis, the sample flight and parts of it, shared material."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from project import PROJECT

# A test says the same thing twice: no random seed, no stored examples, no clock.
settings.register_profile(
    "tirgeo",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
# For the oldest versions of the libraries: they differ in what they can do, not in rare numbers.
settings.register_profile("brief", settings.get_profile("tirgeo"), max_examples=15)
settings.load_profile("tirgeo")

#: Files that take half a minute or more, the longest first: each runs in one worker, and one
#: that came late would leave the other processors idle at the end. None of nodes/: those files
#: would all begin together, and graphs beside graphs on few processors lose messages.
LONG = (
    "scenario/test_table.py",
    "scenario/test_real_flights.py",
    "scenario/test_planted_faults.py",
    "dev/test_planted_faults.py",
    "scenario/test_wrong_headings.py",
    "tools/evaluate/test_evaluate.py",
    "tools/calibrate/test_boresight.py",
    "tools/calibrate/test_lens.py",
    "tools/calibrate/test_allan.py",
    "io/maps/test_bombs.py",
    "core/calibration/test_aircraft_fit.py",
    "nodes/test_graph.py",
    "nodes/test_lifecycle.py",
    "nodes/test_parameters.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files that take long first."""
    ranks = {PROJECT / "test" / name: rank for rank, name in enumerate(LONG)}
    assert all(path.is_file() for path in ranks), "LONG names a file that is gone"
    items.sort(key=lambda item: ranks.get(item.path, len(LONG)))


@pytest.fixture(scope="session")
def sample() -> Path:
    """The folder of the recorded sample flight."""
    folder = PROJECT / "bags" / "sample"
    if not (folder / "flight.mcap").is_file():
        pytest.skip(f"no sample flight in {folder}: bags/README.md says how to make it")
    return folder


def _first_seconds(sample: Path, made, seconds: float) -> Path:
    from process_bags import rewritten  # noqa: PLC0415 few tests need it

    path = made.mktemp("cut") / "flight.mcap"
    return rewritten(sample / "flight.mcap", path, seconds=seconds)


@pytest.fixture(scope="session")
def cut(sample: Path, tmp_path_factory) -> Path:
    """The sample's first four seconds, one of which is alignment."""
    return _first_seconds(sample, tmp_path_factory, 4)


@pytest.fixture(scope="session")
def short(sample: Path, tmp_path_factory) -> Path:
    """The sample's first six seconds."""
    return _first_seconds(sample, tmp_path_factory, 6)


@pytest.fixture(scope="session")
def nine_s(sample: Path, tmp_path_factory) -> Path:
    """The sample's first nine seconds."""
    return _first_seconds(sample, tmp_path_factory, 9)


@pytest.fixture(scope="session")
def params(sample: Path) -> Path:
    """The sample's file of parameters."""
    return sample / "params.yaml"


@pytest.fixture(scope="session")
def options(sample: Path, params: Path) -> dict[str, Path]:
    """The sample's parameters and map, as arguments of process."""
    return {"params": params, "map": sample / "map.geojson"}


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder ``shared`` beside the project, which holds material that is not part of it."""
    folder = PROJECT.parent / "shared"
    if not folder.is_dir():
        pytest.skip(f"no {folder}: the material beside the project is absent")
    return folder
