"""Frames that wait for their poses: which comes out, when, and with what pose."""

import cv2
import numpy as np
import pytest
from overlays import (
    GREY,
    LATENCY,
    MS,
    START,
    STRIP_TOP,
    WAIT,
    assert_on,
    pose_at,
    ready,
    status,
    true_outline,
)

from tirgeo_ros.core.overlay.frame_queue import Frame, FrameQueue
from tirgeo_ros.core.types.verdicts import FilterState


def fly(overlay, until_ns, step_ns=20 * MS):
    """Poses of steady motion up to an instant: 3 m/s and 20 deg/s."""
    for stamp_ns in range(until_ns - 1_400 * MS, until_ns + 1, step_ns):
        overlay.add_pose(flown(stamp_ns))


def flown(stamp_ns):
    t = (stamp_ns - START) * 1e-9
    return pose_at(stamp_ns, north=3 * t, yaw_deg=20 * t)


def test_a_pose_that_is_old_is_no_pose():
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
    overlay.add_pose(flown(START - 40 * MS))
    overlay.add_pose(flown(START + 100 * MS))
    overlay.add_frame(now + 40 * MS, GREY, now + 40 * MS)
    assert overlay.take(now + 40 * MS).predicted_s == 0
    assert overlay.counts["predicted"] == 1


@pytest.mark.parametrize(("ahead_ms", "most_s"), [(101, 0.1), (40, 0.03), (1, 0.0)])
def test_nothing_is_predicted_too_far(ahead_ms, most_s):
    overlay = ready(max_prediction_s=most_s)
    fly(overlay, START - ahead_ms * MS)
    overlay.add_frame(START + LATENCY, GREY, START)
    assert overlay.take(START + WAIT).notice.startswith("NO MAP: pose 0.")
    assert overlay.counts["predicted"] == 0


def test_nothing_is_predicted_for_an_estimator_that_has_given_up():
    overlay = ready()
    fly(overlay, START - 40 * MS)
    overlay.set_status(status(FilterState.LOST, "position sigma 11 m"))
    overlay.add_frame(START + LATENCY, GREY, START)
    assert overlay.take(START + WAIT).notice == "NO MAP: lost: position sigma 11 m"


def test_poses_that_always_come_late_still_give_every_picture():
    """Poses 80 ms behind the exposures, frames every 33 ms: each frame waits for its own."""
    overlay, shown, step = ready(), [], 33 * MS
    fly(overlay, START - 80 * MS, 10 * MS)
    for now in range(START, START + 1_000 * MS, MS):
        if (now - START) % step == 0:
            overlay.add_frame(now + LATENCY, GREY, now)
        if (now - START) % (10 * MS) == 0:
            overlay.add_pose(flown(now - 80 * MS))
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
    overlay, given, got = ready(), 0, []
    fly(overlay, START, 10 * MS)
    now = START
    for _ in range(60):
        for _ in range(rng.integers(1, 9)):  # while the consumer is busy
            now += 33 * MS
            overlay.add_pose(flown(now))
            overlay.add_frame(now, GREY, now)
            given += 1
        result = overlay.take(now)
        assert result.stamp_ns == now  # the newest, and no older one after it
        assert overlay.take(now) is None
        got.append(result)
    counts = overlay.counts
    assert counts["drawn"] == len(got) == 60
    assert counts["drawn"] + counts["notices"] + counts["replaced"] == given


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


def test_a_long_latency_keeps_poses_long_enough():
    overlay = ready(video_latency_s=5.0)
    for i in range(60):
        overlay.add_pose(pose_at(START + 100 * MS * i))
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
