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
"""overlay_node over DDS: pictures, clicks, missed frames, a map that changes meanwhile."""

from __future__ import annotations

import dataclasses
import math
import os
import signal
import time
from functools import partial

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

import cv2
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from graph_helpers import await_words
from message_samples import STATUS
from overlay_flight import MESSAGES, Flight, has_lines, write_map
from overlays import PLANE, SQUARE_N, distances, ink_on, pose_at, true_outline
from project import reader_of
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import CompressedImage, Image, NavSatFix
from std_msgs.msg import Header, String

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.io.messages import STATE_TOPIC, NodeState, camera_pose, stamp_ns
from tirgeo_ros.io.messages.json_codec import answer_of, state_text
from tirgeo_ros.io.messages.pictures import image_pixels
from tirgeo_ros.io.messages.topics import TEMPERATURES
from tirgeo_ros.nodes.graph_node import GraphNode, Output, latched, output, sensor_input
from tirgeo_ros.nodes.overlay_node import FrameStatistics

NORTH_N = np.array([3.0, 0.0, 0.0])


@pytest.fixture
def overlay(spawn, tmp_path):
    """The node with the file of its map."""
    write_map(tmp_path / "map.geojson", SQUARE_N)
    parameters = {"map": tmp_path / "map.geojson", "ground_height_m": 25.0, "reload_s": 0.2}
    words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    node = spawn("overlay_node", *words)
    await_words(node, "ready")
    return node, tmp_path / "map.geojson"


@pytest.fixture
def take_off(meet):
    """Begin a flight: from here on there is an origin."""
    topics = {
        "/diagnostics": DiagnosticArray,
        "tirgeo/overlay/image": Image,
        "tirgeo/locate/fix": NavSatFix,
        "tirgeo/locate/point": PoseWithCovarianceStamped,
        "tirgeo/locate/answer": String,
    }
    return lambda: Flight(meet(**topics))


@pytest.fixture
def flight(overlay, take_off):
    return take_off(), *overlay


#: From above; the checks' notice is as yellow as the map.
NOTICE_ROWS = 80


def off_px(picture: Image, ring_n) -> float:
    outline, ink = true_outline(pose_at(0), ring_n), ink_on(image_pixels(picture))
    return distances(ink[ink[:, 1] > NOTICE_ROWS], outline).max()


def a_click_becomes_a_point_on_the_ground(flown, _):
    picture = flown.shown()
    assert off_px(picture, SQUARE_N) < 1.5
    corner = (SQUARE_N[:1] - pose_at(0).position_n) @ matrix_from_quat(pose_at(0).q_nc)
    u, v = XT2.project(corner)[0][0]
    points = flown.stranger.received["tirgeo/locate/point"]
    answers = flown.stranger.received["tirgeo/locate/answer"]
    warmth = flown.stranger.node.create_publisher(CompressedImage, TEMPERATURES, 1)
    png = cv2.imencode(".png", np.full((2, 2), 15_000, np.uint16))[1].tobytes()

    def clicked() -> bool:
        Output(warmth).publish(MESSAGES.compressed(stamp_ns(picture), png))
        flown.click(u, v, stamp_ns(picture))
        warm = any(answer_of(a).temperature_c == pytest.approx(26.85) for a in answers)
        return bool(warm and points and flown.stranger.received["tirgeo/locate/fix"])

    flown.stranger.spin_until(clicked)
    located = camera_pose(points[0])  # of the same type; its rotation is unknown
    assert located.stamp_ns == stamp_ns(picture)
    np.testing.assert_allclose(located.position_n[:2], SQUARE_N[0, :2], atol=0.01)  # Earth's bend
    assert np.linalg.eigvalsh(located.covariance[:3, :3])[0] > 0
    fix = flown.stranger.received["tirgeo/locate/fix"][0]
    place_n = PLANE.ned_from_geodetic(
        math.radians(fix.latitude), math.radians(fix.longitude), fix.altitude
    )
    np.testing.assert_allclose(place_n, located.position_n, atol=1e-4)
    before = len(points)
    refused = "clicks_refused_outside_picture"
    flown.until(lambda: flown.click(-5.0, 3.0) or flown.diagnostics().get(refused, "0") != "0")
    assert len(points) <= before + 20  # those of the clicks before; none of these


@pytest.mark.slow
@pytest.mark.graph
def test_a_map_that_changes_is_read_again_and_a_wrong_one_is_not(flight):
    flown, node, path = flight
    assert off_px(flown.shown(), SQUARE_N) < 1.5
    write_map(path, SQUARE_N + NORTH_N)
    flown.until(lambda: flown.diagnostics().get("reloads") == "1")
    assert off_px(flown.shown(), SQUARE_N + NORTH_N) < 1.5
    path.write_text(path.read_text()[:50])
    flown.until(lambda: "not a readable map" in flown.diagnostics().get("", ""))
    flown.until(lambda: "map_unreadable" in flown.diagnostics("/overlay_node: set-up"))
    assert off_px(flown.shown(), SQUARE_N + NORTH_N) < 1.5
    time.sleep(1.0)
    assert node.text().count("the previous map stays in use") == 1
    write_map(path, SQUARE_N)
    flown.until(lambda: flown.diagnostics().get("reloads") == "2")
    assert off_px(flown.shown(), SQUARE_N) < 1.5
    reports = flown.next_diagnostics()
    assert reports["reload_errors"] == "1"
    assert reports[""] == "ok"


@pytest.mark.parametrize("content", [None, "{ no map"], ids=["none given", "broken"])
@pytest.mark.graph
def test_a_click_without_a_map_becomes_a_point(spawn, take_off, tmp_path, content):
    """Without a map there is no alarm; a broken map is a finding, and the picture says so."""
    path = tmp_path / "map.geojson"
    if content is not None:
        path.write_text(content)
    map_words = [] if content is None else ["-p", f"map:={path}"]
    await_words(spawn("overlay_node", "-p", "ground_height_m:=25.0", *map_words), "ready")
    flown = take_off()
    located = flown.stranger.received["tirgeo/locate/point"]
    flown.until(lambda: flown.click(320.0, 256.0) or located)
    assert np.isfinite(camera_pose(located[0]).position_n).all()
    reports = flown.next_diagnostics()
    assert reports.get("notice", "") == ("" if content is None else "NO MAP: its reading failed")
    flown.until(lambda: flown.diagnostics("/overlay_node: set-up"))
    broken = "map_unreadable" in flown.diagnostics("/overlay_node: set-up")
    assert broken is (content is not None)


@pytest.mark.graph
def test_the_video_goes_on_while_the_first_map_is_laid(overlay, take_off):
    node, _ = overlay
    reader = reader_of(node.pid)
    os.kill(reader, signal.SIGSTOP)  # as long as a map of a whole county may take
    try:
        flown = take_off()
        flown.until(lambda: flown.diagnostics().get("") == "no map yet: reading")
        pictures = flown.stranger.received["tirgeo/overlay/image"]
        flown.until(lambda: len(pictures) > 10)
        assert not has_lines(pictures[-1])
    finally:
        os.kill(reader, signal.SIGCONT)
    assert off_px(flown.shown(), SQUARE_N) < 1.5
    flown.until(lambda: flown.diagnostics().get("") == "ok")
    assert flown.diagnostics()["reloads"] == "0"


@pytest.mark.graph
def test_a_dead_reader_is_reported_and_a_changed_map_is_still_read(overlay, take_off):
    node, path = overlay
    os.kill(reader_of(node.pid), signal.SIGKILL)
    flown = take_off()
    flown.until(
        lambda: "the process that reads it ended (exit code -9)" in flown.diagnostics().get("", "")
    )
    assert str(path) in flown.diagnostics()[""]
    write_map(path, SQUARE_N + NORTH_N)
    assert off_px(flown.shown(), SQUARE_N + NORTH_N) < 1.5


def the_map_is_laid_again_in_another_plane(flown, _):
    """As after the filter's reset: the same outline, at another place in the new plane."""
    assert off_px(flown.shown(), SQUARE_N) < 1.5
    moved = dataclasses.replace(PLANE, latitude_rad=PLANE.latitude_rad + 5e-7)  # 3.2 m north
    flown.origin.publish(MESSAGES.origin(moved, 0))
    ring_n = moved.ned_from_geodetic(*PLANE.geodetic_from_ned(SQUARE_N))
    pictures = flown.stranger.received["tirgeo/overlay/image"]
    flown.until(lambda: has_lines(pictures[-1]) and off_px(pictures[-1], ring_n) < 1.5)
    assert flown.next_diagnostics()["reloads"] == "0"


def messages_that_cannot_be_are_counted_and_the_video_goes_on(flown, node):
    """An origin at infinity, a picture wider than JPEG has it, poses and texts without end."""
    flown.shown()
    far = pose_at(0)
    far.position_n[0] = 1e200
    lost = dataclasses.replace(
        STATUS, state=FilterState.LOST, began_again=None, reason="\x1b[2Jno \n" * 5_000
    )
    report = MESSAGES.text(state_text(NodeState("/ekf_node", 0, 1, navigation=lost)))
    longer = String(data="{" * 200_000)
    state = Output(flown.stranger.node.create_publisher(String, STATE_TOPIC, latched()))
    for height_m in (math.inf, math.nan, 1e9):
        flown.origin.publish(MESSAGES.origin(dataclasses.replace(PLANE, height_m=height_m), 0))
    wide = MESSAGES.camera_info(XT2, 0)
    wide.width = 10**9
    reports = {}
    topics = ("tirgeo/origin", "thermal/camera_info", STATE_TOPIC)
    counts = (*(f"{topic} unreadable" for topic in topics), "too_large")

    def counted() -> bool:
        time.sleep(0.05)  # without it, 500 texts a second of 140 kB take two processors
        flown.info.publish(wide)
        flown.image.publish(MESSAGES.image(time.time_ns(), np.zeros((1, 70_000), np.uint8)))
        flown.pose.publish(MESSAGES.camera_pose(dataclasses.replace(far, stamp_ns=time.time_ns())))
        state.publish(report)
        state.publish(longer)
        reports.update(flown.diagnostics("/overlay_node: topics") | flown.diagnostics())
        return all(reports.get(count, "0") != "0" for count in (*counts, "poses_invalid"))

    flown.until(counted)
    assert reports["tirgeo/origin unreadable"] in "123"  # the latched topic keeps the newest
    assert "not on the Earth" in reports["poses_invalid_because"]
    flown.shown()  # lines, on the origin that was there before
    node.check_running()
    assert "\x1b[2J" not in node.text()
    assert "Traceback" not in node.text()


def frames_without_a_stamp_take_the_time_of_their_arrival(flown, _):
    """All are drawn and reported; there was a time when one in thirty was."""
    flown.shown()
    pictures = flown.stranger.received["tirgeo/overlay/image"]
    pictures.clear()
    flown.unstamped = True
    on_the_way = 5  # pictures with a stamp that were sent before
    flown.until(lambda: len(pictures) > 40 + on_the_way)
    reports = flown.next_diagnostics()
    assert int(reports["stamped_at_arrival.thermal/image_raw"]) > 40
    assert reports["out_of_order"] == "0"
    assert all(has_lines(picture) for picture in pictures[-5:])
    stamps = [stamp_ns(picture) for picture in pictures]
    assert 0 not in stamps[on_the_way:]
    flown.unstamped = False


@pytest.mark.slow
@pytest.mark.graph
def test_one_flight_after_the_other(flight):
    flown, node, _ = flight
    a_click_becomes_a_point_on_the_ground(flown, node)
    frames_without_a_stamp_take_the_time_of_their_arrival(flown, node)
    messages_that_cannot_be_are_counted_and_the_video_goes_on(flown, node)
    the_map_is_laid_again_in_another_plane(flown, node)


@pytest.mark.parametrize(
    ("numbers", "sent", "missed"),
    [
        ((1, 2, 3), 3, 0),
        ((1, 4, 5, 9), 9, 5),
        ((500, 501, 503), 4, 1),  # what was sent before the first is not of this life
        ((500, 501, 1, 2, 4), 6, 1),  # a number that goes back is a new sender's
    ],
)
def test_gaps_are_missed(numbers, sent, missed):
    result = FrameStatistics()
    for number in numbers:
        result.count("x", number)
    assert (result.sent, result.missed) == (sent, missed)


def test_a_message_without_a_number_is_passed_on_all_the_same():
    taken, numbers = [], FrameStatistics()
    take = numbers.counting("x", taken.append)
    take(("one", {"publication_sequence_number": None}))
    assert taken == ["one"]
    assert numbers.sent == 0


@pytest.mark.graph
def test_frames_replaced_in_a_shallow_queue_are_counted(environment):
    context = Context()
    rclpy.init(context=context, args=[], domain_id=int(environment["ROS_DOMAIN_ID"]))
    node = GraphNode("numbered", context=context)
    executor = None
    try:
        numbers, taken = FrameStatistics(), []
        counted, kind = partial(numbers.counting, "x"), "std_msgs/msg/Header"
        node.listen("x", taken.append, sensor_input(1), kind, counted)
        sender = node.create_publisher(Header, "x", output(100))
        executor = EventsExecutor(context=context)
        executor.add_node(node)
        end_s = time.monotonic() + 20
        while not taken:  # until they have found each other
            assert time.monotonic() < end_s
            sender.publish(Header(frame_id="before"))
            executor.spin_once(timeout_sec=0.1)
        begun = numbers.sent
        for number in range(50):
            sender.publish(Header(frame_id=str(number)))
        while taken[-1].frame_id != "49":
            assert time.monotonic() < end_s
            executor.spin_once(timeout_sec=0.1)
    finally:
        if executor is not None:
            executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
    after = [message for message in taken if message.frame_id != "before"]
    assert numbers.sent == len(taken) + numbers.missed
    assert 50 <= numbers.sent - begun + 1 <= 52
    assert len(after) < 50
