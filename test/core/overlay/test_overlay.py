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
"""Frames and poses: which frame is drawn when, with lines at the true place or a notice."""

import math

import cv2
import numpy as np
import pytest
from overlays import (
    GREY,
    LATENCY,
    MOVED_N,
    MS,
    PLAIN,
    PLANE,
    SQUARE_N,
    START,
    STRIP_TOP,
    WAIT,
    assert_on,
    distances,
    geo,
    ink_on,
    pictured,
    pose_at,
    ready,
    status,
    true_outline,
)

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.map.vector_map import MapLayer
from tirgeo_ros.core.overlay.map_shapes import drape_layers
from tirgeo_ros.core.overlay.overlay import Frame, FrameQueue, Overlay
from tirgeo_ros.core.types.verdicts import FilterState


def test_the_lines_lie_on_the_truth_at_the_exposure():
    """The pose between two poses, 50 ms before the stamp: 3 m/s and 20 deg/s move it 25 px."""
    overlay = ready()
    for i in range(6):
        overlay.poses.add(pose_at(START + 40 * MS * i, north=0.12 * i, yaw_deg=0.8 * i))
    stamp = START + 150 * MS
    overlay.add_frame(stamp, GREY, stamp + 30 * MS)
    result = overlay.take(stamp + 30 * MS)
    assert result.notice == ""
    assert result.stamp_ns == stamp
    exposure = pose_at(START + 100 * MS, north=0.3, yaw_deg=2.0)
    np.testing.assert_allclose(result.pose.position_n, exposure.position_n, atol=1e-9)
    assert result.image.shape == (512, 640, 3)
    assert_on(result.image, exposure)
    assert overlay.counts["drawn"] == 1
    assert (GREY == 90).all()  # the frame itself is left alone


def test_a_rectified_picture():
    """Lines lie at the true place for a camera without distortion, and clicks use that camera."""
    plain = Camera(640, 512, XT2.fx, XT2.fy, XT2.cx, XT2.cy)
    wide_n = SQUARE_N * [1, 2, 1]
    overlay = ready([geo(wide_n)], rectify=True, ground_height_m=25.0)
    result = pictured(overlay)
    assert result.camera == plain
    pixels = ink_on(result.image)
    pixels = pixels[result.image[pixels[:, 1], pixels[:, 0], 1] > 100]  # not the border's edge
    assert distances(pixels, true_outline(pose_at(START), wide_n, plain)).max() < 1.5
    assert distances(pixels, true_outline(pose_at(START), wide_n)).max() > 3  # the lens bends more
    uv, _ = plain.project((SQUARE_N[:1] - [0, 0, -20.0]) @ matrix_from_quat(pose_at(START).q_nc))
    located = overlay.clicks.locate(tuple(uv[0]))
    np.testing.assert_allclose(located.point_n[:2], SQUARE_N[0, :2], atol=0.01)  # Earth's bend


def test_another_map_while_running():
    overlay = ready()
    assert_on(pictured(overlay).image, pose_at(START))
    moved = MapLayer("moved", [geo(SQUARE_N + MOVED_N)])
    overlay.set_map(drape_layers([moved], PLANE, math.nan))
    pixels = ink_on(pictured(overlay, START + MS).image)
    outline = true_outline(pose_at(START), SQUARE_N + MOVED_N)
    assert distances(pixels, outline).max() < 1.5


def test_a_map_with_fewer_features_after_one_with_labels():
    """The labels of the former map are no features of this one."""
    overlay = ready([geo(SQUARE_N + 2 * number, f"house {number}") for number in range(3)])
    pictured(overlay)
    overlay.set_map(drape_layers([MapLayer("one", [geo(SQUARE_N, "house")])], PLANE, math.nan))
    assert_on(pictured(overlay, START + MS).image, pose_at(START))


def test_a_map_that_is_draped_elsewhere_is_awaited_in_each_plane():
    layers = [MapLayer("map", [geo(SQUARE_N)])]
    overlay = ready(layers=None, has_status=False)
    moved = TangentPlane(PLANE.latitude_rad + 1e-6, PLANE.longitude_rad, 25.0)
    square_n = moved.ned_from_geodetic(*PLANE.geodetic_from_ned(SQUARE_N))
    for turn, (plane, other, ring_n) in enumerate(
        ((PLANE, moved, SQUARE_N), (moved, PLANE, square_n))
    ):
        start = START + turn * 10 * MS
        overlay.set_plane(plane)
        result = pictured(overlay, start)
        assert result.notice == "NO MAP YET: reading"
        assert not (ink_on(result.image)[:, 1] > 150).any()  # the notice stands above
        assert overlay.no_map_yet == "reading"
        overlay.set_map(drape_layers(layers, other, math.nan))  # not for this plane
        assert pictured(overlay, start + MS).notice == "NO MAP YET: reading"
        overlay.set_map(drape_layers(layers, plane, math.nan))
        result = pictured(overlay, start + 2 * MS)
        assert (result.notice, overlay.no_map_yet) == ("", "")
        assert distances(ink_on(result.image), true_outline(pose_at(START), ring_n)).max() < 1.5


def test_a_map_that_fails_gives_a_notice_and_a_map_that_is_drawn_stays():
    overlay = ready(layers=None, has_status=False)
    overlay.map_failed("park.geojson not found")
    assert pictured(overlay, START + MS).notice == "NO MAP: park.geojson not found"
    overlay.set_map(drape_layers([MapLayer("map", [geo(SQUARE_N)])], PLANE, math.nan))
    overlay.map_failed("its reading failed")
    assert_on(pictured(overlay, START + 2 * MS).image, pose_at(START))


@pytest.mark.parametrize(
    ("layers", "failure", "notice", "untrusted"),
    [
        ((), "", "", "NO POSE: pose 0.9 s old"),
        (None, "", "NO MAP YET: reading", "NO MAP: pose 0.9 s old"),
        (None, "x not found", "NO MAP: x not found", "NO MAP: x not found; pose 0.9 s old"),
    ],
    ids=["none given", "being read", "broken"],
)
def test_a_click_needs_no_map(layers, failure, notice, untrusted):
    """A pose, a camera and a ground are enough, also for the footprint; without a pose, none."""
    overlay = Overlay(OverlayConfig(ground_height_m=25.0), layers)
    overlay.set_plane(PLANE)
    overlay.set_camera(XT2)
    overlay.map_failed(failure or overlay.no_map_yet)
    result = pictured(overlay)
    assert result.notice == notice
    assert len(overlay.painter.shaper.footprint(result.pose)) > 2
    assert not (ink_on(result.image)[:, 1] > 150).any()  # no line
    at_px = tuple(
        XT2.project((SQUARE_N[:1] - [0, 0, -20]) @ matrix_from_quat(pose_at(0).q_nc))[0][0]
    )
    located = overlay.clicks.locate(at_px)
    np.testing.assert_allclose(located.point_n[:2], SQUARE_N[0, :2], atol=0.01)  # Earth's bend
    overlay.add_frame(START + 10 * WAIT, GREY, START)
    assert overlay.take(START + WAIT).notice == untrusted
    assert overlay.clicks.locate(at_px).reason is Reason.NO_POSE


@pytest.mark.parametrize(
    ("poses_ns", "state", "notice"),
    [
        ((), (), "no pose at this frame"),
        ((-300 * MS, 300 * MS), (), "camera poses are missing"),
        ((1,), (), "no pose at this frame"),
        ((), (FilterState.ALIGNING,), "no position yet, the filter aligns itself"),
        ((), (FilterState.WAITING,), "no position, as sensor data are missing"),
        ((), (FilterState.LOST, "sigma"), "no position, as the filter's errors grew too large"),
        ((), (FilterState.DEAD_RECKONING, "rtk/fix"), "no pose at this frame"),
    ],
)
def test_the_notice_says_why(poses_ns, state, notice):
    overlay = ready()
    overlay.status = status(*state)
    for stamp_ns in poses_ns:
        overlay.poses.add(pose_at(START + stamp_ns))
    now = START + LATENCY
    overlay.add_frame(now, GREY, now)
    result = overlay.take(now + WAIT)
    assert result.notice == f"NO MAP: {notice}"
    assert (result.image[:480] != 90).any()


def test_a_frame_that_no_pose_can_help_gets_its_notice_at_once():
    overlay = Overlay(OverlayConfig(), [MapLayer("map", [geo(SQUARE_N)])])

    def notice(number, frame=GREY):
        overlay.add_frame(START + number, frame, START)
        return overlay.take(START).notice

    assert notice(0) == "NO MAP: no camera info"
    overlay.set_camera(XT2)
    assert notice(1) == "NO MAP: no origin"
    overlay.set_plane(PLANE)
    quarter = GREY[:256, :320]
    assert notice(2, quarter) == "NO MAP: image is 320x256, camera info 640x512"
    overlay.set_camera(Camera(320, 256, 400.0, 400.0, 160.0, 128.0))
    assert pictured(overlay, START + 3 - LATENCY, frame=quarter).notice == ""
    assert pictured(ready(features=[])).notice == "NO MAP: the map has no features"


def test_a_new_plane_forgets_poses_in_the_old_one():
    overlay = ready()
    overlay.poses.add(pose_at(START))
    overlay.set_plane(TangentPlane(PLANE.latitude_rad, PLANE.longitude_rad, PLANE.height_m))
    overlay.add_frame(START + LATENCY, GREY, START)
    assert overlay.take(START).notice == ""
    overlay.poses.add(pose_at(START + 100 * MS))
    overlay.set_plane(TangentPlane(PLANE.latitude_rad + 1e-5, PLANE.longitude_rad, 25.0))
    overlay.add_frame(START + 100 * MS + LATENCY, GREY, START)
    assert overlay.take(START) is None
    assert overlay.take(START + WAIT).notice == "NO MAP: no pose at this frame"


def test_a_located_point_stays_drawn_with_its_ellipse():
    overlay = ready(ground_height_m=25.0, confidence=PLAIN)
    far = [MapLayer("far", [geo(SQUARE_N + np.array([500, 0, 0]))])]
    overlay.set_map(drape_layers(far, PLANE, 25.0))
    pictures = []
    for k in range(2):
        result = pictured(overlay, START + 100 * MS * k, START + 100 * MS * k, yaw_deg=2.0 * k)
        pictures.append(result.image.astype(int))
        overlay.clicks.locate((320.0, 256.0))
    magenta = [image[..., 0] - image[..., 1] > 120 for image in pictures]  # mark and label
    assert magenta[0].sum() == 0
    v, u = np.nonzero(magenta[1][:, :305])  # without the label to its right
    lilac = pictures[1][..., 0] - pictures[1][..., 1]
    assert ((lilac > 40) & (lilac < 90)).sum() > 20  # the ellipse
    # Two degrees to the right move it by 2 * pi / 180 * cos 30 * 40 m * 20 px/m = 24 px or so.
    assert 320 - 32 < np.median(u) < 320 - 18
    assert abs(np.median(v) - 256) < 12


def fly(overlay, until_ns, step_ns=20 * MS):
    """Poses of steady motion up to an instant: 3 m/s and 20 deg/s."""
    for stamp_ns in range(until_ns - 1_400 * MS, until_ns + 1, step_ns):
        overlay.poses.add(flown(stamp_ns))


def flown(stamp_ns):
    t = (stamp_ns - START) * 1e-9
    return pose_at(stamp_ns, north=3 * t, yaw_deg=20 * t)


def test_a_pose_that_is_old_is_no_pose():
    overlay = ready()
    overlay.poses.add(pose_at(START - 800 * MS))
    now = START + LATENCY
    overlay.add_frame(now, GREY, now)
    result = overlay.take(now + WAIT)
    assert result.notice == "NO MAP: pose 0.8 s old"
    assert result.pose is None
    outline = true_outline(pose_at(START))
    assert ((outline > [0, 120]) & (outline < [639, 480])).all(axis=1).sum() > 1000
    assert (result.image[120:480] == 90).all()  # under the notice, above the status line
    assert overlay.counts["notices"] == 1
    assert overlay.counts["late"] == 1


def test_a_pose_that_stops_short_of_the_exposure_is_predicted_and_marked():
    overlay = ready()
    fly(overlay, START - 60 * MS)
    now = START + LATENCY
    overlay.add_frame(now, GREY, now)
    assert overlay.take(now + WAIT - 1) is None  # it may still come
    result = overlay.take(now + WAIT)
    assert result.notice == ""
    assert result.predicted_s == pytest.approx(0.06)
    assert result.pose.stamp_ns == START
    np.testing.assert_allclose(result.pose.position_n, flown(START).position_n, atol=1e-6)
    assert_on(result.image, flown(START))
    counts = overlay.counts
    assert (counts["drawn"], counts["predicted"], counts["late"]) == (1, 1, 1)
    orange = result.image[STRIP_TOP:, :140].astype(int)
    assert (orange[..., 2] - orange[..., 0] > 100).sum() > 50  # "predicted 60 ms"
    overlay.poses.add(flown(START - 40 * MS))
    overlay.poses.add(flown(START + 100 * MS))
    overlay.add_frame(now + 40 * MS, GREY, now + 40 * MS)
    assert overlay.take(now + 40 * MS).predicted_s == 0
    assert overlay.counts["predicted"] == 1


@pytest.mark.parametrize(
    ("ahead_ms", "most_s", "state", "why"),
    [
        (101, 0.1, FilterState.RUNNING, "pose 0."),
        (40, 0.03, FilterState.RUNNING, "pose 0."),
        (1, 0.0, FilterState.RUNNING, "pose 0."),
        (40, 0.1, FilterState.LOST, "no position, as the filter's errors grew too large"),
    ],
)
def test_nothing_is_predicted_too_far_or_where_the_filter_is_lost(ahead_ms, most_s, state, why):
    overlay = ready(max_prediction_s=most_s)
    fly(overlay, START - ahead_ms * MS)
    overlay.status = status(state)
    overlay.add_frame(START + LATENCY, GREY, START)
    assert overlay.take(START + WAIT).notice.startswith(f"NO MAP: {why}")
    assert overlay.counts["predicted"] == 0


def test_poses_that_always_come_late_still_give_every_picture():
    """Poses 80 ms behind the exposures, frames every 33 ms: each frame waits for its own."""
    overlay, shown, step = ready(), [], 33 * MS
    fly(overlay, START - 80 * MS, 10 * MS)
    for now in range(START, START + 1_000 * MS, MS):
        if (now - START) % step == 0:
            overlay.add_frame(now + LATENCY, GREY, now)
        if (now - START) % (10 * MS) == 0:
            overlay.poses.add(flown(now - 80 * MS))
        result = overlay.take(now)
        if result is not None:
            assert result.predicted_s == 0
            assert result.notice == ""
            shown.append(result.stamp_ns)
    assert np.unique(np.diff(shown)).tolist() == [step]
    assert len(shown) >= 27
    assert overlay.counts["replaced"] == 0


def test_a_blocked_consumer_gets_the_newest_picture_and_every_frame_is_accounted_for():
    rng = np.random.default_rng(5)
    overlay, added, results = ready(), 0, []
    fly(overlay, START, 10 * MS)
    now = START
    for _ in range(60):
        for _ in range(rng.integers(1, 9)):  # while the consumer is busy
            now += 33 * MS
            overlay.poses.add(flown(now))
            overlay.add_frame(now, GREY, now)
            added += 1
        result = overlay.take(now)
        assert result.stamp_ns == now  # the newest, and no older one after it
        assert overlay.take(now) is None
        results.append(result)
    counts = overlay.counts
    assert counts["drawn"] == len(results) == 60
    assert counts["drawn"] + counts["notices"] + counts["replaced"] == added


def test_a_bag_that_begins_again():
    overlay = ready()
    for _ in range(2):
        for i in range(15):
            stamp = START + 100 * MS * i
            assert pictured(overlay, stamp - LATENCY, stamp).notice == ""
    assert overlay.counts["drawn"] == 30
    assert overlay.counts["time_jumps"] == 1
    assert overlay.counts["poses_went_back"] == 1


def test_a_clock_that_goes_back_does_not_keep_a_frame():
    overlay = ready()
    overlay.add_frame(START, GREY, START)
    assert overlay.take(START) is None
    assert overlay.take(START - 10_000 * MS).notice == "NO MAP: no pose at this frame"


def test_a_long_latency_keeps_poses_long_enough():
    overlay = ready(video_latency_s=5.0)
    for i in range(60):
        overlay.poses.add(pose_at(START + 100 * MS * i))
    stamp = START + 5_900 * MS
    overlay.add_frame(stamp, GREY, stamp)
    assert overlay.take(stamp).notice == ""


def queue_of(*frames):
    """The queue after pictures, or after plain ones at stamps (s)."""
    queue = FrameQueue()
    for each in frames:
        plain = not isinstance(each, np.ndarray)
        pixels, stamp_s = (np.zeros((4, 5), np.uint8), each) if plain else (each, 1.0)
        queue.put(Frame(round(stamp_s * 1e9), pixels, 0))
    return queue


def test_older_frames_are_replaced_and_at_most_a_second_of_video_waits():
    queue = queue_of(1.0, 1.1, 1.2, 1.3)
    queue.take(list(queue)[1])
    assert [frame.stamp_ns for frame in queue] == [1_300_000_000]  # newer ones go on waiting
    assert {name: n for name, n in queue.counts.items() if n} == {"replaced": 2}
    queue = queue_of(*(0.1 * i for i in range(1, 101)))
    assert (len(queue), queue.counts["replaced"]) == (30, 70)
    queue = queue_of(5.0, 4.5, 5.0)
    assert (len(queue), queue.counts["out_of_order"]) == (1, 2)


@pytest.mark.parametrize(
    ("shape", "kind", "counted"),
    [
        ((4, 5, 3), np.uint16, "invalid"),
        ((4, 5), np.int16, "invalid"),
        ((4, 5), float, "invalid"),
        ((4, 5, 4), np.uint8, "invalid"),
        ((4, 5, 1), np.uint8, "invalid"),
        ((20,), np.uint8, "invalid"),
        ((0, 5), np.uint8, "invalid"),
        ((1, 70_000), np.uint8, "too_large"),
        ((65_501, 1, 3), np.uint8, "too_large"),
    ],
)
def test_what_is_no_picture_is_counted(shape, kind, counted):
    queue = queue_of(np.zeros(shape, kind))
    assert (len(queue), queue.counts[counted]) == (0, 1)


def test_the_largest_picture_can_be_sent_as_jpeg():
    widest = np.zeros((1, 65_500), np.uint8)
    assert len(queue_of(widest)) == 1
    assert cv2.imencode(".jpg", widest)[0]
