"""The whole graph on the sample flight, the aircraft as bytes on a pseudo-terminal.

One time base for the pictures and the link, judged beside the bag's own samples.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")
pytest.importorskip("serial", reason="needs pyserial")

from graph_helpers import stamps_of

from tirgeo_ros import read_camera
from tirgeo_ros.core.accuracy.ground_errors import GroundErrors
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import body_pose
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.evaluate.experiment import load_experiment
from tirgeo_ros.tools.evaluate.result import (
    body_errors,
    ground_errors,
    load_truth,
    locate_observations,
)
from tirgeo_ros.tools.graph.demo import SETTLED_S
from tirgeo_ros.tools.graph.node_graph import GraphRun, run_graph
from tirgeo_ros.tools.replay.graph_outputs import Outputs, read_outputs
from tirgeo_ros.tools.replay.process import process

pytestmark = [pytest.mark.graph, pytest.mark.slow, pytest.mark.long]  # wants a quiet machine

#: The project's figure: heading and ground error of the serial run against those of the bag run.
AS_GOOD = 1.25
#: A machine with other work starves a node now and then; the bag's run loses none.
MOST = 0.95


@pytest.fixture(scope="module")
def flown(sample_graph, tmp_path_factory) -> tuple[GraphRun, Outputs]:
    """One run in real time, its outputs stamped as the bag is."""
    run = run_graph(sample_graph(tmp_path_factory.mktemp("serial"), serial=True), 30.0)
    return run, read_outputs(run.recording).earlier(run.shift_ns)


@pytest.fixture(scope="module")
def processed(sample, tmp_path_factory) -> Path:
    """What the bag's own samples give."""
    path = tmp_path_factory.mktemp("bag") / "offline.mcap"
    process(sample / "flight.mcap", path, params=sample / "params.yaml", images=False)
    return path


def heading_rad(path: Path, sample: Path, shift_ns: int = 0) -> float:
    """Root mean square error of the nose's heading, once it has settled."""
    cdr = Cdr()
    bodies = [
        body_pose(cdr.deserialize(item.data, item.typename))
        for item in BagReader(path).messages(["/tirgeo/odometry"])
    ]
    bodies = [replace(body, stamp_ns=body.stamp_ns - shift_ns) for body in bodies]
    return body_errors(bodies, load_truth(sample / "truth.mcap"), SETTLED_S).heading_rad


def ground(outputs: Outputs, sample) -> GroundErrors:
    poses: PoseBuffer[CameraPose] = PoseBuffer(1e9)
    for pose in outputs.cameras:
        poses.add(pose)
    overlay = ParameterFile(sample / "params.yaml").config("overlay_node", OverlayConfig)
    assert outputs.plane is not None
    located, _ = locate_observations(
        poses,
        outputs.plane,
        read_camera(sample / "flight.mcap"),
        load_experiment(sample / "survey.geojson", sample / "observations.csv"),
        overlay.ground_height_m,
        overlay,
    )
    return ground_errors(located)


def test_every_picture_keeps_its_place_in_time(flown, sample):
    run, outputs = flown
    sent = stamps_of(sample / "flight.mcap", "/thermal/image_raw/compressed")
    assert run.error is None
    assert set(outputs.frame_stamps_ns) <= set(sent)  # to the nanosecond
    assert len(outputs.frame_stamps_ns) >= MOST * len(sent)


def test_heading_and_ground_error_are_as_good_as_the_bags(flown, processed, sample):
    run, outputs = flown
    offline = read_outputs(processed)
    assert len(outputs.cameras) >= MOST * len(offline.cameras)
    nose = heading_rad(run.recording, sample, run.shift_ns)
    assert nose <= AS_GOOD * heading_rad(processed, sample)
    on_ground, of_bag = ground(outputs, sample), ground(offline, sample)
    assert len(on_ground.ids) >= MOST * len(of_bag.ids) >= 20
    assert on_ground.rmse_m <= AS_GOOD * of_bag.rmse_m


def link_item(recording) -> dict[str, str]:
    """The newest values of the link's diagnostic."""
    cdr = Cdr()
    for item in [*BagReader(recording).messages(["/diagnostics"])][::-1]:
        for status in cdr.deserialize(item.data, item.typename).status:
            if status.name == "/dji_node: link" and "receiving" in status.message:
                return {pair.key: pair.value for pair in status.values}
    return {}


def test_the_nodes_tell_of_a_sound_link(flown):
    run, outputs = flown
    link = link_item(run.recording)
    assert link["state"] == "receiving"
    assert int(link["frames skipped_bytes"]) == 0
    navigation = outputs.navigation[-1]
    assert (navigation.method, navigation.rtk_status) == ("ekf_heading", FixStatus.FIXED)
    aligning_s = 1.5  # its window, and max_delay_s
    assert navigation.counts["imu", "used"] > MOST * (3000 - 100 * aligning_s)
    assert navigation.counts.get(("imu", "out_of_order"), 0) == 0
    log = (run.recording.parent / "bag_player.log").read_text()
    assert "not played" not in log  # no byte was dropped
