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
"""Twelve stills without an IMU, through every verb: exact poses, and no false alarm."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from process_bags import CAMERA_POSE, messages_of
from stills import GROUND_M, strip, write_folder, write_ground

from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M
from tirgeo_ros.core.types.measurements import CameraAttitudeSample
from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.logs.stills import read_stills
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, camera_pose, sensed
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.graph.demo import demo_setup
from tirgeo_ros.tools.graph.node_graph import _nodes
from tirgeo_ros.tools.graph.whole_graph import WholeGraph
from tirgeo_ros.tools.replay.node_configs import values_without_rates

GIVEN = {"method": "rtk", "video_latency_s": 0.0}
GROUND = ["--ground-height", str(GROUND_M)]


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """The folder of the flight, and its stills."""
    folder, stills = tmp_path_factory.mktemp("stills"), strip()
    write_folder(folder / "DCIM", stills)
    write_ground(folder, stills)
    return folder, stills


def run(capsys, verb, *words):
    """The exit code and the result of a verb."""
    code = main([verb, *map(str, words), "--json"])
    out = capsys.readouterr().out
    return code, json.loads(out)


def assert_poses_are_true(path, stills):
    """Each pose has a still's stamp, place and attitude, and a covariance."""
    poses = [camera_pose(message) for _, message in messages_of(path, CAMERA_POSE)]
    assert [pose.stamp_ns for pose in poses] == [still.stamp_ns for still in stills]
    origin = np.array(stills[0].place_n)
    for still, pose in zip(stills, poses, strict=True):
        away_m = math.dist(still.place_n, origin)
        # axes of two tangent planes differ by the distance over the earth's radius; the heading
        # by as much times the tangent of the latitude
        turned = 2 * away_m / (SEMI_MAJOR_AXIS_M - 50e3)
        np.testing.assert_allclose(
            pose.position_n, still.place_n - origin, atol=1e-6 + away_m * turned
        )
        cosine = (np.trace(matrix_from_quat(pose.q_nc).T @ still.rotation_nc) - 1) / 2
        assert math.acos(min(cosine, 1.0)) < 1e-6 + turned
        assert 0.3 < math.degrees(math.sqrt(pose.covariance[5, 5])) < 10
        assert np.linalg.eigvalsh(pose.covariance)[0] > 0


def test_process_draws_the_map_on_each_still(flight, tmp_path, capsys):
    folder, stills = flight
    given = ["--map", folder / "map.geojson", *GROUND]
    out = tmp_path / "o.mcap"
    code, summary = run(capsys, "process", folder / "DCIM", "-o", out, *given)
    assert (code, summary["method"], summary["composition"]) == (0, "rtk", "paper")
    assert summary["warning"] is None
    assert (summary["overlay"]["drawn"], summary["overlay"]["notices"]) == (12, 0)
    assert_poses_are_true(out, stills)


def test_check_gives_true_cautions_alone(flight, capsys):
    folder, _ = flight
    given = ["--map", folder / "map.geojson", *GROUND]
    code, summary = run(capsys, "check", folder / "DCIM", *given)
    assert (code, summary["error"]) == (0, None)
    assert [each["check"] for each in summary["findings"]] == ["boresight_default"]
    note = "method rtk, video_latency_s 0.0: imu/data has attitudes alone, without rates"
    assert summary["notes"][-1] == note


def test_evaluate_and_export_run_on_it(flight, tmp_path, capsys):
    folder, _ = flight
    bag = folder / "DCIM"
    ground = ["--survey", folder / "survey.csv", "--observations", folder / "observations.csv"]
    code, summary = run(capsys, "evaluate", bag, *ground, "-o", tmp_path / "e")
    assert code == 0
    assert list(summary["methods"]) == ["rtk"]
    assert "use method raw or rtk" in json.dumps(summary)
    code, summary = run(capsys, "export", bag, "-o", tmp_path / "x", *GROUND)
    assert (code, summary["used"], summary["stills"]["files"]) == (0, 12, 12)
    back = read_stills(tmp_path / "x" / "stills", LogOptions()).samples
    attitudes = [sample.q_ng for sample in back if isinstance(sample, CameraAttitudeSample)]
    for still, q_ng in zip(flight[1], attitudes, strict=True):  # six with roll 180
        turn = quat_multiply(quat_conjugate(still.q_ng), q_ng)
        assert np.degrees(np.linalg.norm(rotvec_from_quat(turn))) < 0.1


def test_a_boresight_that_is_set_wrong_is_found(flight, tmp_path, capsys):
    """But for roll, which looking down is one with the gimbal's north."""
    folder, _ = flight
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("/**:\n  ros__parameters: {boresight_rpy_deg: [0.0, -0.8, 1.5]}\n")
    ground = ["--survey", folder / "survey.csv", "--observations", folder / "observations.csv"]
    more = ["--params", wrong, "--hold", "roll", "-o", tmp_path / "boresight.yaml"]
    code, result = run(capsys, "calibrate", "boresight", folder / "DCIM", *ground, *more)
    assert (code, result["without_pose"]) == (0, 0)
    assert set(result["parameters"]) == {"pitch", "yaw"}  # a still has no latency
    for row in result["parameters"].values():  # its pixels are exact, to the tangent planes' axes
        assert abs(row["found"]) < 0.005


@pytest.mark.parametrize("step_s", [0.1, 5.0])
def test_joints_on_ordinary_gps(tmp_path, capsys, step_s):
    """A level aircraft, as MISB may give it: joints alone, which are too rare to be steady."""
    stills = [
        still._replace(
            flight_deg=(still.gimbal_deg[0], 0.0, 0.0),
            gimbal_deg=(*still.gimbal_deg[:2], 0.0),
            joints_deg=(0.0, 0.0, still.gimbal_deg[1]),
        )
        for still in strip(step_s=step_s)
        if still.gimbal_deg[2] != 180
    ]
    bag, messages = tmp_path / "flight.mcap", Messages()
    with BagWriter(bag) as writer:
        for sample in (sample for still in stills for sample in still.samples(rtk=False)):
            topic, message = sensed(messages, sample)
            writer.write(f"/{topic}", TOPIC_TYPES[topic], message, sample.stamp_ns)
    code, summary = run(capsys, "process", bag, "-o", tmp_path / "o.mcap", "--no-images")
    assert (code, summary["method"], summary["composition"]) == (0, "raw", "encoders")
    assert_poses_are_true(tmp_path / "o.mcap", stills)


def test_the_live_graph_gets_the_same_parameters(flight, tmp_path):
    folder, _ = flight
    bag, other = tmp_path / "flight.mcap", tmp_path / "own.yaml"
    import_flight(folder / "DCIM", bag)
    other.write_text("/**:\n  ros__parameters: {video_latency_s: 0.2}\n")
    assert values_without_rates(bag, None) == GIVEN
    assert values_without_rates(bag, other) == {"method": "rtk"}
    whole = WholeGraph(bag).arguments
    assert not any("m600" in word for word in whole)  # the lever arms of another aircraft
    setup = demo_setup(bag, tmp_path, None, None, None, 1.0, serial=False)
    for words in (whole, _nodes(setup, tmp_path / "recording.mcap")["ekf_node"]):
        (section,) = json.loads(Path(words[words.index("--params-file") + 1]).read_text()).values()
        assert GIVEN.items() <= section["ros__parameters"].items()


def test_a_flight_with_an_imu_is_left_as_it_is(sample):
    assert values_without_rates(sample / "flight.mcap", None) == {}
