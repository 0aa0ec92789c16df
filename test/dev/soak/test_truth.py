"""Poses beyond their sigma and lines without a pose are found."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dev.soak.records import Picture, poses_of
from dev.soak.truth import deviations, lines_without_pose, witnessed
from tirgeo_ros.core.frames.rotations import quat_from_rotvec, quat_multiply
from tirgeo_ros.core.types.poses import CameraPose

START, PERIOD = 1_634_731_206_000_000_000, 1_000_000_000
STEP = 20_000_000
LATENCY = 50_000_000
Q = quat_from_rotvec(np.array([0.4, -0.2, 1.0]))
CAMERAS = {
    k * STEP: CameraPose(START + k * STEP, np.array([k, 2.0 * k, -20.0]), Q, np.zeros((6, 6)))
    for k in range(50)
}
SIGMA_M, SIGMA_RAD = 0.02, 0.001


def row(k, *, rounds=0, shift=0, error_m=(0, 0, 0), error_rad=(0, 0, 0)):
    true = CAMERAS[k * STEP]
    q_nc = quat_multiply(quat_from_rotvec(np.array(error_rad, float)), true.q_nc)
    numbers = [*(true.position_n + error_m), *q_nc, *[SIGMA_M**2] * 3, *[SIGMA_RAD**2] * 3]
    return 1.0, START + k * STEP + rounds * PERIOD + shift, numbers


def found(*rows, shifts=None):
    return deviations(poses_of(rows), CAMERAS, shifts or {0: 0}, PERIOD, START)


def test_errors_come_out_in_sigmas_axis_by_axis():
    sigmas = found(row(3, error_m=(0.02, 0, -0.1), error_rad=(0, 0.002, 0))).sigmas
    # Sums of rotations are not their product: the second order is 1e-6 of them.
    assert sigmas == pytest.approx(np.array([[1, 0, 5, 0, 2, 0]]), abs=1e-6)


def test_rounds_and_epochs_are_taken_out():
    shift = 300_000_000_000 + 7
    result = found(
        row(3), row(4, rounds=5), row(5, rounds=2, shift=shift), shifts={0: 0, 7: shift}
    )
    assert result.sigmas == pytest.approx(np.zeros((3, 6)), abs=1e-6)
    assert result.strangers == 0


def test_a_pose_of_no_epoch_or_of_no_instant_is_a_stranger():
    between = (1.0, START + STEP // 2, row(3)[2])
    assert found(row(3), row(3, shift=5), between).strangers == 2


def picture(exposure_ns, pixels=1000, came_s=2.0):
    return Picture(came_s, START + exposure_ns + LATENCY, pixels)


@pytest.mark.parametrize(
    ("exposure_ns", "without"),
    [
        (3 * STEP, False),
        (3 * STEP + STEP // 2, False),
        (9 * STEP + 99_000_000, False),  # predicted from the last one
        (9 * STEP + 101_000_000, True),
        (-1, True),  # before the first one
    ],
)
def test_lines_need_a_pose_on_both_sides_or_one_just_before(exposure_ns, without):
    stamps = [START + k * STEP for k in range(10)]
    assert bool(lines_without_pose([picture(exposure_ns)], stamps, LATENCY)) is without


def test_before_the_witness_has_found_a_new_node_it_cannot_tell():
    poses = poses_of([(came_s, row(k)[1], row(k)[2]) for came_s, k in ((1.0, 3), (9.0, 30))])
    before = picture(4 * STEP, came_s=4.9)
    while_searching = picture(28 * STEP, came_s=8.0)
    came_later = picture(29 * STEP, came_s=9.1)
    after = picture(31 * STEP, came_s=9.2)
    given = [before, while_searching, came_later, after]
    assert witnessed(given, poses, [0.5, 5.0], LATENCY) == [before, after]
    assert witnessed([before, after], poses, [math.inf], LATENCY) == [before, after]
