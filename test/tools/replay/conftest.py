"""Outputs of process for the first seconds of the sample flight."""

from __future__ import annotations

import pytest

from tirgeo_ros.tools.replay.process import process


@pytest.fixture(scope="session")
def whole(cut, options, tmp_path_factory):
    """The cut with all outputs: folder and summary."""
    folder = tmp_path_factory.mktemp("whole")
    files = {"raw_images": True, "video": folder / "out.mp4"}
    return folder, process(cut, folder / "out.mcap", **files, **options)


@pytest.fixture(scope="session")
def poses_only(cut, options, tmp_path_factory):
    """The cut without pictures."""
    path = tmp_path_factory.mktemp("poses") / "out.mcap"
    return path, process(cut, path, images=False, **options)
