"""The six lines of ``tirgeo process``: what is right, and what is wrong first."""

from __future__ import annotations

import copy
import math

import pytest

from tirgeo_ros.tools.replay.process_summary import six_lines

NAMES = ["read", "state", "poses", "frames", "refused", "output"]
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
    "overlay": {"drawn": 256, "notices": 14, "predicted": 0},
    "notes": [],
    "video": None,
}


@pytest.fixture
def result(tmp_path):
    output = tmp_path / "out.mcap"
    output.write_bytes(bytes(26_400_000))
    return copy.deepcopy(RESULT) | {"output": str(output)}


def names(text):
    return [line[2:].split()[0] for line in text.splitlines()]


def wrong(text):
    return [line[2:].split()[0] for line in text.splitlines() if line.startswith("! ")]


def test_a_good_flight(result):
    assert six_lines(result).splitlines() == [
        "  read     30.0 s of flight.mcap in 0.73 s, 41.0x real time; 3270 messages",
        "  state    running at the end, by ekf_heading; in all running 29 s, aligning 1 s",
        "  poses    2851 of the body, 1426 of the camera, heading to 0.10 deg",
        "  frames   256 of 270 with a trusted pose, 14 with a notice why not",
        "  refused  nothing",
        f"  output   {result['output']}, 26.4 MB",
    ]


@pytest.mark.parametrize(
    ("change", "name", "words"),
    [
        ({"state": "lost", "reason": "no rtk/fix"}, "state", "lost at the end (no rtk/fix)"),
        ({"state": "dead_reckoning"}, "state", "dead_reckoning at the end"),
        (
            {"written": {}, "heading_sigma_deg": math.nan},
            "poses",
            "0 of the body, 0 of the camera",
        ),
        ({"written": {"/tirgeo/odometry": 9}}, "poses", "9 of the body, 0 of the camera"),
        ({"overlay": {"drawn": 3, "notices": 267}}, "frames", "3 of 270 with a trusted pose"),
        ({"overlay": {"drawn": 256, "notices": 10}}, "frames", "10 with a notice why not, 4 lost"),
        (
            {"verdicts": {"rtk_heading used": 90, "rtk_heading too_old": 10}},
            "refused",
            "rtk_heading 10 of 100 too old",
        ),
        ({"undecodable": {"/imu/data": 2}}, "refused", "/imu/data 2 unreadable"),
        (
            {"unreadable": {"/imu/data": 2}, "unreadable_because": {"/imu/data": "not finite"}},
            "refused",
            "/imu/data 2 unreadable (not finite)",
        ),
    ],
)
def test_what_is_wrong_stands_first_with_a_mark(result, change, name, words):
    text = six_lines(result | change)
    assert wrong(text) == [name]
    assert words in text.splitlines()[0]
    assert sorted(names(text)) == sorted(NAMES)


def test_the_output_names_the_video_and_the_notes(result):
    change = {"video": {"frames": 256, "rate_hz": 9.0003}, "notes": ["method ekf: no heading"]}
    last = six_lines(result | change).splitlines()[-1]
    assert last.endswith("26.4 MB, and a video of 256 frames at 9 Hz; method ekf: no heading")
    last = six_lines(result | {"notes": ["one", "two", "three"]}).splitlines()[-1]
    assert last.endswith("26.4 MB; one (and 2 more, with -v)")
