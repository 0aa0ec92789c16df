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
"""Topics that are absent or of another type; parameters; calibrations."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.checks.input_checks import (
    RecordedTopics,
    lens_findings,
    parameter_findings,
    recording_findings,
    size_fault,
    unreadable_findings,
)
from tirgeo_ros.core.types.finding import Severity


@pytest.mark.parametrize(
    ("given", "pictures", "checks"),
    [
        ((), True, ["no_parameters"]),
        (("ground_height_m", "camera", "method"), True, ["no_parameters"]),
        (("aircraft.rtk_antenna_m",), True, []),
        ((), False, []),
    ],
)
def test_no_parameters_matter_where_there_is_a_picture(given, pictures, checks):
    result = parameter_findings(given, (), "", pictures=pictures)
    assert [item.check for item in result] == checks
    for item in result:
        assert (item.severity, item.parameter) == (Severity.CAUTION, "--params")
        assert ("ground" in item.evidence) == ("ground_height_m" not in given)


def test_sections_of_another_aircraft():
    (finding,) = parameter_findings(("method",), ("/uav1/ekf_node",), "/uav2/", pictures=False)
    assert finding.check == "parameters_elsewhere"
    assert finding.evidence.endswith("(/uav2): /uav1/ekf_node")


def test_sizes():
    assert size_fault(XT2, 640, 512) == ""
    assert size_fault(XT2, 336, 256) == (
        "the calibration is of 640x512 pixels and the pictures have 336x256"
    )


BOSON = Camera(640, 512, 770.0, 770.0, 319.5, 255.5)
WIDE = Camera(1280, 1024, 700.0, 702.0, 640.0, 512.0, (-0.3, 0.1, 0.0, 0.0))


def checks_of(camera):
    return [finding.check for finding in lens_findings(camera, "thermal/camera_info")]


@pytest.mark.parametrize("camera", [XT2, BOSON, WIDE])
def test_good_lenses_say_nothing(camera):
    assert checks_of(camera) == []
    assert lens_findings(camera, "", (camera.width, camera.height)) == []


@pytest.mark.parametrize(
    ("changes", "check"),
    [
        ({"cx": 420.0}, "principal_point"),
        ({"cy": 150.0}, "principal_point"),
        ({"fx": 10000.0, "fy": 10000.0}, "field_of_view"),
        ({"fx": 150.0, "fy": 150.0}, "field_of_view"),
    ],
)
def test_impossible_lenses_are_reported(changes, check):
    assert checks_of(replace(BOSON, **changes)) == [check]


def test_a_matrix_of_pictures_twice_as_large_stops():
    twice = replace(BOSON, fx=2 * BOSON.fx, fy=2 * BOSON.fy, cx=2 * BOSON.cx, cy=2 * BOSON.cy)
    [result] = lens_findings(twice, "")
    assert (result.check, result.severity) == ("principal_point", Severity.STOP)


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


GIMBAL = ("gimbal/joint_states", "gimbal/attitude")
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
        (without(*GIMBAL), {}, "STOP gimbal/joint_states or gimbal/attitude"),
        (without("thermal/camera_info"), {}, "STOP thermal/camera_info"),
        (without("thermal/camera_info"), {"has_camera": True}, ""),
        (ALONE, {}, "NOTE thermal/image_raw"),  # a flight of the filter alone
        (without(*PICTURES), {}, "NOTE thermal/image_raw"),  # recorded without them
        (without(*PICTURES) | {"/cam": "CompressedImage"}, {}, "STOP thermal/image_raw"),
        (without(*PICTURES), {"wants_pictures": False}, ""),
        # poses of the body need no lens
        (without("thermal/camera_info"), {"wants_pictures": False}, "CAUTION thermal/camera_info"),
        (WHOLE | {"/rtk/fix": "PoseStamped"}, {}, "CAUTION rtk/fix"),  # there is gps/fix
        (without("gps/fix") | {"/rtk/fix": "PoseStamped"}, {}, "STOP rtk/fix"),
    ],
)
def test_what_is_absent_is_a_fault(topics, values, expected):
    result = recording_findings(RecordedTopics(topics, CONTRACT, **values))
    assert "; ".join(f"{item.severity.name} {item.parameter}" for item in result) == expected


def test_another_namespace_is_one_fault_that_says_which():
    (finding,) = recording_findings(RecordedTopics(OF_UAV1, CONTRACT))
    assert finding.parameter == "--namespace"
    assert finding.mend == "did you mean --namespace uav1?"
    (finding,) = recording_findings(RecordedTopics(WHOLE, CONTRACT, "uav1"))
    assert finding.mend == "did you mean --namespace /?"


def test_a_topic_under_another_name_is_reported_where_it_is():
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
    assert [item.severity.name for item in items] == ([severity] if severity else [])
    for item in items:
        assert (item.parameter, item.check) == (topic, "unreadable_thermal_camera_info")
        text = f"{refused} of {read + refused} messages of {topic} cannot be used: K is zero"
        assert item.evidence == text
