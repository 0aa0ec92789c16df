"""The first seconds of the sample flight, and what process makes of them."""

from __future__ import annotations

import pytest
from process_bags import rewritten

from tirgeo_ros.tools.replay.process import process

CUT_S = 4.0  # alignment takes one second of it


@pytest.fixture(scope="session")
def cut(sample, tmp_path_factory):
    """The sample's first seconds, with pictures."""
    path = tmp_path_factory.mktemp("cut") / "flight.mcap"
    return rewritten(sample / "flight.mcap", path, seconds=CUT_S)


@pytest.fixture(scope="session")
def options(sample):
    return {"params": sample / "params.yaml", "map": sample / "map.geojson"}


@pytest.fixture(scope="session")
def whole(cut, options, tmp_path_factory):
    """The cut with everything that can be asked for: folder and summary."""
    folder = tmp_path_factory.mktemp("whole")
    files = {"raw_images": True, "video": folder / "out.mp4"}
    return folder, process(cut, folder / "out.mcap", **files, **options)


@pytest.fixture(scope="session")
def poses_only(cut, options, tmp_path_factory):
    """The cut without pictures."""
    path = tmp_path_factory.mktemp("poses") / "out.mcap"
    return path, process(cut, path, images=False, **options)
