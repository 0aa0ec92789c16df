"""tirgeo process: what it writes, and that it is deterministic."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from process_bags import CAMERA_POSE, IMAGES, data_of, messages_of, rewritten

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.tools.replay.pose_comparison import differences
from tirgeo_ros.tools.replay.process import process

POSES = ("odometry", "fix", "origin", "camera_pose", "path")
GEOMETRY = ("overlay/camera_info", "footprint")
GLOBAL = ("/diagnostics", "/tf", "/tf_static")


def test_every_output_topic_with_its_type(whole):
    folder, summary = whole
    topics = BagReader(folder / "out.mcap").topics()
    names = (*POSES, "overlay/image", "overlay/image/compressed", *GEOMETRY)
    expected = {f"/tirgeo/{name}": TOPIC_TYPES[f"tirgeo/{name}"] for name in names}
    assert topics == expected | {name: TOPIC_TYPES[name] for name in GLOBAL}
    assert set(summary["written"]) == set(topics)
    assert summary["error"] is None


def test_same_input_same_bytes(whole, cut, options, tmp_path):
    process(cut, tmp_path / "again.mcap", raw_images=True, **options)
    assert (tmp_path / "again.mcap").read_bytes() == (whole[0] / "out.mcap").read_bytes()


def test_an_output_that_cannot_be_written_stops_the_run(cut, options, tmp_path, monkeypatch):
    def write(_writer, topic, *_rest):
        if topic == "/tirgeo/odometry":
            raise BagError("out.mcap: cannot be written: no space left")

    monkeypatch.setattr(BagWriter, "write", write)
    with pytest.raises(BagError, match=r"cannot be written: no space left"):
        process(cut, tmp_path / "out.mcap", images=False, **options)
    assert list(tmp_path.iterdir()) == []


def test_poses_are_the_same_with_and_without_pictures(whole, poses_only):
    found = data_of(poses_only[0], "/tirgeo/odometry", CAMERA_POSE)
    assert found == data_of(whole[0] / "out.mcap", "/tirgeo/odometry", CAMERA_POSE)
    assert len(found) > 300


def test_one_picture_for_each_frame(whole, cut):
    folder, summary = whole
    frames = [convert.stamp_ns(m) for _, m in messages_of(cut, IMAGES)]
    for form in ("", "/compressed"):
        topic = f"/tirgeo/overlay/image{form}"
        found = [m for _, m in messages_of(folder / "out.mcap", topic)]
        assert [convert.stamp_ns(m) for m in found] == frames
    assert summary["overlay"]["drawn"] + summary["overlay"]["notices"] == len(frames)
    assert summary["overlay"]["drawn"] >= 0.6 * len(frames)  # a quarter passes in alignment
    capture = cv2.VideoCapture(str(folder / "out.mp4"))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == len(frames)
    assert summary["video"] == {"frames": len(frames), "rate_hz": pytest.approx(9.0, rel=1e-3)}


def test_diagnostics_once_a_second(whole):
    times = [log_time for log_time, _ in messages_of(whole[0] / "out.mcap", "/diagnostics")]
    steps_s = np.diff(times[:-1]) * 1e-9  # the last one comes when the bag ends
    np.testing.assert_allclose(steps_s, 1.0, atol=0.02)  # to the next message: at most 10 ms
    last = [m for _, m in messages_of(whole[0] / "out.mcap", "/diagnostics")][-1]
    assert [item.name for item in last.status] == [
        "/ekf_node: navigation",
        "/gimbal_node: camera pose",
        "/overlay_node: overlay",
    ]
    assert convert.navigation_status(last.status[0]).method == "ekf_heading"


@pytest.mark.slow
def test_camera_against_the_truth(sample, options, tmp_path):
    """The error of each component, after twenty seconds, is within five of its own sigmas."""
    process(sample / "flight.mcap", tmp_path / "out.mcap", images=False, **options)
    poses, truth = (
        [convert.camera_pose(m) for _, m in messages_of(path, CAMERA_POSE)]
        for path in (tmp_path / "out.mcap", sample / "truth.mcap")
    )
    settled = [p for p in poses if p.stamp_ns > truth[0].stamp_ns + 20e9]
    found = differences(settled, truth)
    assert len(found.stamp_ns) > 400
    sigmas = np.sqrt([np.diag(pose.covariance) for pose in settled[: len(found.stamp_ns)]])
    errors = np.hstack([found.position_n, found.rotation_n])
    assert np.abs(errors / sigmas).max() < 5


def test_namespace_moves_every_relative_topic(cut, sample, options, tmp_path, poses_only):
    def renamed(item):
        return f"/uav1{item.topic}", item.data

    moved = rewritten(cut, tmp_path / "uav1.mcap", renamed, without=[IMAGES])
    process(moved, tmp_path / "out.mcap", images=False, namespace="/uav1", **options)
    topics = set(BagReader(tmp_path / "out.mcap").topics())
    assert topics == {*GLOBAL, *(f"/uav1/tirgeo/{name}" for name in POSES)}
    found = data_of(tmp_path / "out.mcap", f"/uav1{CAMERA_POSE}")
    assert found == data_of(poses_only[0], CAMERA_POSE)
    with pytest.raises(BagError, match=r"needed topic absent: /imu/data.*is there a --namespace"):
        process(moved, tmp_path / "none.mcap", images=False, **options)
