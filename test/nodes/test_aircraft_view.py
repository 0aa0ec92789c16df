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
"""Messages of an aircraft become its state on the page, with one verdict."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

import numpy as np
from message_samples import (
    BODY,
    CAMERA_POSE,
    FINDING,
    LOCATED,
    PLANE,
    SOLUTION,
    STATE,
    STATUS,
    TARGET,
)
from overlays import PLANE as FIELD, SQUARE_N, pose_at
from visualization_msgs.msg import Marker

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.camera.projection_covariance import ellipse_95
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.ground.ground_point import enu_of
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.verdicts import FilterState, Outcome
from tirgeo_ros.io.messages import (
    TOPIC_TYPES,
    Messages,
    NodeState,
    TopicState,
    camera_pose,
    finding_row,
)
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.io.messages.json_codec import findings_text, state_text
from tirgeo_ros.nodes import aircraft_view as view
from tirgeo_ros.nodes.aircraft_topics import SILENT_S, PoseTape, Reports, level_of
from tirgeo_ros.nodes.aircraft_view import STREAMS, Judge, PicturePairs, target_markers

CDR = Cdr()
MESSAGES = Messages()
POSE_TYPE = TOPIC_TYPES["tirgeo/camera_pose"]
MS = 1_000_000
START_NS = 10**18
SIGHT = Sight(XT2, pose_at(0), FIELD, 25.0)


def test_the_estimators_state_is_passed_on_until_it_is_silent():
    reports = Reports()
    assert view.navigation_fields(reports, 0.0)["navigation"]["state"] == "waiting"
    state = MESSAGES.text(state_text(NodeState("/uav1/ekf_node", 0, 1, navigation=STATUS)))
    reports.take_state(100.0, state)
    fields = view.navigation_fields(reports, 101.0)
    assert fields["navigation"] == {"state": "aligning", "reason": "too slow"}
    assert fields["rtk"] == "float"
    assert fields["heading_sigma_deg"] == pytest.approx(math.degrees(0.0123))
    silent = view.navigation_fields(reports, 100.1 + SILENT_S)
    assert silent["navigation"] == {"state": "lost", "reason": "ekf_node does not report"}
    assert silent["rtk"] is None


def test_the_videos_delay_is_known_from_the_first_report_on_and_the_notice_while_it_is_said():
    """Earlier, a recording's first and last pictures had no place, for want of a diagnostic."""
    reports = Reports()
    assert reports.picture() is None
    reports.take_state(100.0, MESSAGES.text(state_text(STATE)))
    assert reports.picture().video_latency_s == 0.05
    assert reports.picture().confidence.latency_sigma_s == 0.01
    assert reports.picture(101.0).notice == "NO MAP: no pose"
    assert reports.picture(100.1 + SILENT_S) is None
    assert reports.picture() is not None
    age_s = reports.input_age_s("overlay_node", "tirgeo/camera_pose", 101.0)
    assert age_s == pytest.approx(1.02)
    assert reports.input_age_s("overlay_node", "imu/data", 101.0) is None


def test_findings_reach_the_page_part_by_part():
    """A remedy with a colon stays whole: earlier, the text was parsed and cut there."""
    message, reports = MESSAGES.text(findings_text("/uav1/ekf_node", 5, [FINDING])), Reports()
    assert reports.findings(100.0) is None
    reports.take_findings(100.0, message)
    assert reports.findings(100.0) == [FINDING]
    assert finding_row(FINDING)["remedy"] == "ENU: z up; psdk: its key"
    assert reports.findings(100.1 + SILENT_S) is None  # nobody knows while nobody says
    message.data = message.data.replace("findings/1", "findings/2")
    with pytest.raises(MessageError, match="its schema is not tirgeo/findings/1"):
        reports.take_findings(100.0, message)


def test_checks_are_silent_if_only_the_page_and_a_player_report():
    reports = Reports("/uav1/viewer_node")
    for node in ("viewer_node", "bag_player"):
        reports.take_findings(100.0, MESSAGES.text(findings_text(f"/uav1/{node}", 5, [FINDING])))
    assert reports.findings(100.0) is None
    reports.take_findings(100.0, MESSAGES.text(findings_text("/uav1/ekf_node", 5, [])))
    assert reports.findings(100.0) == [FINDING]  # the player's


def test_the_position_is_that_of_the_odometry():
    odometry = MESSAGES.odometry(SOLUTION, BODY)
    level_n = BODY.position_n + np.array([[5, 5, 12.0], [9, 5, 12.0], [5, 9, 12.0]])
    fields = view.position_fields(odometry, PLANE, level_n)
    place = np.radians(fields["position"][:2])
    off_n = PLANE.ned_from_geodetic(*place, fields["position"][2]) - BODY.position_n
    np.testing.assert_allclose(off_n, 0.0, atol=1e-2)
    assert fields["above_ground_m"] == pytest.approx(12.0)
    north, east, _ = SOLUTION.velocity_n
    assert fields["speed_m_s"] == pytest.approx(math.hypot(north, east))
    worst = np.linalg.eigvalsh(BODY.covariance[:2, :2])[-1]
    assert fields["position_sigma_m"] == pytest.approx(math.sqrt(worst))
    nowhere = view.position_fields(odometry, PLANE, np.empty((0, 3)))
    assert math.isnan(nowhere["above_ground_m"])  # which the server sends as null


A, B, C, D, E = ([48.0 + 0.01 * k, 16.0] for k in range(5))


@pytest.mark.parametrize(
    ("sent", "track", "first"),
    [
        ([], [A, B, C], 0),
        ([A, B, C], [A, B, C], 3),
        ([A, B, C], [A, B, D, E], 2),  # the last one is where it was just now
        ([A, B, D, E], [A, D], 1),  # thinned
        ([A, D], [], 0),
    ],
)
def test_only_new_points_of_the_track_are_sent(sent, track, first):
    assert view.track_fields(sent, track) == {"track": track[first:], "track_from": first}


@pytest.fixture
def tape():
    """Poses each 20 ms for a second; how many of them were decoded."""
    decoded = []

    def decode(data):
        decoded.append(data)
        return camera_pose(CDR.deserialize(data, POSE_TYPE))

    made = PoseTape(decode)
    for k in range(50):
        made.add(posed(START_NS + 20 * k * MS))
    return made, decoded


def posed(stamp_ns):
    pose = dataclasses.replace(CAMERA_POSE, stamp_ns=stamp_ns)
    return CDR.serialize(MESSAGES.camera_pose(pose), POSE_TYPE)


def test_poses_around_an_instant_alone_are_decoded(tape):
    made, decoded = tape
    poses = made.around(START_NS + 410 * MS)
    assert poses.at(START_NS + 410 * MS).stamp_ns == START_NS + 410 * MS
    assert len(decoded) == 2
    poses = made.around(START_NS + 410 * MS, before_s=0.1)
    assert poses.at(START_NS + 310 * MS).stamp_ns == START_NS + 310 * MS
    assert made.around(START_NS + 1000 * MS).at(START_NS + 1000 * MS) is Miss.TOO_NEW
    assert made.around(START_NS - MS).at(START_NS - MS) is Miss.TOO_OLD


def test_a_clock_that_goes_back_begins_anew(tape):
    made, _ = tape
    made.add(posed(10**17))
    assert made.around(10**17).at(10**17).stamp_ns == 10**17
    assert made.around(START_NS).at(START_NS) is Miss.TOO_NEW
    with pytest.raises(MessageError, match="too few for a header"):
        made.add(b"\0\1")


def test_a_place_is_where_the_camera_sees_it():
    corner_n = SQUARE_N[0]
    observed = (corner_n - SIGHT.pose.position_n)[None] @ matrix_from_quat(SIGHT.pose.q_nc)
    np.testing.assert_allclose(
        view.pixel_of(SIGHT, corner_n), XT2.project(observed)[0][0], atol=0.05
    )
    assert view.pixel_of(SIGHT, corner_n * -1) is None  # behind the camera
    assert view.pixel_of(SIGHT, corner_n * [1, 9, 1]) is None  # beside the picture


def test_the_ground_has_a_height_where_it_is_level():
    assert level_of(SQUARE_N, FIELD) == pytest.approx(25.0, abs=0.01)
    slope_n = SQUARE_N.copy()
    slope_n[2:, 2] = 3.0
    assert math.isnan(level_of(slope_n, FIELD))
    assert math.isnan(level_of(np.empty((0, 3)), FIELD))


TICK_S = 0.2
ODOMETRY, POSE, PICTURE, _ = (stream.topic for stream in STREAMS)
NODES = {
    "ekf_node": ("imu/data",),
    "gimbal_node": ("gimbal/joint_states", "gimbal/attitude"),
    "overlay_node": ("thermal/image_raw", "thermal/camera_info"),
}
#: Each topic's node; the sensors' have none here.
MADE_BY = {topic: "" for topics in NODES.values() for topic in topics}
MADE_BY |= {stream.topic: stream.node for stream in STREAMS}
NOTE = Severity.NOTE
WENT_BACK = {"state": FilterState.ALIGNING, "began_again": Outcome.TIME_JUMP}
RUNNING = replace(STATUS, state=FilterState.RUNNING, reason="", began_again=None)


class Graph:
    """What reaches the page of a graph, second by second; ``stopped`` holds what is silent."""

    def __init__(self) -> None:
        self.now_s, self.status, self.worst, self.no_map = 1000.0, RUNNING, NOTE, ""
        self.stopped: set[str] = set()
        self.last_s: dict[str, float] = {}
        self.reports = Reports()
        self.judge = Judge(self.reports, self.last_s.get)

    def runs(self, seconds: float):
        """Every verdict until then, with the time since the start of the call."""
        start_s = self.now_s
        while self.now_s < start_s + seconds - 1e-6:
            self.now_s += TICK_S
            yield self.now_s - start_s, self.look()

    def look(self):
        for topic, node in MADE_BY.items():
            if self.stopped.isdisjoint((topic, node)):
                self.last_s[topic] = self.now_s
        for node in NODES.keys() - self.stopped:
            self.report(node)
        return self.judge.look(self.now_s, self.worst, self.no_map)

    def report(self, node):
        if int(self.now_s / TICK_S) % 5 != len(node) % 5:  # once a second, each at its own time
            return
        heard_s = {topic: self.last_s[topic] for topic in NODES[node] if topic in self.last_s}
        topics = {topic: TopicState(10.0, self.now_s - s) for topic, s in heard_s.items()}
        status = self.status if node == "ekf_node" else None
        state = NodeState(f"/{node}", 0, 1, topics, navigation=status)
        self.reports.take_state(self.now_s, MESSAGES.text(state_text(state)))


@pytest.fixture
def flight():
    graph = Graph()
    assert [*graph.runs(5)][-1][1].word == "GO"
    return graph


@pytest.mark.parametrize(
    ("stopped", "text", "more"),
    [
        (["ekf_node", POSE, PICTURE], "The filter does not answer", "ekf_node silent for"),
        (["gimbal_node"], "The gimbal program does not answer", "gimbal_node silent for"),
        (["overlay_node"], "The overlay program does not answer", "overlay_node silent for"),
        (["imu/data", ODOMETRY, POSE], "The IMU is silent for 7 s", "imu/data silent for 7 s"),
        (
            ["gimbal/joint_states", POSE],
            "The gimbal is silent",
            "gimbal/joint_states silent for 7",
        ),
        (["thermal/image_raw", PICTURE], "The camera is silent", "thermal/image_raw silent for 7"),
        ([*NODES, *NODES["ekf_node"]], "The filter does not answer", "ekf_node silent for"),
    ],
)
def test_silence_ends_go_within_a_second_and_its_cause_is_named(flight, stopped, text, more):
    flight.stopped |= {*stopped}
    verdicts = [*flight.runs(7)]
    # A look each 0.2 s, of which the last before the limit may still say GO.
    assert all(verdict.word != "GO" for since_s, verdict in verdicts if since_s > 1.2 + 1e-6)
    assert verdicts[-1][1].text.startswith(text)
    assert verdicts[-1][1].more.startswith(more)
    alarms = {verdict.kind for _, verdict in verdicts if verdict.alarm}
    assert len(alarms) == 1  # one alarm, however the words change
    flight.stopped.clear()
    back_s = next(since_s for since_s, verdict in flight.runs(9) if verdict.word == "GO")
    assert 1.9 < back_s < 3.5  # not at the first sample: no flapping


def test_of_streams_that_end_together_the_first_is_the_cause(flight):
    flight.stopped |= {PICTURE}  # the last picture came 0.4 s before the last of the others
    assert {verdict.word for _, verdict in flight.runs(0.4)} == {"GO"}
    flight.stopped |= {"imu/data", ODOMETRY, POSE, "thermal/image_raw"}
    kinds = [verdict.kind for _, verdict in flight.runs(5) if verdict.word != "GO"]
    assert {*kinds} == {"position"}


def test_a_halt_of_this_node_is_no_silence_of_others(flight):
    for _ in range(10):
        flight.now_s += 2.0  # it did not run: the first look is before what waits is taken
        assert flight.judge.look(flight.now_s, NOTE, "").word == "GO"
        assert {verdict.word for _, verdict in flight.runs(2)} == {"GO"}


def test_there_is_no_go_before_the_first_picture():
    graph = Graph()
    graph.stopped |= {PICTURE, "thermal/image_raw"}
    verdicts = [verdict for _, verdict in graph.runs(12)]
    assert {verdict.word for verdict in verdicts} == {"NO DATA"}
    assert verdicts[-1].text == "No picture"
    assert not any(verdict.alarm for verdict in verdicts)  # it has not begun


@pytest.mark.parametrize(
    ("status", "worst", "no_map", "word", "text"),
    [
        ({"state": FilterState.DEGRADED, "reason": "no rtk/fix"}, NOTE, "", "CAUTION", "Less"),
        ({"state": FilterState.LOST}, NOTE, "NO MAP: x", "LOST", "No position"),
        ({"state": FilterState.ALIGNING}, NOTE, "NO MAP: x", "WAIT", "No position yet"),
        (WENT_BACK, NOTE, "", "LOST", "No position, as the IMU's time went back"),
        ({}, Severity.CAUTION, "NO MAP: no pose", "NO GO", "NO MAP: no pose"),
        ({}, Severity.STOP, "NO MAP: x", "NO GO", ""),
        ({}, Severity.CAUTION, "", "CAUTION", ""),
        ({}, None, "", "NO DATA", "No check"),
    ],
)
def test_only_the_gravest_fault_is_shown(flight, status, worst, no_map, word, text):
    flight.status, flight.worst, flight.no_map = replace(RUNNING, **status), worst, no_map
    verdict = [*flight.runs(3)][-1][1]
    assert (verdict.word, verdict.text[: len(text)]) == (word, text)
    assert verdict.more == flight.status.reason or verdict.kind != "position"


def test_the_first_marker_deletes_all_others():
    assert [item.action for item in target_markers("map", PLANE, []).markers] == [Marker.DELETEALL]
    delete, shape, label = target_markers("uav1/map", PLANE, [TARGET]).markers
    assert (delete.action, shape.action, label.text) == (3, Marker.ADD, "1 fire: barn")
    assert {item.header.frame_id for item in (delete, shape, label)} == {"uav1/map"}
    place = TARGET.place
    north, east, down = PLANE.ned_from_geodetic(
        place.latitude_rad, place.longitude_rad, place.height_m
    )
    point = shape.pose.position
    np.testing.assert_allclose([point.x, point.y, point.z], [east, north, -down], rtol=1e-12)
    assert label.pose.position.z == pytest.approx(point.z + 1.0)


def test_the_marker_is_the_95_percent_ellipsoid():
    """A viewer in ``map`` sees its greatest breadth where the covariance has its own."""
    level = dataclasses.replace(LOCATED, covariance_enu=enu_of(np.diag([4.0, 1.0, 0.01])))
    target = dataclasses.replace(TARGET, clicks=(level,), name="x" * 1000)
    _, shape, label = target_markers("map", PLANE, [target]).markers
    semi_axes, _ = ellipse_95(np.diag([4.0, 1.0]))
    breadths = sorted([shape.scale.x, shape.scale.y, shape.scale.z])
    np.testing.assert_allclose(breadths[:0:-1], 2 * semi_axes[0], rtol=1e-12)
    assert len(label.text) == 60


def test_a_picture_has_the_shapes_of_its_own_stamp_whatever_is_lost_or_late():
    """10,000 frames, of which some halves are lost, and the others anyhow mixed."""
    rng, shown = np.random.default_rng(4), []
    pairs = PicturePairs(lambda *pair: shown.append(pair))
    halves = [(k, take) for k in range(10_000) for take in (pairs.take_shapes, pairs.take_picture)]
    late = np.argsort([k + rng.exponential(1.0) for k, _ in halves])
    for at in late[rng.random(len(halves)) > 0.1].tolist():
        stamp, take = halves[at]
        take(stamp, str(stamp).encode())
    assert len(shown) > 7000
    assert all(jpeg == shapes == str(stamp).encode() for stamp, jpeg, shapes in shown)
    assert len({stamp for stamp, *_ in shown}) == len(shown)
