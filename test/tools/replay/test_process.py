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
"""tirgeo process: what it writes, its six lines, and the same bytes from bags of all recorders."""

from __future__ import annotations

import copy
from collections import Counter

import cv2
import numpy as np
import pytest
from process_bags import CAMERA_POSE, IMAGES, data_of, messages_of, rewritten
from recorded_bags import record

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.replay.graph_outputs import differences
from tirgeo_ros.tools.replay.process import process, six_lines

WITHOUT_PICTURES = ("odometry", "fix", "origin", "camera_pose", "path", "state")
GEOMETRY = ("overlay/camera_info", "footprint")
GLOBAL = ("/diagnostics", "/tf", "/tf_static")


def test_every_output_topic_with_its_type(whole):
    folder, summary = whole
    topics = BagReader(folder / "out.mcap").topics()
    names = (*WITHOUT_PICTURES, "overlay/image", "overlay/image/compressed", *GEOMETRY)
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
    outcome = data_of(poses_only[0], "/tirgeo/odometry", CAMERA_POSE)
    assert outcome == data_of(whole[0] / "out.mcap", "/tirgeo/odometry", CAMERA_POSE)
    assert len(outcome) > 300


def test_one_picture_for_each_frame(whole, cut):
    folder, summary = whole
    frames = [convert.stamp_ns(m) for _, m in messages_of(cut, IMAGES)]
    for form in ("", "/compressed"):
        topic = f"/tirgeo/overlay/image{form}"
        outcome = [m for _, m in messages_of(folder / "out.mcap", topic)]
        assert [convert.stamp_ns(m) for m in outcome] == frames
    assert summary["overlay"]["drawn"] + summary["overlay"]["notices"] == len(frames)
    assert summary["overlay"]["drawn"] >= 0.6 * len(frames)  # a quarter passes in alignment
    capture = cv2.VideoCapture(str(folder / "out.mp4"))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == len(frames)
    assert summary["video"] == {"frames": len(frames), "rate_hz": pytest.approx(9.0, rel=1e-3)}


def test_diagnostics_once_a_second_and_the_filters_state_beside_them(whole, cut):
    folder, summary = whole
    diagnostics = [*messages_of(folder / "out.mcap", "/diagnostics")]
    times = [log_time for log_time, _ in diagnostics]
    steps_s = np.diff(times[:-1]) * 1e-9  # the last one comes when the bag ends
    np.testing.assert_allclose(steps_s, 1.0, atol=0.02)  # to the next message: at most 10 ms
    names = "/ekf_node: navigation", "/gimbal_node: camera pose", "/overlay_node: overlay"
    assert tuple(item.name for item in diagnostics[-1][1].status) == names
    written = [*messages_of(folder / "out.mcap", "/tirgeo/state")]
    assert [log_time for log_time, _ in written] == times
    states = [convert.node_state(message) for _, message in written]
    assert [state.stamp_ns for state in states] == times
    # The same input gives the same bytes: no clock of this computer.
    assert {state.started_ns for state in states} == {BagReader(cut).span_ns[0]}
    assert {(state.node, state.navigation.method) for state in states} == {
        ("/ekf_node", "ekf_heading")
    }
    assert Counter(state.navigation.state.value for state in states) == summary["states_s"]
    verdicts = {f"{a} {b}": n for (a, b), n in states[-1].navigation.counts.items()}
    assert verdicts == summary["verdicts"]
    assert {name: len(values) for name, values in summary["imu"].items()} == {
        f"{what}_{unit}": 3
        for kind, unit in (("gyro", "rad_s"), ("accel", "m_s2"))
        for what in (f"{kind}_bias", f"{kind}_bias_sigma")
    }
    # The simulated IMU's biases are some 3e-4 rad/s.
    assert np.abs(summary["imu"]["gyro_bias_rad_s"]).max() < 5e-3


@pytest.mark.slow
def test_camera_against_the_truth(sample, options, tmp_path):
    """The error of each component, after twenty seconds, is within five of its own sigmas."""
    process(sample / "flight.mcap", tmp_path / "out.mcap", images=False, **options)
    poses, truth = (
        [convert.camera_pose(m) for _, m in messages_of(path, CAMERA_POSE)]
        for path in (tmp_path / "out.mcap", sample / "truth.mcap")
    )
    settled = [p for p in poses if p.stamp_ns > truth[0].stamp_ns + 20e9]
    outcome = differences(settled, truth)
    assert len(outcome.stamp_ns) > 400
    sigmas = np.sqrt([np.diag(pose.covariance) for pose in settled[: len(outcome.stamp_ns)]])
    errors = np.hstack([outcome.position_n, outcome.rotation_n])
    assert np.abs(errors / sigmas).max() < 5


def test_namespace_moves_every_relative_topic(cut, sample, options, tmp_path, poses_only):
    def renamed(item):
        return f"/uav1{item.topic}", item.data

    moved = rewritten(cut, tmp_path / "uav1.mcap", renamed, without=[IMAGES])
    process(moved, tmp_path / "out.mcap", images=False, namespace="/uav1", **options)
    topics = set(BagReader(tmp_path / "out.mcap").topics())
    assert topics == {*GLOBAL, *(f"/uav1/tirgeo/{name}" for name in WITHOUT_PICTURES)}
    outcome = data_of(tmp_path / "out.mcap", f"/uav1{CAMERA_POSE}")
    assert outcome == data_of(poses_only[0], CAMERA_POSE)
    with pytest.raises(BagError, match=r"needed topic absent: /imu/data.*give --namespace"):
        process(moved, tmp_path / "none.mcap", images=False, **options)


RESULT = {
    "input": "flight.mcap",
    "method": "ekf_heading",
    "smoothed": False,
    "duration_s": 30.0,
    "elapsed_s": 0.7317,
    "speed": 41.0,
    "read": {"/imu/data": 3000, "/thermal/image_raw": 270},
    "undecodable": {},
    "unreadable": {},
    "unreadable_because": {},
    "written": {"/tirgeo/odometry": 2851, "/tirgeo/camera_pose": 1426},
    "state": "running",
    "reason": "",
    "states_s": {"aligning": 1, "running": 29},
    "verdicts": {"imu used": 2850, "rtk_position used": 144, "rtk_position waiting": 8},
    "heading_sigma_deg": 0.0989,
    "north_sigma_deg": None,
    "overlay": {"drawn": 256, "notices": 14, "predicted": 0},
    "notes": [],
    "video": None,
}


@pytest.fixture
def result(tmp_path):
    output = tmp_path / "out.mcap"
    output.write_bytes(bytes(26_400_000))
    return copy.deepcopy(RESULT) | {"output": str(output)}


def test_six_lines_of_a_good_flight(result):
    lines = [
        "  read     30.0 s of flight.mcap in 0.73 s, 41.0x real time; 3270 messages",
        "  state    running at the end, by ekf_heading; in all running 29 s, aligning 1 s",
        "  poses    2851 of the body, 1426 of the camera, heading to 0.10 deg",
        "  frames   256 of 270 with a trusted pose, 14 with a notice why not",
        "  refused  nothing",
        f"  output   {result['output']}, 26.4 MB",
    ]
    assert six_lines(result).splitlines() == lines
    film = {"video": {"frames": 256, "rate_hz": 9.0003}, "notes": ["one", "two", "three"]}
    more = ", and a video of 256 frames at 9 Hz; one (and 2 more, with --json)"
    assert six_lines(result | film).splitlines() == [*lines[:-1], lines[-1] + more]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"state": "lost", "reason": "no rtk"}, "state    lost at the end (no rtk)"),
        ({"written": {"/tirgeo/odometry": 9}}, "poses    9 of the body, 0 of the camera"),
        ({"written": {}, "north_sigma_deg": 3.0}, "to 0.10 deg, the gimbal's north to 3.00 deg"),
        ({"overlay": {"drawn": 256, "notices": 10}}, "10 with a notice why not, 4 lost"),
        ({"verdicts": {"imu used": 90, "imu too_old": 10}}, "refused  imu 10 of 100 too old"),
        ({"undecodable": {"/imu/data": 2}}, "refused  /imu/data 2 unreadable"),
        (
            {"unreadable": {"imu/data": 2}, "unreadable_because": {"imu/data": "not finite"}},
            "imu/data 2 unreadable (not finite)",
        ),
    ],
)
def test_lines_with_a_problem_are_first_and_marked(result, change, line):
    lines = six_lines(result | change).splitlines()
    assert line in lines[0]
    assert [text[0] for text in lines] == ["!", *"     "]


def test_the_same_bytes_from_a_recording_in_parts(cut, whole, options, tmp_path):
    messages = list(BagReader(cut).messages())
    parts = [messages[:300], messages[300:301], messages[301:]]
    folder = record(tmp_path / "bag", parts, "sqlite3", "file")
    process(folder, tmp_path / "out.mcap", raw_images=True, **options)
    assert (tmp_path / "out.mcap").read_bytes() == (whole[0] / "out.mcap").read_bytes()


def test_an_absent_part_is_reported(cut, options, tmp_path, capsys):
    messages = list(BagReader(cut).messages())
    folder = record(tmp_path / "bag", [messages[:600], messages[600:]])
    (folder / "bag_1.mcap").unlink()
    words = ["process", str(folder), "-o", str(tmp_path / "out.mcap"), "--no-images"]
    assert main([*words, "--params", str(options["params"])]) == 1
    reports = capsys.readouterr().err
    assert "bag: bag_1.mcap, named in metadata.yaml, is absent; " in reports
    assert reports.count("\n") == 1
