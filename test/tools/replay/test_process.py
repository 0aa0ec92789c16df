"""tirgeo process: what it reads and writes, that it is deterministic, and what bad input does."""

from __future__ import annotations

import dataclasses
import json
import math

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.types.errors import BagError, ConfigError, MapError, VideoError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.replay.pose_comparison import differences
from tirgeo_ros.tools.replay.process import process

CDR = Cdr()
CUT_S = 4.0  # alignment takes one second of it
IMAGES = "/thermal/image_raw/compressed"
CAMERA_POSE = "/tirgeo/camera_pose"
#: Whether a filter falls back on ordinary GPS is the estimator's affair.
FIXES = "/rtk/fix( or /gps/fix)?"
ALL_RTK = "/rtk/fix, /rtk/vel, /rtk/heading"


def rewrite(source, target, edit):
    """Copy a bag; ``edit`` gives topic and data of each message, or None to leave it out."""
    with BagWriter(target) as writer:
        for item in BagReader(source).messages():
            kept = edit(item)
            if kept is not None:
                topic, data = kept
                writer.write(topic, item.typename, data, item.log_time_ns)
    return target


def same(item):
    return item.topic, item.data


def messages_of(path, *topics):
    """(log time, message) of some topics."""
    for item in BagReader(path).messages(topics or None):
        yield item.log_time_ns, CDR.deserialize(item.data, item.typename)


@pytest.fixture(scope="module")
def cut(sample, tmp_path_factory):
    """The sample's first seconds, with pictures."""
    start_ns = BagReader(sample / "flight.mcap").span_ns[0]
    path = tmp_path_factory.mktemp("cut") / "flight.mcap"
    return rewrite(
        sample / "flight.mcap",
        path,
        lambda item: same(item) if item.log_time_ns < start_ns + CUT_S * 1e9 else None,
    )


@pytest.fixture(scope="module")
def options(sample):
    return {"params": sample / "params.yaml", "map": sample / "map.geojson"}


@pytest.fixture(scope="module")
def whole(cut, options, tmp_path_factory):
    """The cut with everything that can be asked for: folder and summary."""
    folder = tmp_path_factory.mktemp("whole")
    summary = process(
        cut, folder / "out.mcap", raw_images=True, video=folder / "out.mp4", **options
    )
    return folder, summary


@pytest.fixture(scope="module")
def poses_only(cut, options, tmp_path_factory):
    """The cut without pictures."""
    path = tmp_path_factory.mktemp("poses") / "out.mcap"
    return path, process(cut, path, images=False, **options)


def test_every_output_topic_with_its_type(whole):
    folder, summary = whole
    topics = BagReader(folder / "out.mcap").topics()
    names = (
        "odometry",
        "fix",
        "origin",
        "camera_pose",
        "overlay/image",
        "overlay/image/compressed",
    )
    expected = {f"/tirgeo/{name}": TOPIC_TYPES[f"tirgeo/{name}"] for name in names}
    assert topics == expected | {"/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"}
    assert set(summary["written"]) == set(topics)
    assert summary["error"] is None


def test_same_input_same_bytes(whole, cut, options, tmp_path):
    process(cut, tmp_path / "again.mcap", raw_images=True, **options)
    assert (tmp_path / "again.mcap").read_bytes() == (whole[0] / "out.mcap").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 7])
def test_size_of_the_blocks_changes_nothing(whole, cut, options, tmp_path, monkeypatch, size):
    monkeypatch.setattr("tirgeo_ros.tools.replay.process._BLOCK", size)
    monkeypatch.setattr("tirgeo_ros.tools.replay.message_pipeline._BLOCK", size)
    process(cut, tmp_path / "out.mcap", raw_images=True, **options)
    assert (tmp_path / "out.mcap").read_bytes() == (whole[0] / "out.mcap").read_bytes()


def test_an_output_that_cannot_be_written_stops_the_run(cut, options, tmp_path, monkeypatch):
    def write(_writer, topic, *_rest):
        if topic == "/tirgeo/odometry":
            raise BagError("out.mcap: cannot be written: no space left")

    monkeypatch.setattr(BagWriter, "write", write)
    with pytest.raises(BagError, match=r"cannot be written: no space left"):
        process(cut, tmp_path / "out.mcap", images=False, **options)
    assert list(tmp_path.iterdir()) == []


def test_poses_are_the_same_with_and_without_pictures(whole, poses_only):
    both = [
        [item.data for item in BagReader(path).messages(["/tirgeo/odometry", CAMERA_POSE])]
        for path in (whole[0] / "out.mcap", poses_only[0])
    ]
    assert both[0] == both[1]
    assert len(both[0]) > 300


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
    moved = rewrite(
        cut,
        tmp_path / "uav1.mcap",
        lambda item: (f"/uav1{item.topic}", item.data) if item.topic != IMAGES else None,
    )
    process(moved, tmp_path / "out.mcap", images=False, namespace="/uav1", **options)
    topics = set(BagReader(tmp_path / "out.mcap").topics())
    assert "/diagnostics" in topics
    assert {t for t in topics if t != "/diagnostics"} == {
        f"/uav1/tirgeo/{name}" for name in ("odometry", "fix", "origin", "camera_pose")
    }
    both = [
        [item.data for item in BagReader(path).messages([topic])]
        for path, topic in (
            (tmp_path / "out.mcap", f"/uav1{CAMERA_POSE}"),
            (poses_only[0], CAMERA_POSE),
        )
    ]
    assert both[0] == both[1]
    with pytest.raises(BagError, match=r"needed topic absent: /imu/data.*is there a --namespace"):
        process(moved, tmp_path / "none.mcap", images=False, **options)


@pytest.mark.parametrize(
    ("method", "missing", "named"),
    [
        ("ekf_heading", ["/imu/data"], "/imu/data"),
        ("ekf_heading", ["/imu/data", "/gps/fix", "/rtk/fix"], f"/imu/data, {FIXES}"),
        ("ekf", ["/rtk/fix", "/gps/fix"], FIXES),
        ("rtk", ["/rtk/fix"], "/rtk/fix"),
        ("raw", ["/gps/fix"], "/gps/fix"),
        (
            "ekf",
            ["/gimbal/joint_states", "/gimbal/attitude"],
            "/gimbal/joint_states or /gimbal/attitude",
        ),
        ("ekf", [IMAGES], "/thermal/image_raw or /thermal/image_raw/compressed"),
        ("ekf", ["/thermal/camera_info"], "/thermal/camera_info"),
    ],
)
def test_absent_topics_are_named_and_nothing_is_written(
    cut, options, tmp_path, method, missing, named
):
    bag = rewrite(
        cut, tmp_path / "in.mcap", lambda item: None if item.topic in missing else same(item)
    )
    with pytest.raises(BagError, match=rf"in\.mcap: needed topic absent: {named}(;|$)"):
        process(bag, tmp_path / "out.mcap", method=method, **options)
    assert [entry.name for entry in tmp_path.iterdir()] == ["in.mcap"]


def without(source, target, *topics):
    return rewrite(source, target, lambda item: None if item.topic in topics else same(item))


@pytest.mark.parametrize(
    ("absent", "missed"),
    [
        (("/rtk/heading",), None),
        (("/rtk/vel",), "/rtk/vel"),
        (("/rtk/vel", "/rtk/heading"), "/rtk/vel"),
    ],
)
def test_aids_that_the_method_misses_are_a_warning(cut, sample, tmp_path, absent, missed):
    """The filter aligns by what there is, once it has waited for better.

    A method that was fitted to the bag misses nothing of the default's: a note says so.
    """
    bag = without(cut, tmp_path / "in.mcap", *absent)
    soon = tmp_path / "soon.yaml"
    soon.write_text("/**:\n  ros__parameters: {alignment: {wait_s: 0.5}}\n")
    params = [sample / "params.yaml", soon]
    summary = process(bag, tmp_path / "out.mcap", params=params, images=False)
    assert summary["warning"] == (missed and f"{bag} has no {missed}: done without")
    assert summary["error"] is None
    assert summary["written"][CAMERA_POSE] > 20


@pytest.mark.parametrize(
    ("absent", "method", "note"),
    [
        ((), "ekf_heading", None),
        (("/rtk/heading",), "ekf", "method ekf: the bag has no /rtk/heading"),
        (
            ("/rtk/fix", "/rtk/vel", "/rtk/heading"),
            "ekf",
            f"method ekf: the bag has no {ALL_RTK}; it flies on ordinary GPS",
        ),
    ],
)
def test_the_method_is_that_of_what_the_bag_holds(cut, sample, tmp_path, absent, method, note):
    bag = without(cut, tmp_path / "in.mcap", *absent)
    params = [sample / "params.yaml", tmp_path / "soon.yaml"]
    params[1].write_text("/**/ekf_node:\n  ros__parameters: {alignment: {wait_s: 0.5}}\n")
    summary = process(bag, tmp_path / "out.mcap", params=params, images=False)
    assert summary["method"] == method
    assert summary["notes"] == ([note] if note else [])


@pytest.mark.parametrize("by_file", [False, True])
def test_a_method_that_somebody_says_is_kept(cut, sample, tmp_path, by_file):
    """Said by its option or in the last of the files, also where it is the default's name."""
    bag = without(cut, tmp_path / "in.mcap", "/rtk/heading")
    params = [sample / "params.yaml", tmp_path / "method.yaml"]
    said = "/**/ekf_node:\n  ros__parameters: {alignment: {wait_s: 0.5}"
    params[1].write_text(f"{said}, method: ekf_heading}}\n" if by_file else f"{said}}}\n")
    method = None if by_file else "ekf_heading"
    out = tmp_path / "out.mcap"
    summary = process(bag, out, params=params, method=method, images=False)
    assert (summary["method"], summary["notes"]) == ("ekf_heading", [])


def test_poses_of_the_body_need_no_gimbal(cut, options, tmp_path):
    """The odometry is the same to the last bit; camera poses there are none."""
    bag = without(cut, tmp_path / "in.mcap", "/gimbal/joint_states", "/gimbal/attitude")
    summary = process(bag, tmp_path / "out.mcap", images=False, **options)
    assert summary["notes"] == ["the bag has no gimbal topic: no camera poses"]
    assert summary["error"] is None
    assert CAMERA_POSE not in summary["written"]
    process(cut, tmp_path / "whole.mcap", images=False, **options)
    both = [
        [item.data for item in BagReader(tmp_path / name).messages(["/tirgeo/odometry"])]
        for name in ("out.mcap", "whole.mcap")
    ]
    assert len(both[0]) > 200
    assert both[0] == both[1]


def unstamped(item, topics):
    message = CDR.deserialize(item.data, item.typename)
    message.header.stamp.sec = message.header.stamp.nanosec = 0
    return item.topic, CDR.serialize(message, item.typename) if item.topic in topics else item.data


def test_samples_without_a_stamp_are_of_their_arrival_less_the_delay(cut, sample, tmp_path):
    """The sample's RTK arrives 80 ms after the measurement: the same poses, bit for bit."""
    topics = ("/rtk/fix", "/rtk/vel", "/rtk/heading", "/gimbal/joint_states")
    plain = without(cut, tmp_path / "plain.mcap", IMAGES)
    bag = rewrite(plain, tmp_path / "in.mcap", lambda item: unstamped(item, topics))
    delay = tmp_path / "delay.yaml"
    delay.write_text("/**:\n  ros__parameters: {rtk: {delay_s: 0.08}}\n")
    params = [sample / "params.yaml", delay]
    summary = process(bag, tmp_path / "out.mcap", params=params, images=False)
    number = {topic: summary["read"][topic] for topic in topics}
    assert summary["stamped_at_arrival"] == {t.lstrip("/"): n for t, n in number.items()}
    process(cut, tmp_path / "stamped.mcap", params=sample / "params.yaml", images=False)
    both = [
        [item.data for item in BagReader(tmp_path / name).messages([f"/tirgeo/{topic}"])]
        for name in ("out.mcap", "stamped.mcap")
        for topic in ("odometry", "camera_pose")
    ]
    assert len(both[0]) > 200
    assert both[:2] == both[2:]
    told = [m for _, m in messages_of(tmp_path / "out.mcap", "/diagnostics")][-1].status[0]
    values = {pair.key: pair.value for pair in told.values}
    assert values["stamped_at_arrival.rtk/fix"] == str(number["/rtk/fix"])


def test_frames_without_a_stamp_are_of_their_arrival(cut, options, whole, tmp_path):
    """Of stamp 0 one of all was a frame; now each is drawn that is drawn with a stamp."""
    bag = rewrite(cut, tmp_path / "in.mcap", lambda item: unstamped(item, (IMAGES,)))
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

    bag = rewrite(cut, tmp_path / "in.mcap", edit)
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

    bag = rewrite(cut, tmp_path / "in.mcap", edit)
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
    said = capsys.readouterr()
    assert code == 1
    assert said.err.count("\n") == 1
    assert said.err.startswith(f"tirgeo process: {bag}: ")
    assert "messages were read" in said.err
    summary = json.loads(said.out)
    assert summary["error"] in said.err
    assert BagReader(out).damage is None
    assert summary["written"][CAMERA_POSE] > 50


def test_no_bag_no_map_no_sense(cut, options, tmp_path):
    out = tmp_path / "out.mcap"
    text = tmp_path / "text.mcap"
    text.write_text("no bag at all")
    broken = tmp_path / "map.geojson"
    broken.write_text("{")
    unknown = tmp_path / "params.yaml"
    unknown.write_text("/**/ekf_node:\n  ros__parameters:\n    methud: ekf\n")
    cases = [
        (BagError, r"absent\.mcap: ", tmp_path / "absent.mcap", {}),
        (BagError, r"text\.mcap: not an MCAP file", text, {}),
        (MapError, r"map\.geojson: ", cut, {"map": broken}),
        (ConfigError, r"params\.yaml: unknown parameter methud", cut, {"params": unknown}),
        (ConfigError, r"ground_height_m: 90000 m is outside", cut, {"ground_height": 9e4}),
        (ConfigError, r"method: 'magic' is not one of raw, rtk", cut, {"method": "magic"}),
        (ConfigError, r"without a map or without images", cut, {"map": None, "raw_images": True}),
        (VideoError, r"no such folder", cut, {"video": tmp_path / "absent" / "a.mp4"}),
        (BagError, r"flight\.mcap: would take the place of the input", cut, {"out": cut}),
        (BagError, r"cannot be written", cut, {"out": tmp_path / "absent" / "o.mcap"}),
    ]
    before = {entry: entry.read_bytes() for entry in tmp_path.iterdir()}
    for error, match, bag, changes in cases:
        arguments = {**options, **changes}
        with pytest.raises(error, match=match) as raised:
            process(bag, arguments.pop("out", out), **arguments)
        assert "\n" not in str(raised.value)
    assert {entry: entry.read_bytes() for entry in tmp_path.iterdir()} == before


def test_paper_composition_from_a_parameter_file(cut, sample, tmp_path):
    """Joint angles are there, but are not asked for."""
    chosen = tmp_path / "chosen.yaml"
    chosen.write_text("/**/gimbal_node:\n  ros__parameters: {composition: paper}\n")
    params = [sample / "params.yaml", chosen]
    summary = process(cut, tmp_path / "out.mcap", params=params, images=False)
    assert summary["composition"] == "paper"
    assert "/gimbal/joint_states" not in summary["read"]
    assert summary["written"][CAMERA_POSE] > 100
