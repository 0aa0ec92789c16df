"""One evaluation of the sample flight for all tests of this folder."""

from __future__ import annotations

import pytest
from process_bags import RTK, files, rewritten

from tirgeo_ros.tools.evaluate.evaluate import evaluate

BORESIGHT = "/**/gimbal_node:\n  ros__parameters: {boresight_rpy_deg: [0.0, 0.0, 5.0]}\n"


@pytest.fixture(scope="session")
def result(sample, tmp_path_factory):
    """The sample flight, evaluated with a boresight file that turns the camera by 5 deg."""
    boresight = tmp_path_factory.mktemp("boresight") / "boresight.yaml"
    boresight.write_text(BORESIGHT)
    return evaluate(
        *files(sample),
        params=sample / "params.yaml",
        boresight=boresight,
        truth=sample / "truth.mcap",
    )


@pytest.fixture(scope="session")
def raw_flight(sample, tmp_path_factory):
    """The sample's files, of the bag as much as the method raw needs: quickly evaluated."""
    bag = tmp_path_factory.mktemp("raw") / "raw.mcap"
    pictures = {"/thermal/image_raw/compressed"}
    rewritten(sample / "flight.mcap", bag, without=RTK | pictures, seconds=16)
    return [bag, *files(sample)[1:]]
