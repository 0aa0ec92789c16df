"""Topics absent, of another type or under another name, and what a flight gave nothing of."""

from __future__ import annotations

import math

import pytest

from tirgeo_ros.core.checks.recording_checks import (
    RecordedTopics,
    no_pose_findings,
    recording_findings,
    unreadable_findings,
)
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus

CONTRACT = {
    "imu/data": "Imu",
    "gps/fix": "NavSatFix",
    "rtk/fix": "NavSatFix",
    "gimbal/joint_states": "JointState",
    "gimbal/attitude": "QuaternionStamped",
    "thermal/image_raw": "Image",
    "thermal/image_raw/compressed": "CompressedImage",
    "thermal/camera_info": "CameraInfo",
}
WHOLE = {f"/{topic}": kind for topic, kind in CONTRACT.items()}


def without(*names):
    return {name: kind for name, kind in WHOLE.items() if name.strip("/") not in names}


PICTURES = ("thermal/image_raw", "thermal/image_raw/compressed")
ALONE = {"/imu/data": "Imu", "/rtk/fix": "NavSatFix"}
OF_UAV1 = {f"/uav1{name}": kind for name, kind in WHOLE.items()}


@pytest.mark.parametrize(
    ("topics", "values", "expected"),
    [
        (WHOLE, {}, ""),
        (OF_UAV1, {"namespace": "uav1"}, ""),
        # of two that serve the same, one is enough
        (without("gps/fix", "gimbal/attitude", "thermal/image_raw"), {}, ""),
        (without("imu/data"), {}, "STOP imu/data"),
        (without("rtk/fix", "gps/fix"), {}, "STOP rtk/fix or gps/fix"),
        (
            without("gimbal/joint_states", "gimbal/attitude"),
            {},
            "STOP gimbal/joint_states or gimbal/attitude",
        ),
        (without("thermal/camera_info"), {}, "STOP thermal/camera_info"),
        (without("thermal/camera_info"), {"has_camera": True}, ""),
        (ALONE, {}, "NOTE thermal/image_raw"),  # a flight of the filter alone
        (without(*PICTURES), {}, "CAUTION thermal/image_raw"),
        (without(*PICTURES), {"has_map": True}, "STOP thermal/image_raw"),
        (without(*PICTURES), {"wants_pictures": False}, ""),
        (WHOLE | {"/rtk/fix": "PoseStamped"}, {}, "CAUTION rtk/fix"),  # there is gps/fix
        (without("gps/fix") | {"/rtk/fix": "PoseStamped"}, {}, "STOP rtk/fix"),
    ],
)
def test_what_is_absent_is_a_fault(topics, values, expected):
    found = recording_findings(RecordedTopics(topics, CONTRACT, **values))
    assert "; ".join(f"{one.severity.name} {one.parameter}" for one in found) == expected


def test_another_namespace_is_one_fault_that_says_which():
    (finding,) = recording_findings(RecordedTopics(OF_UAV1, CONTRACT))
    assert finding.parameter == "--namespace"
    assert finding.mend == "did you mean --namespace uav1?"
    (finding,) = recording_findings(RecordedTopics(WHOLE, CONTRACT, "uav1"))
    assert finding.mend == "did you mean --namespace /?"


def test_a_topic_under_another_name_is_told_where_it_is():
    there = without("imu/data") | {"/mavros/imu/data": "Imu"}
    (finding,) = recording_findings(RecordedTopics(there, CONTRACT))
    assert finding.evidence == "the bag has no /imu/data (there is /mavros/imu/data)"


@pytest.mark.parametrize(
    ("read", "refused", "severity"),
    [(0, 1, "STOP"), (0, 500, "STOP"), (980, 20, "CAUTION"), (995, 5, None), (9, 1, None)],
)
def test_messages_that_cannot_be_used(read, refused, severity):
    topic = "thermal/camera_info"
    items = unreadable_findings({topic: read}, {topic: refused}, {topic: "K is zero"})
    assert [one.severity.name for one in items] == ([severity] if severity else [])
    for one in items:
        assert (one.parameter, one.check) == (topic, "unreadable_thermal_camera_info")
        said = f"{refused} of {read + refused} messages of {topic} cannot be used: K is zero"
        assert one.evidence == said


def test_no_pose_says_why():
    status = NavigationStatus(
        "ekf", FilterState.WAITING, "needs rtk/fix", FixStatus.NONE, math.nan, {}, {}
    )
    (finding,) = no_pose_findings(status)
    assert finding.evidence == "the filter made no pose: waiting: needs rtk/fix"
