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
"""The whole graph on the sample flight: processes over DDS, watched by a stranger."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import threading
import time
from itertools import pairwise

import cv2
import numpy as np
import pytest
from graph_helpers import Stranger, stamps_of
from project import children_of, wait_until
from sensor_msgs.msg import Image

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_rotvec, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.io.maps import load_layers
from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.io.messages.pictures import image_pixels
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.graph.node_graph import GraphRun, GraphSetup, run_graph
from tirgeo_ros.tools.replay.graph_outputs import Outputs, differences, read_outputs
from tirgeo_ros.tools.replay.process import process

_STEP_M = 0.25  # lines are cut so fine that the lens cannot bend a piece visibly
_NEAREST_M = 1.0
_MARK_PX = 8  # a point is drawn as a mark of this reach, which has no outline on the ground
STATUS_ROWS = 20


def ink_of(image: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels of the lines' colour, pure yellow, outside the status line."""
    blue, green, red = (image[:, :, k].astype(int) for k in range(3))
    ink = (green > 200) & (red > 200) & (blue < 60)
    ink[-STATUS_ROWS:] = False
    return ink


class Outlines:
    """The lines of a map in the axes of a plane."""

    def __init__(self, features, plane: TangentPlane, ground_height_m: float) -> None:
        lines, points = [], []
        for feature in features:
            lat, lon, height = feature.points.T
            height = np.where(np.isnan(height), ground_height_m, height)
            corners = plane.ned_from_geodetic(lat, lon, height)
            if len(corners) == 1:
                points.append(corners[0])
            else:
                lines.append(_fine(corners, closed=feature.closed))
        self._lines = np.vstack(lines)
        self._starts = np.cumsum([len(line) for line in lines])[:-1]
        self._points = np.array(points).reshape(-1, 3)

    def drawn(self, camera: Camera, pose: CameraPose) -> tuple[np.ndarray, np.ndarray]:
        """(h, w) bool twice: where lines lie, and where marks of points may lie."""
        lines = np.zeros((camera.height, camera.width), np.uint8)
        uv, observed = _projected(camera, pose, self._lines)
        together = observed[1:] & observed[:-1]
        together[self._starts - 1] = False
        ends = np.rint(np.stack([uv[:-1], uv[1:]], 1)[together]).astype(np.int32)
        cv2.polylines(lines, list(ends), False, (1,))
        marks = np.zeros_like(lines)
        uv, observed = _projected(camera, pose, self._points)
        for u, v in uv[observed]:
            cv2.circle(marks, (round(u), round(v)), _MARK_PX, (1,), -1)
        return lines.astype(bool), marks.astype(bool)


def distances_px(ink: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """(N,) from each pixel of ink to the nearest pixel of a line."""
    far = cv2.distanceTransform((~lines).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return far[ink]


def _fine(corners: np.ndarray, *, closed: bool) -> np.ndarray:
    if closed and not np.array_equal(corners[0], corners[-1]):
        corners = np.vstack([corners, corners[:1]])
    pieces = []
    for start, end in pairwise(corners):
        count = max(int(np.ceil(np.linalg.norm(end - start) / _STEP_M)), 1)
        share = np.arange(count)[:, None] / count
        pieces.append(start + share * (end - start))
    return np.vstack([*pieces, corners[-1:]])


def _projected(
    camera: Camera, pose: CameraPose, points_n: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) pixels, nan where not seen, and (N,) whether in or near the picture."""
    points_c = (points_n - pose.position_n) @ matrix_from_quat(pose.q_nc)
    uv, valid = camera.project(points_c)
    size = np.array([camera.width, camera.height])
    near = np.all((uv > -size) & (uv < 2 * size), axis=1)
    observed = valid & near & (points_c[:, 2] > _NEAREST_M)
    return np.where(observed[:, None], uv, np.nan), observed


pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")


pytestmark = pytest.mark.graph

LATENCY_NS = 50_000_000
_RATE = 0.5  # of the bag's time
#: The filter starts a second after the bag and has settled by then.
SETTLED_NS = 12_000_000_000


class Watched:
    """What the stranger saw: the ink of each picture, by stamp, as packed bits."""

    def __init__(self) -> None:
        self.ink: dict[int, np.ndarray] = {}
        self.stamps: list[int] = []

    def take(self, message: Image) -> None:
        assert message.encoding == "bgr8"
        stamp = stamp_ns(message)
        self.stamps.append(stamp)
        self.ink[stamp] = np.packbits(ink_of(image_pixels(message)))

    def mask(self, stamp: int) -> np.ndarray:
        size = XT2.height * XT2.width
        return np.unpackbits(self.ink[stamp], count=size).astype(bool).reshape(XT2.height, -1)


@pytest.fixture(scope="module")
def flown(sample_graph, environment, tmp_path_factory) -> tuple[GraphRun, Watched]:
    """One run at half speed, with a stranger on ``tirgeo/overlay/image``.

    At full speed a machine with much else to do loses messages and poses: how quick the graph is,
    make bench measures.
    """
    setup = sample_graph(tmp_path_factory.mktemp("graph"), rate=_RATE)
    watched, results = Watched(), []
    stranger = Stranger(int(environment["ROS_DOMAIN_ID"]), {})
    stranger.node.create_subscription(Image, "tirgeo/overlay/image", watched.take, 30)
    flight = threading.Thread(target=lambda: results.append(run_graph(setup, 30.0)))
    flight.start()
    stranger.spin_until(lambda: not flight.is_alive(), 240.0)
    time.sleep(0.5)  # what was sent last
    for _ in range(30):
        stranger.executor.spin_once(timeout_sec=0.02)
    stranger.close()
    assert results, "the graph did not end well"
    return results[0], watched


@pytest.fixture(scope="module")
def outputs(flown) -> Outputs:
    return read_outputs(flown[0].recording)


def test_every_frame_comes_back_once_under_its_stamp(flown, outputs, sample):
    """But for those that gave way to a newer one while they waited: these are counted."""
    sent = stamps_of(sample / "flight.mcap", "/thermal/image_raw/compressed")
    stamps = flown[1].stamps
    assert sorted(set(stamps)) == stamps
    assert set(stamps) <= set(sent)
    # Who watches from outside may be found by the node while the first frames are under way.
    assert sent.index(stamps[0]) < 9  # one second
    sent = sent[sent.index(stamps[0]) :]
    replaced = outputs.counts("overlay_node")["replaced"]
    assert len(stamps) + replaced == len(sent)  # also: 16 MB of segment lose no colour frame
    # The recorder may be found later still, within 4 s: 36 frames.
    recorded = outputs.frame_stamps_ns[-len(stamps) :]
    assert len(recorded) >= len(stamps) - 36
    assert recorded == stamps[-len(recorded) :]


def test_drawn_lines_lie_on_the_true_outlines(flown, sample):
    """Mean at most 2 px: the product's promise. Half a pixel of it is the raster's."""
    watched = flown[1]
    truth = read_outputs(sample / "truth.mcap")
    true_poses: PoseBuffer[CameraPose] = PoseBuffer(1e9)
    for pose in truth.cameras:
        true_poses.add(pose)
    ground_m = (
        ParameterFile(sample / "params.yaml").config("overlay_node", OverlayConfig).ground_height_m
    )
    features = load_layers(str(sample / "map.geojson"))[0].features
    outlines = Outlines(features, truth.plane, ground_m)
    means, covered = [], []
    settled = [s for s in watched.stamps if s > watched.stamps[0] + SETTLED_NS]
    for stamp in settled[::2]:
        pose = true_poses.at(stamp - LATENCY_NS)
        assert isinstance(pose, CameraPose)
        lines, marks = outlines.drawn(XT2, pose)
        ink = watched.mask(stamp)
        if not ink.any():  # a notice: the machine was late with the pose
            continue
        off = distances_px(ink & ~marks, lines)
        assert off.size > 500  # a picture full of lines
        means.append(off.mean())
        lines[-STATUS_ROWS:] = False
        covered.append(np.mean(distances_px(lines, ink) <= 5))
        if len(means) == 10:  # the measure sees what it is for
            turned = quat_multiply(quat_from_rotvec(np.array([0, 0, np.radians(1.0)])), pose.q_nc)
            wrong, _ = outlines.drawn(XT2, dataclasses.replace(pose, q_nc=turned))
            assert distances_px(ink & ~marks, wrong).mean() > 4
    assert len(means) >= 20  # of 80; on a busy machine many poses come after their picture
    assert np.mean(means) <= 2.0
    assert np.mean(covered) >= 0.8  # of the true lines; labels hide the rest


def test_online_and_offline_are_the_same(flown, outputs, sample, tmp_path):
    """Differ by less than 0.02 deg and 1 cm: both drive the same core with the same samples.

    On a busy machine a measurement may come after the pose that it belongs to was published. It
    would have moved that pose by less than the pose's own sigmas.

    When samples arrive changes nothing else. Samples that never arrive do: a filter that finds the
    player after the flight has begun lacks the first ones and aligns on others. ``process`` of the
    sample without its first 0.05, 0.3, 1, 2 and 3.5 s differs by a median of 0.02, 0.02, 0.05,
    0.09 and 0.05 deg, and by less than 0.1 cm.
    """
    path = tmp_path / "offline.mcap"
    process(sample / "flight.mcap", path, params=sample / "params.yaml", images=False)
    offline = read_outputs(path)
    assert outputs.plane == offline.plane
    apart = differences(outputs.cameras, offline.cameras)
    assert len(apart.stamp_ns) == len(outputs.cameras)
    # On a busy machine nodes find each other within 4 s of the start.
    assert outputs.cameras[0].stamp_ns - offline.cameras[0].stamp_ns <= 4_000_000_000
    both = [p for p in offline.cameras if p.stamp_ns >= outputs.cameras[0].stamp_ns]
    # Joints are given up, and counted, if the body's pose has not come after the longest wait.
    given_up = outputs.counts("gimbal_node").get("body_too_new", 0)
    assert len(apart.stamp_ns) + given_up >= 0.99 * len(both)
    whole = outputs.cameras[0].stamp_ns == offline.cameras[0].stamp_ns
    assert np.degrees(np.median(apart.angle_rad)) <= (0.02 if whole else 0.15)
    assert np.median(apart.distance_m) <= 0.01
    variances = np.array([np.diag(pose.covariance) for pose in outputs.cameras])
    assert (apart.angle_rad <= 2 * np.sqrt(variances[:, 3:].sum(axis=1))).all()
    assert (apart.distance_m <= 2 * np.sqrt(variances[:, :3].sum(axis=1))).all()


def test_the_states_describe_the_flight(outputs):
    navigation = outputs.navigation[-1]
    assert navigation.state is FilterState.RUNNING
    assert navigation.rtk_status is FixStatus.FIXED
    assert navigation.counts["imu", "used"] > 2500
    # 100 Hz of the bag, by this computer's clock; a second may hold a few more or fewer.
    rates = [topic.rate_hz for topic in outputs.topic("ekf_node", "imu/data")]
    assert np.median(rates) == pytest.approx(100 * _RATE, abs=3)
    odometry = outputs.topic("ekf_node", "tirgeo/odometry")
    # How long it is, make bench measures: here the machine may be busy.
    assert sum(topic.latency_ms is not None for topic in odometry) > 20
    assert outputs.counts("overlay_node")["drawn"] >= 50


def ignore_interrupts() -> None:
    """As a shell does for what it starts in the background."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGHUP, 129)])
@pytest.mark.slow
def test_an_interrupted_demo_leaves_no_process(sample, tmp_path, number, code):
    command = [sys.executable, "-m", "tirgeo_ros.tools.cli.main", "demo", "-o", str(tmp_path)]
    demo = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=ignore_interrupts,  # noqa: PLW1509  in the child
    )
    player = tmp_path / "bag_player.log"
    wait_until(lambda: player.exists() and "ready" in player.read_text(), 120, running=demo)
    nodes = children_of(demo.pid)
    assert len(nodes) == 5
    demo.send_signal(number)
    _, message_text = demo.communicate(timeout=60)
    assert demo.returncode == code
    assert "Traceback" not in message_text
    for pid in nodes:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_node_that_dies_is_named_with_its_last_words(sample, tmp_path):
    params = tmp_path / "params.yaml"
    params.write_text("/**/overlay_node: {ros__parameters: {style: /nowhere.yaml}}\n")
    result = {"map": sample / "map.geojson", "params": [params]}
    setup = GraphSetup(sample / "flight.mcap", tmp_path, **result)
    with pytest.raises(GraphError, match=r"overlay_node ended .*nowhere\.yaml"):
        run_graph(setup, 30.0)


@pytest.mark.slow
@pytest.mark.long
def test_beside_an_aircraft_on_a_port_each_picture_keeps_its_place_in_time(
    sample_graph, sample, tmp_path
):
    """test_aircraft_flight.py has the accuracy, without the graph."""
    run = run_graph(sample_graph(tmp_path, serial=True), 30.0)
    outputs = read_outputs(run.recording).earlier(run.shift_ns)
    sent = stamps_of(sample / "flight.mcap", "/thermal/image_raw/compressed")
    assert run.error is None
    assert set(outputs.frame_stamps_ns) <= set(sent)  # to the nanosecond
    assert len(outputs.frame_stamps_ns) >= 0.95 * len(sent)
    navigation = outputs.navigation[-1]
    assert (navigation.method, navigation.rtk_status) == ("ekf_heading", FixStatus.FIXED)
    assert navigation.counts.get(("imu", "out_of_order"), 0) == 0
    assert "not played" not in (tmp_path / "bag_player.log").read_text()  # no byte was dropped
