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
"""tirgeo process: what bad, damaged or missing input does."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from process_bags import CAMERA_POSE, CDR, IMAGES, data_of, messages_of, rewritten, same

from tirgeo_ros.core.types.errors import BagError, ConfigError, MapError, VideoError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.replay.process import process

#: Whether a filter falls back on ordinary GPS is the estimator's affair.
FIXES = "/rtk/fix( or /gps/fix)?"
ALL_RTK = ("/rtk/fix", "/rtk/vel", "/rtk/heading")


@pytest.mark.parametrize(
    ("method", "missing", "named"),
    [
        ("ekf_heading", ["/imu/data"], "/imu/data"),
        ("ekf_heading", ["/imu/data", "/gps/fix", "/rtk/fix"], f"/imu/data, {FIXES}"),
        ("rtk", ["/rtk/fix"], "/rtk/fix"),
        (
            "ekf",
            ["/gimbal/joint_states", "/gimbal/attitude"],
            "/gimbal/joint_states or /gimbal/attitude; without it, tirgeo process --no-images",
        ),
        ("ekf", [IMAGES], "/thermal/image_raw or /thermal/image_raw/compressed"),
        ("ekf", ["/thermal/camera_info"], "/thermal/camera_info"),
    ],
)
def test_absent_topics_are_named_and_nothing_is_written(
    cut, options, tmp_path, method, missing, named
):
    bag = rewritten(cut, tmp_path / "in.mcap", without=missing)
    with pytest.raises(BagError, match=rf"in\.mcap: needed topic absent: {named}(;| gives|$)"):
        process(bag, tmp_path / "out.mcap", method=method, **options)
    assert [entry.name for entry in tmp_path.iterdir()] == ["in.mcap"]


def test_a_log_time_after_2038_costs_its_message_alone(cut, sample, tmp_path, capsys):
    items, bag = list(BagReader(cut).messages()), tmp_path / "in.mcap"
    one = next(m for m in items[100:] if m.topic == "/imu/data")
    with BagWriter(bag) as writer:
        for m in items:
            late_ns = (1 << 31) * 10**9 if m is one else m.log_time_ns
            writer.write(m.topic, m.typename, m.data, late_ns)
    params = ["--params", str(sample / "params.yaml"), "--no-images"]
    for output in (["-o", str(tmp_path / "out.mcap")], [str(cut), "-o", str(tmp_path / "season")]):
        assert main(["process", str(bag), *output, *params]) == 1
    assert "1 messages with a log time after 2038 left out" in capsys.readouterr().err
    poses = [len(data_of(path, CAMERA_POSE)) for path in tmp_path.rglob("*.mcap") if path != bag]
    assert len(poses) == 3
    assert min(poses) > 20


@pytest.mark.parametrize(
    ("absent", "method", "warning", "note"),
    [
        ((), "ekf_heading", None, None),
        (("/rtk/heading",), "ekf", None, "method ekf: the bag has no /rtk/heading"),
        (("/rtk/vel",), "ekf_heading", "has no /rtk/vel: continuing without it", None),
        (
            ALL_RTK,
            "ekf",
            "has no /rtk/fix, /rtk/vel: continuing without it",
            f"{', '.join(ALL_RTK)}; the filter uses ordinary GPS",
        ),
    ],
)
def test_the_method_fits_the_topics_of_the_bag(
    cut, sample, tmp_path, absent, method, warning, note
):
    """An aid that the method lacks is a warning; the filter aligns with the available aids."""
    bag = rewritten(cut, tmp_path / "in.mcap", without=absent)
    params = [sample / "params.yaml", soon(tmp_path / "soon.yaml")]
    summary = process(bag, tmp_path / "out.mcap", params=params, images=False)
    assert summary["method"] == method
    assert summary["warning"] == (warning and f"{bag} {warning}")
    assert [text.endswith(note) for text in summary["notes"]] == ([True] if note else [])
    if "/rtk/fix" not in absent:
        assert summary["error"] is None
        assert summary["written"][CAMERA_POSE] > 20


def soon(path):
    """Parameters of a filter that waits for a better alignment for half a second."""
    path.write_text("/**/ekf_node:\n  ros__parameters: {alignment: {wait_s: 0.5}}\n")
    return path


def test_poses_of_the_body_need_no_gimbal(cut, options, tmp_path, poses_only):
    """The odometry is the same to the last bit; there are no camera poses."""
    gimbal = ("/gimbal/joint_states", "/gimbal/attitude")
    bag = rewritten(cut, tmp_path / "in.mcap", without=gimbal)
    summary = process(bag, tmp_path / "out.mcap", images=False, **options)
    assert summary["notes"] == ["the bag has no gimbal topic: no camera poses"]
    assert summary["error"] is None
    assert CAMERA_POSE not in summary["written"]
    result = data_of(tmp_path / "out.mcap", "/tirgeo/odometry")
    assert len(result) > 200
    assert result == data_of(poses_only[0], "/tirgeo/odometry")


def unstamped(item, topics):
    message = CDR.deserialize(item.data, item.typename)
    message.header.stamp.sec = message.header.stamp.nanosec = 0
    return item.topic, CDR.serialize(message, item.typename) if item.topic in topics else item.data


def test_samples_without_a_stamp_are_of_their_arrival_less_the_delay(
    cut, sample, tmp_path, poses_only
):
    """The sample's RTK arrives 80 ms after the measurement: the same poses, bit for bit."""
    topics = ("/rtk/fix", "/rtk/vel", "/rtk/heading", "/gimbal/joint_states")
    without = [IMAGES]
    bag = rewritten(cut, tmp_path / "in.mcap", lambda i: unstamped(i, topics), without=without)
    delay = tmp_path / "delay.yaml"
    delay.write_text("/**:\n  ros__parameters: {rtk: {delay_s: 0.08}}\n")
    params = [sample / "params.yaml", delay]
    summary = process(bag, tmp_path / "out.mcap", params=params, images=False)
    number = {topic: summary["read"][topic] for topic in topics}
    assert summary["stamped_at_arrival"] == {t.lstrip("/"): n for t, n in number.items()}
    for topic in ("/tirgeo/odometry", CAMERA_POSE):
        result = data_of(tmp_path / "out.mcap", topic)
        assert len(result) > 100
        assert result == data_of(poses_only[0], topic)
    reports = [m for _, m in messages_of(tmp_path / "out.mcap", "/diagnostics")][-1].status[0]
    values = {pair.key: pair.value for pair in reports.values}
    assert values["stamped_at_arrival.rtk/fix"] == str(number["/rtk/fix"])


def test_frames_without_a_stamp_are_of_their_arrival(cut, options, whole, tmp_path):
    """The same frames are drawn as with stamps; once, all with stamp 0 counted as one frame."""
    bag = rewritten(cut, tmp_path / "in.mcap", lambda item: unstamped(item, (IMAGES,)))
    summary = process(bag, tmp_path / "out.mcap", **options)
    arrivals = [item.log_time_ns for item in BagReader(cut).messages([IMAGES])]
    assert summary["stamped_at_arrival"] == {IMAGES.lstrip("/"): len(arrivals)}
    pictures = messages_of(tmp_path / "out.mcap", "/tirgeo/overlay/image/compressed")
    assert [convert.stamp_ns(message) for _, message in pictures] == arrivals
    drawn = [one["overlay"]["drawn"] for one in (summary, whole[1])]
    assert abs(drawn[0] - drawn[1]) <= 1  # the first that has a pose lies a little elsewhere


def spoiled(item, number):
    """Every tenth message of a topic made worthless: cut, other joints, not finite."""
    kind = number // 10 % 3
    if item.topic not in {"/imu/data", "/rtk/fix", "/gimbal/joint_states"} or number % 10:
        return same(item)
    if kind == 0:
        return item.topic, item.data[: len(item.data) // 2]
    message = CDR.deserialize(item.data, item.typename)
    if item.topic == "/imu/data":
        message.angular_velocity.x = math.nan
        message.orientation.w = message.orientation.z = 0.0
    if item.topic == "/rtk/fix":
        message.altitude = math.inf
    if item.topic == "/gimbal/joint_states":
        message.name = ["somebody_elses_joint"] * 3 if kind == 1 else message.name
        message.position = np.full(3, math.nan)
    return item.topic, CDR.serialize(message, item.typename)


def finite(path):
    for item in BagReader(path).messages(["/tirgeo/odometry", CAMERA_POSE]):
        message = CDR.deserialize(item.data, item.typename)
        read = convert.camera_pose if item.topic == CAMERA_POSE else convert.body_pose
        pose = read(message)
        assert np.isfinite(pose.position_n).all()
        assert np.isfinite(pose.covariance).all()
        assert np.isfinite(dataclasses.astuple(pose)[2]).all()


def test_bad_messages_are_counted_and_never_come_out(cut, options, tmp_path):
    counts: dict[str, int] = {}

    def edit(item):
        counts[item.topic] = counts.get(item.topic, 0) + 1
        return spoiled(item, counts[item.topic])

    bag = rewritten(cut, tmp_path / "in.mcap", edit)
    summary = process(bag, tmp_path / "out.mcap", images=False, **options)
    tenth = counts["/imu/data"] // 10
    assert summary["undecodable"]["/imu/data"] == pytest.approx(tenth / 3, abs=1)
    assert summary["verdicts"]["imu invalid"] == pytest.approx(2 * tenth / 3, abs=1)
    assert summary["verdicts"]["rtk_position invalid"] > 0
    assert summary["unreadable"]["gimbal/joint_states"] > 0
    assert summary["gimbal"]["invalid"] > 0
    assert summary["written"][CAMERA_POSE] > 50
    assert summary["error"] is None
    finite(tmp_path / "out.mcap")


def test_stamps_that_go_back_start_again(cut, options, tmp_path):
    """The second half of the cut is stamped two seconds early, as after a clock was set."""
    first_ns, last_ns = BagReader(cut).span_ns

    def edit(item):
        if item.log_time_ns < (first_ns + last_ns) // 2 or item.topic == IMAGES:
            return same(item)
        message = CDR.deserialize(item.data, item.typename)
        message.header.stamp.sec -= 2
        return item.topic, CDR.serialize(message, item.typename)

    bag = rewritten(cut, tmp_path / "in.mcap", edit)
    summary = process(bag, tmp_path / "out.mcap", images=False, **options)
    assert summary["verdicts"]["imu time_jump"] == 1
    assert summary["gimbal"]["went_back"] == 1
    assert summary["state"] == "running"
    finite(tmp_path / "out.mcap")


def test_damaged_bag_is_processed_as_far_as_it_goes(cut, options, tmp_path, capsys):
    bag, out = tmp_path / "torn.mcap", tmp_path / "out.mcap"
    bag.write_bytes(cut.read_bytes()[: cut.stat().st_size * 7 // 10])
    arguments = [f"--{key}={value}" for key, value in options.items()]
    code = main(["process", str(bag), "-o", str(out), "--no-images", "--json", *arguments])
    message_text = capsys.readouterr()
    assert code == 1
    assert message_text.err.count("\n") == 1
    assert message_text.err.startswith(f"tirgeo process: {bag}: ")
    assert "messages were read" in message_text.err
    summary = json.loads(message_text.out)
    assert summary["error"] in message_text.err
    assert BagReader(out).damage is None
    assert summary["written"][CAMERA_POSE] > 50


def test_unusable_inputs_and_options_are_refused(cut, options, tmp_path):
    out = tmp_path / "out.mcap"
    text = tmp_path / "text.mcap"
    text.write_text("no bag at all")
    broken = tmp_path / "map.geojson"
    broken.write_text("{")
    unknown = tmp_path / "params.yaml"
    unknown.write_text("/**/ekf_node:\n  ros__parameters:\n    methud: ekf\n")
    cases = [
        (BagError, r"absent\.mcap: ", tmp_path / "absent.mcap", {}),
        (BagError, r"text\.mcap: not a ROS 2 bag", text, {}),
        (MapError, r"map\.geojson: ", cut, {"map": broken}),
        (ConfigError, r"params\.yaml: unknown parameter methud", cut, {"params": unknown}),
        (ConfigError, r"ground_height_m: 90000 m is outside", cut, {"ground_height": 9e4}),
        (ConfigError, r"method: 'magic' is not one of raw, rtk", cut, {"method": "magic"}),
        (ConfigError, r"video and stills need images", cut, {"images": False, "raw_images": True}),
        (VideoError, r"no such folder", cut, {"video": tmp_path / "absent" / "a.mp4"}),
        (BagError, r"cannot be written", cut, {"out": tmp_path / "absent" / "o.mcap"}),
    ]
    before = {entry: entry.read_bytes() for entry in tmp_path.iterdir()}
    for error, match, bag, changes in cases:
        arguments = {**options, **changes}
        with pytest.raises(error, match=match) as raised:
            process(bag, arguments.pop("out", out), **arguments)
        assert "\n" not in str(raised.value)
    assert {entry: entry.read_bytes() for entry in tmp_path.iterdir()} == before
