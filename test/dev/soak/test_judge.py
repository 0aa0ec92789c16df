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
"""The soak's bounds fail on figures that break them: truth of poses, one fate of each frame."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from dev.flights import SoakFlight
from dev.soak.__main__ import (
    FATES,
    Balance,
    FrameReport,
    Ledger,
    Picture,
    Record,
    balance,
    deviations,
    frame_figures,
    growth,
    lines_without_pose,
    memory_figures,
    pose_figures,
    poses_of,
    read_ledger,
    read_record,
    witnessed,
)
from dev.soak.run import Life
from tirgeo_ros.core.frames.rotations import quat_from_rotvec, quat_multiply
from tirgeo_ros.core.types.poses import CameraPose

MB = 1 << 20


def life(node="ekf_node", last_s=300, mb=lambda _: 100.0):
    """Own memory over the seconds of a life."""
    return Life(node, None, 0.0, memory=[(float(t), int(mb(t) * MB)) for t in range(last_s)])


def missed(figures):
    return [figure.what for figure in figures if figure.missed]


@pytest.mark.parametrize(
    ("mb", "expected"),
    [
        (lambda t: min(100 + t, 160), 0.0),  # all of it in the first minute
        (lambda t: 100 + (t >= 200) * 3, 0.03),  # later, once
        (lambda t: 100 * (1 + 0.01 * (t - 67) / 60 * (t > 60)), 0.0375),  # a percent a minute
        (lambda t: 100 - (t > 100) * 5, 0.0),  # less is no growth: the largest block counts
    ],
)
def test_growth_is_of_what_comes_after_the_first_minute(mb, expected):
    # The blocks are 15 s long: a slope is known to that.
    assert max(growth(life(mb=mb).memory), 0.0) == pytest.approx(expected, abs=0.003)


def test_memory_that_grows_is_missed_and_so_is_memory_that_nobody_could_judge():
    grows = life("overlay_node", mb=lambda t: 100 + 0.05 * t)
    assert missed(memory_figures([life(), grows])) == [
        "overlay_node: memory grown after its first minute"
    ]
    assert missed(memory_figures([life(last_s=30)]))
    assert not missed(memory_figures([life(last_s=30)], short=True))
    assert missed(memory_figures([life(last_s=30), grows], short=True))


def test_frames_without_account_are_missed():
    assert not missed(frame_figures(Balance(), 10))
    assert missed(frame_figures(Balance(unaccounted=1), 10)) == ["  without account"]
    odd = Balance(contradictions=["1 of 100"])
    assert missed(frame_figures(odd, 10)) == ["reports that contradict themselves"]


def test_what_was_written_is_read_again(tmp_path):
    ledger = tmp_path / "ledger.txt"
    ledger.write_text("epoch 3 20000003\nframe 1000000003 5.25\nframe 1050000003 5.5\nframe 11000")
    outcome = read_ledger(ledger)
    assert outcome.shift_ns == {3: 20000003}
    assert outcome.stamps_ns == [1000000003, 1050000003]  # the last one was cut by a kill
    assert outcome.sent_s == [5.25, 5.5]
    record = tmp_path / "record.jsonl"
    pose = ["pose", 1.5, 1000000003, *range(13)]
    lines = [pose, ["picture", 1.75, 1000000003, 88], ["frames", 2.0, 1000000003, 2, {"drawn": 1}]]
    record.write_text("".join(json.dumps(line) + "\n" for line in lines))
    read = read_record(record)
    assert read.poses.stamps_ns == [1000000003]
    assert read.poses.q_nc.tolist() == [[3, 4, 5, 6]]
    assert read.pictures[0].line_pixels == 88
    assert read.reports == [FrameReport(2.0, 1000000003, 2, {"drawn": 1})]


def test_a_pose_beyond_four_sigma_and_a_long_silence_are_missed():
    camera = CameraPose(0, np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros((6, 6)))
    flight = SoakFlight(Path(), 0, {0: camera})

    def figures(north_m, seconds):
        numbers = [north_m, 0, 0, 1, 0, 0, 0, *[1.0] * 6]
        rows = [(k * seconds, k * flight.period_ns, numbers) for k in range(3)]
        return missed(pose_figures(Record(poses_of(rows), [], []), Ledger({0: 0}), flight))

    assert figures(3.9, 1.0) == []
    assert figures(4.1, 1.0) == ["  farthest from the truth, position"]
    assert figures(0.0, 61.0) == ["longest time without a pose"]
    nothing = Record(poses_of([]), [], [])
    assert len(missed(pose_figures(nothing, Ledger({0: 0}), flight))) == 3


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


def outcome(*rows, shifts=None):
    return deviations(poses_of(rows), CAMERAS, shifts or {0: 0}, PERIOD, START)


def test_errors_come_out_in_sigmas_axis_by_axis():
    sigmas = outcome(row(3, error_m=(0.02, 0, -0.1), error_rad=(0, 0.002, 0))).sigmas
    # Sums of rotations are not their product: the second order is 1e-6 of them.
    assert sigmas == pytest.approx(np.array([[1, 0, 5, 0, 2, 0]]), abs=1e-6)


def test_rounds_and_epochs_are_taken_out():
    shift = 300_000_000_000 + 7
    result = outcome(
        row(3), row(4, rounds=5), row(5, rounds=2, shift=shift), shifts={0: 0, 7: shift}
    )
    assert result.sigmas == pytest.approx(np.zeros((3, 6)), abs=1e-6)
    assert result.strangers == 0


def test_a_pose_of_no_epoch_or_of_no_instant_is_a_stranger():
    between = (1.0, START + STEP // 2, row(3)[2])
    assert outcome(row(3), row(3, shift=5), between).strangers == 2


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
    before, after = picture(4 * STEP, came_s=4.9), picture(31 * STEP, came_s=11.1)
    searching = [picture(28 * STEP, came_s=8.0), picture(29 * STEP, came_s=9.1)]
    assert witnessed([before, *searching, after], poses, [5.0]) == [before, after]
    assert witnessed([before, after], poses, [math.inf]) == [before, after]


FIRST_NS = 1_634_731_206_000_000_000
PERIOD_NS = 50_000_000
LIVED = [(-3.0, 10.0, False)]


def ledger(player_from=100):
    """A hundred frames every 50 ms; from a place on they are another player's, of epoch 1000."""
    stamps = [FIRST_NS + k * PERIOD_NS + 1000 * (k >= player_from) for k in range(100)]
    return Ledger({0: 0, 1000: 1000}, stamps, [k * 0.05 for k in range(100)])


def report(came_s, place, sent, waiting=0, refused=0, player_from=100, **fates):
    counts = dict.fromkeys(FATES, 0) | {"frames_sent": sent, "waiting": waiting} | fates
    return FrameReport(came_s, ledger(player_from).stamps_ns[place], refused, counts)


@pytest.mark.parametrize(
    ("reports", "lives", "unaccounted"),
    [
        (
            [
                report(1.0, 19, 20, waiting=1, drawn=15, notices=4),
                report(5.0, 99, 100, drawn=80, notices=10, replaced=3, frames_missed=7),
            ],
            LIVED,
            0,
        ),
        (  # killed at 1.5 s, when 31 were sent; the next life heard first of frame 50
            [
                report(1.0, 19, 20, drawn=20),
                report(4.0, 79, 30, drawn=30),
                report(5.5, 99, 50, drawn=50),
            ],
            [(-3.0, 1.5, True), (2.0, 10.0, False)],
            0,
        ),
        ([report(4.0, 79, 80, drawn=80)], LIVED, 20),  # must be told of
        ([report(2.0, 39, 39, drawn=39), report(5.5, 99, 100, drawn=100)], LIVED, 1),
        ([report(2.0, 39, 41, drawn=41), report(5.5, 99, 100, drawn=100)], LIVED, 1),
    ],
)
def test_all_frames_have_a_fate_or_are_missing_by_name(reports, lives, unaccounted):
    outcome = balance(ledger(), reports, lives)
    assert outcome.unaccounted == unaccounted
    assert not outcome.contradictions


def test_a_sender_that_is_killed_takes_frames_with_it():
    counts = [(2.0, 39, 40), (4.0, 79, 75), (5.5, 99, 95)]  # 5 of 80: the last, or the first
    reports = [report(*each, player_from=60, drawn=each[-1]) for each in counts]
    assert balance(ledger(60), reports, LIVED).unaccounted == 0


def test_what_could_not_be_read_or_used_is_refused():
    given = report(5.0, 99, 100, drawn=90, invalid=4, out_of_order=1, refused=5)
    outcome = balance(ledger(), [given], LIVED)
    assert outcome.fates["invalid"] == 9
    assert not outcome.contradictions


def test_a_frame_without_a_fate_shows():
    outcome = balance(ledger(), [report(5.5, 99, 100, drawn=99)], LIVED)
    assert len(outcome.contradictions) == 1
    assert "1 of 100" in outcome.contradictions[0]


@pytest.mark.parametrize(("drawn", "blind"), [(0, 1), (3, 0)])
def test_a_life_that_never_draws_shows(drawn, blind):
    each = range(5, 101, 5)
    reports = [report(n / 20, n - 1, n, drawn=drawn, notices=n - drawn) for n in each]
    assert balance(ledger(), reports, LIVED).blind == blind
