"""A gimbal whose joints follow each other in another order: flown, processed, and told of."""

from __future__ import annotations

import numpy as np
import pytest
from process_bags import messages_of

from tirgeo_ros.core.types.joint_orders import USUAL_ORDER
from tirgeo_ros.io import messages as convert
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.replay.check import check
from tirgeo_ros.tools.replay.graph_outputs import differences
from tirgeo_ros.tools.replay.process import process

pytestmark = pytest.mark.slow

OTHER = "pitch-yaw-roll"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Folders by order, from the verb."""
    folder = tmp_path_factory.mktemp("orders")
    (folder / "scenario.yaml").write_text("duration_s: 40.0\nroute: {hover_s: 2.0}\n")
    for order in (USUAL_ORDER, OTHER):
        given = ["-o", str(folder / order), "--no-images", "--joint-order", order]
        assert main(["simulate", str(folder / "scenario.yaml"), *given]) == 0
    return {order: folder / order for order in (USUAL_ORDER, OTHER)}


def processed(folder):
    """The camera's poses less the true ones."""
    out = folder / "out.mcap"
    process(folder / "flight.mcap", out, params=folder / "params.yaml", images=False)
    found, true = (
        [convert.camera_pose(message) for _, message in messages_of(path, "/tirgeo/camera_pose")]
        for path in (out, folder / "truth.mcap")
    )
    return differences(found, true)


def test_processing_finds_the_true_camera_as_exactly_as_with_the_usual_order(flown):
    usual, other = (processed(flown[order]) for order in (USUAL_ORDER, OTHER))
    assert len(other.stamp_ns) == len(usual.stamp_ns) > 1500
    # The filter errs as before; the encoders' 0.02 deg are about other axes.
    per_pose = np.degrees(np.abs(other.angle_rad - usual.angle_rad))
    assert np.max(per_pose) < 0.02 * 2 * 4.5
    rms_deg = np.degrees([np.sqrt(np.mean(one.angle_rad**2)) for one in (usual, other)])
    assert rms_deg[1] == pytest.approx(rms_deg[0], rel=0.05)


def test_the_wrong_order_is_told_with_its_parameter(flown):
    folder = flown[OTHER]
    right = check(folder / "flight.mcap", params=folder / "params.yaml")
    assert {one["check"] for one in right["findings"]} == {"no_pictures"}
    wrong = folder / "wrong.yaml"
    wrong.write_text((folder / "params.yaml").read_text().replace(OTHER, USUAL_ORDER))
    result = check(folder / "flight.mcap", params=wrong)
    (finding,) = (one for one in result["findings"] if one["check"] == "joint_order")
    assert finding["parameter"] == "gimbal_node joint_order"
    assert f"set it to {OTHER}" in finding["mend"]
    assert result["error"]
