"""Frames that wait for their pose; lines where the truth is; a notice where there is no pose."""

import math
from itertools import pairwise

import numpy as np
import pytest

from tirgeo_ros.core.attitude import matrix_from_quat, quat_from_euler, quat_multiply
from tirgeo_ros.core.camera import XT2, Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.errors import ConfigError
from tirgeo_ros.core.frames import Q_BODY_OPTICAL
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_layers import GeoFeature, MapLayer
from tirgeo_ros.core.overlay import Overlay
from tirgeo_ros.core.samples import CameraPose, FilterState, FixStatus, NavigationStatus

PLANE = TangentPlane(math.radians(30.5), math.radians(114.3), 25.0)
MS = 1_000_000
START = 1_700_000_000_000 * MS
LATENCY = 50 * MS
WAIT = 100 * MS
GREY = np.full((512, 640), 90, np.uint8)
SQUARE_N = np.array([[30, -6, 0], [30, 6, 0], [42, 6, 0], [42, -6, 0]], float)


def geo(points_n, label="", *, height=True):
    points = np.column_stack(PLANE.geodetic_from_ned(np.asarray(points_n, float)))
    if not height:
        points[:, 2] = np.nan
    return GeoFeature(label, closed=len(points_n) > 2, points=points)


def pose_at(stamp_ns, north=0.0, yaw_deg=0.0):
    q_nc = quat_multiply(
        quat_from_euler(0.0, math.radians(-30), math.radians(yaw_deg)), Q_BODY_OPTICAL
    )
    return CameraPose(stamp_ns, np.array([north, 0.0, -20.0]), q_nc, np.eye(6) * 1e-4)


def status(state=FilterState.RUNNING, reason=""):
    return NavigationStatus("ekf_heading", state, reason, FixStatus.FIXED, 0.002, {}, {})


def ready(features=None, **config):
    layer = MapLayer("map", [geo(SQUARE_N)] if features is None else features)
    overlay = Overlay(OverlayConfig(**config), [layer])
    overlay.set_plane(PLANE)
    overlay.set_camera(XT2)
    overlay.set_status(status())
    return overlay


def ink_on(image):
    v, u = np.nonzero(image[:490, :, 2].astype(int) - image[:490, :, 0] > 100)
    return np.column_stack([u, v])


def true_outline(pose, points_n=SQUARE_N):
    ring = np.concatenate([points_n, points_n[:1]])
    t = np.linspace(0, 1, 2000)[:, None]
    points = np.concatenate([a + t * (b - a) for a, b in pairwise(ring)])
    uv, valid = XT2.project((points - pose.position_n) @ matrix_from_quat(pose.q_nc))
    return uv[valid]


def distances(pixels, outline):
    return np.array([np.hypot(*(outline - pixel).T).min() for pixel in pixels])


def assert_on(image, pose):
    pixels = ink_on(image)
    assert len(pixels) > 400
    # Half the diagonal of a pixel and the ink's own width to each side.
    assert distances(pixels, true_outline(pose)).max() < 1.5
    outline = true_outline(pose)
    seen = outline[(outline > 2).all(axis=1) & (outline < [637, 487]).all(axis=1)]
    assert distances(seen[::40], pixels).max() < 1.5


def test_the_lines_lie_on_the_truth_at_the_exposure():
    """The pose between two poses, 50 ms before the stamp: 3 m/s and 20 deg/s move it 25 px."""
    overlay = ready()
    for i in range(6):
        overlay.add_pose(pose_at(START + 40 * MS * i, north=0.12 * i, yaw_deg=0.8 * i))
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


def test_a_colour_frame():
    overlay = ready()
    overlay.add_pose(pose_at(START))
    colour = np.dstack([GREY, GREY, GREY])
    overlay.add_frame(START + LATENCY, colour, START + LATENCY)
    assert_on(overlay.take(START + LATENCY).image, pose_at(START))
    assert (colour == 90).all()


def test_a_frame_waits_for_the_pose_after_its_exposure():
    overlay = ready()
    overlay.add_pose(pose_at(START - 20 * MS))
    now = START + LATENCY
    overlay.add_frame(now, GREY, now)
    assert overlay.take(now) is None
    assert overlay.take(now + WAIT - 1) is None
    overlay.add_pose(pose_at(START + 20 * MS))
    result = overlay.take(now + WAIT - 1)
    assert result.notice == ""
    assert overlay.take(now + WAIT) is None  # nothing waits any more


def test_a_pose_is_never_extrapolated():
    overlay = ready()
    overlay.add_pose(pose_at(START - 800 * MS))
    now = START + LATENCY
    overlay.add_frame(now, GREY, now)
    result = overlay.take(now + WAIT)
    assert result.notice == "NO MAP: pose 0.8 s old"
    assert result.pose is None
    outline = true_outline(pose_at(START))
    assert ((outline > [0, 120]) & (outline < [639, 480])).all(axis=1).sum() > 1000
    assert (result.image[120:480] == 90).all()  # under the notice, above the status line
    assert overlay.counts["notices"] == 1


def gap(overlay):
    overlay.add_pose(pose_at(START - 300 * MS))
    overlay.add_pose(pose_at(START + 300 * MS))


def before_all(overlay):
    overlay.add_pose(pose_at(START + 1))


@pytest.mark.parametrize(
    ("prepare", "notice"),
    [
        (lambda _: None, "NO MAP: no pose at this frame"),
        (gap, "NO MAP: camera poses are missing"),
        (before_all, "NO MAP: no pose at this frame"),
        (lambda o: o.set_status(status(FilterState.ALIGNING)), "NO MAP: aligning"),
        (
            lambda o: o.set_status(status(FilterState.WAITING, "no heading yet")),
            "NO MAP: waiting: no heading yet",
        ),
        (
            lambda o: o.set_status(status(FilterState.LOST, "position sigma 11 m")),
            "NO MAP: lost: position sigma 11 m",
        ),
        (
            lambda o: o.set_status(status(FilterState.DEAD_RECKONING, "rtk/fix")),
            "NO MAP: no pose at this frame",
        ),
    ],
)
def test_the_notice_says_why(prepare, notice):
    overlay = ready()
    prepare(overlay)
    now = START + LATENCY
    overlay.add_frame(now, GREY, now)
    result = overlay.take(now + WAIT)
    assert result.notice == notice
    assert (result.image[:480] != 90).any()


def test_what_no_pose_can_help_is_said_at_once():
    overlay = Overlay(OverlayConfig(), [MapLayer("map", [geo(SQUARE_N)])])
    overlay.add_frame(START, GREY, START)
    assert overlay.take(START).notice == "NO MAP: no camera info"
    overlay.set_camera(XT2)
    overlay.add_frame(START + 1, GREY, START)
    assert overlay.take(START).notice == "NO MAP: no origin"
    overlay.set_plane(PLANE)
    overlay.add_frame(START + 2, GREY[:256, :320], START)
    assert overlay.take(START).notice == "NO MAP: image is 320x256, camera info 640x512"
    overlay.set_camera(Camera(320, 256, 400.0, 400.0, 160.0, 128.0))
    overlay.add_pose(pose_at(START + 3 - LATENCY))
    overlay.add_frame(START + 3, GREY[:256, :320], START)
    assert overlay.take(START).notice == ""
    empty = ready(features=[])
    empty.add_frame(START, GREY, START)
    assert empty.take(START).notice == "NO MAP: no map is given"


def test_the_status_line_shows_the_age_and_the_rate():
    overlay = ready()
    overlay.add_pose(pose_at(START))
    overlay.add_pose(pose_at(START + 200 * MS))
    strips = []
    for stamp, age in ((LATENCY, 83 * MS), (LATENCY + MS, 83 * MS), (LATENCY + 2 * MS, 500 * MS)):
        overlay.add_frame(START + stamp, GREY, START)
        strips.append(overlay.take(START + stamp + age).image[-20:])
    assert (strips[0] != strips[1]).any()  # "video starts"
    assert (strips[1] != strips[2]).any()


@pytest.mark.parametrize("state", list(FilterState))
def test_a_map_is_drawn_where_there_is_a_pose_and_the_status_line_tells_the_state(state):
    """A status may be a second old; a filter that does not navigate gives no pose."""
    pictures = []
    for told in (FilterState.RUNNING, state):
        overlay = ready()
        overlay.set_status(status(told, "rtk/heading" if told is not FilterState.RUNNING else ""))
        overlay.add_pose(pose_at(START))
        overlay.add_frame(START + LATENCY, GREY, START + LATENCY)
        pictures.append(overlay.take(START + LATENCY).image)
    np.testing.assert_array_equal(pictures[0][:-20], pictures[1][:-20])
    assert (pictures[0][-20:] != pictures[1][-20:]).any() == (state is not FilterState.RUNNING)


def test_the_newest_frame_wins():
    overlay = ready()
    overlay.add_pose(pose_at(START))
    overlay.add_pose(pose_at(START + 200 * MS))
    for stamp in (START + LATENCY, START + 100 * MS, START + 90 * MS):
        overlay.add_frame(stamp, GREY, START + 100 * MS)
    assert overlay.take(START + 100 * MS).stamp_ns == START + 100 * MS
    assert overlay.counts["replaced"] == 1
    assert overlay.counts["out_of_order"] == 1


def test_a_bag_that_begins_again():
    overlay = ready()
    for _ in range(2):
        for i in range(15):
            stamp = START + 100 * MS * i
            overlay.add_pose(pose_at(stamp - LATENCY))
            overlay.add_frame(stamp, GREY, stamp)
            assert overlay.take(stamp).notice == ""
    assert overlay.counts["drawn"] == 30
    assert overlay.counts["time_jumps"] == 1
    assert overlay.counts["poses_went_back"] == 1


def test_a_clock_that_goes_back_does_not_keep_a_frame():
    overlay = ready()
    overlay.add_frame(START, GREY, START)
    assert overlay.take(START) is None
    assert overlay.take(START - 10_000 * MS).notice == "NO MAP: no pose at this frame"


def test_poses_that_are_not_finite_are_counted():
    overlay = ready()
    bad = pose_at(START)
    overlay.add_pose(CameraPose(START, bad.position_n * math.nan, bad.q_nc, bad.covariance))
    overlay.add_pose(CameraPose(START, bad.position_n, bad.q_nc * 0, bad.covariance))
    assert overlay.counts["poses_invalid"] == 2
    overlay.add_frame(START + LATENCY, GREY, START)
    assert overlay.take(START + WAIT).notice == "NO MAP: no pose at this frame"


def test_a_new_plane_forgets_poses_in_the_old_one():
    overlay = ready()
    overlay.add_pose(pose_at(START))
    overlay.set_plane(TangentPlane(PLANE.latitude_rad, PLANE.longitude_rad, PLANE.height_m))
    overlay.add_frame(START + LATENCY, GREY, START)
    assert overlay.take(START).notice == ""
    overlay.add_pose(pose_at(START + 100 * MS))
    overlay.set_plane(TangentPlane(PLANE.latitude_rad + 1e-5, PLANE.longitude_rad, 25.0))
    overlay.add_frame(START + 100 * MS + LATENCY, GREY, START)
    assert overlay.take(START) is None
    assert overlay.take(START + WAIT).notice == "NO MAP: no pose at this frame"


def test_the_latency_is_a_parameter():
    overlay = ready(video_latency_s=0.0)
    overlay.add_pose(pose_at(START, yaw_deg=3.0))
    overlay.add_frame(START, GREY, START)
    assert_on(overlay.take(START).image, pose_at(START, yaw_deg=3.0))


def test_a_long_latency_keeps_poses_long_enough():
    overlay = ready(video_latency_s=5.0)
    for i in range(60):
        overlay.add_pose(pose_at(START + 100 * MS * i))
    stamp = START + 5_900 * MS
    overlay.add_frame(stamp, GREY, stamp)
    assert overlay.take(stamp).notice == ""


def test_a_map_without_heights():
    flat = [geo(SQUARE_N, height=False)]
    with pytest.raises(ConfigError, match="set ground_height_m"):
        Overlay(OverlayConfig(), [MapLayer("map", flat)])
    overlay = ready(features=flat, ground_height_m=25.0)
    overlay.add_pose(pose_at(START))
    overlay.add_frame(START + LATENCY, GREY, START)
    assert_on(overlay.take(START).image, pose_at(START))


def test_labels_and_marks_are_drawn():
    named = [geo(SQUARE_N, "Grünfläche"), geo([[36, 0, 0]], "P1")]
    pictures = []
    for features in (named, [geo(SQUARE_N), geo([[36, 0, 0]])], [geo(SQUARE_N)]):
        overlay = ready(features=features)
        overlay.add_pose(pose_at(START))
        overlay.add_frame(START + LATENCY, GREY, START)
        pictures.append(overlay.take(START).image)
    white = [(picture[:490] > 200).all(axis=2).sum() for picture in pictures]
    assert white[0] > 50
    assert white[1] == white[2] == 0
    assert len(ink_on(pictures[1])) > len(ink_on(pictures[2]))


def test_the_same_frames_give_the_same_pictures():
    results = []
    for _ in range(2):
        overlay = ready(features=[geo(SQUARE_N, "a"), geo(SQUARE_N + 3, "b")])
        overlay.add_pose(pose_at(START))
        overlay.add_frame(START + LATENCY, GREY, START + 7 * MS)
        results.append(overlay.take(START + 60 * MS).image)
    np.testing.assert_array_equal(*results)
