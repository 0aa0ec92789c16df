"""What all tests share: seeded hypothesis, the sample flight, the folder of shared material."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

PROJECT = Path(__file__).resolve().parents[1]

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


@pytest.fixture(scope="session")
def sample() -> Path:
    """The folder of the recorded sample flight."""
    folder = PROJECT / "bags" / "sample"
    if not (folder / "flight.mcap").is_file():
        pytest.skip(f"no sample flight in {folder}: bags/README.md says how to make it")
    return folder


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder ``shared`` beside the project, which holds material that is not part of it."""
    folder = PROJECT.parent / "shared"
    if not folder.is_dir():
        pytest.skip(f"no {folder}: the material beside the project is absent")
    return folder
