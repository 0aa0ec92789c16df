"""One evaluation of the sample flight for all tests of this folder."""

from __future__ import annotations

import pytest

from tirgeo_ros.tools.evaluate.evaluate import evaluate

BORESIGHT = "/**/gimbal_node:\n  ros__parameters: {boresight_rpy_deg: [0.0, 0.0, 5.0]}\n"


@pytest.fixture(scope="session")
def found(sample, tmp_path_factory):
    """The sample flight, evaluated with a boresight file that turns the camera by 5 deg."""
    boresight = tmp_path_factory.mktemp("boresight") / "boresight.yaml"
    boresight.write_text(BORESIGHT)
    return evaluate(
        *[sample / name for name in ("flight.mcap", "survey.geojson", "observations.csv")],
        params=sample / "params.yaml",
        boresight=boresight,
        truth=sample / "truth.mcap",
        map_path=sample / "map.geojson",
    )
