"""Stamps, rates and sizes of pictures that are wrong, and those that are right."""

import pytest

from tirgeo_ros.core.checks.frame_stamps import FrameStamps

STEP_NS = 100_000_000
START_NS = 1_700_000_000 * 10**9


def checked(stamp=lambda k: START_NS + k * STEP_NS):
    stamps = FrameStamps()
    for k in range(100):
        now_ns = START_NS + k * STEP_NS + 50_000_000
        stamps.pose(now_ns - 20_000_000)
        stamps.frame(stamp(k), now_ns)
    return [(finding.check, finding.severity) for finding in stamps.findings()]


def test_good_stamps_say_nothing():
    assert checked() == []


@pytest.mark.parametrize(
    ("stamp", "checks"),
    [
        (lambda k: 0 * k, ["picture_stamps_zero"]),
        (lambda k: START_NS + (k + 5) * STEP_NS, ["picture_stamps_ahead"]),
        (lambda k: START_NS + (k - 15) * STEP_NS, ["picture_stamps_late"]),
        (lambda k: START_NS + (k - 36000) * STEP_NS, ["picture_stamps_late", "picture_clock"]),
        (lambda k: START_NS + (k // 2) * 2 * STEP_NS, ["picture_stamps_back"]),
    ],
)
def test_bad_stamps_are_told(stamp, checks):
    assert [check for check, _ in checked(stamp)] == checks


def test_poses_that_end_are_no_matter_of_the_pictures():
    stamps = FrameStamps()
    stamps.pose(START_NS)
    for k in range(100):
        stamps.frame(START_NS + k * STEP_NS, START_NS + k * STEP_NS)
    assert stamps.findings() == []


def test_pictures_that_come_before_the_clock_are_not_ahead_of_it():
    """As where a bag is played and the first /clock is late: 3 of 10 would."""
    stamps = FrameStamps()
    for k in range(100):
        stamp_ns = START_NS + k * STEP_NS
        stamps.frame(stamp_ns, stamp_ns if k >= 30 else 0)
    assert stamps.findings() == []
