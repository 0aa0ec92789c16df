"""Each bound of the soak fails on figures that break it, and the table says which."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dev.soak.balance import Balance
from dev.soak.flight import SoakFlight
from dev.soak.judge import frame_figures, memory_figures, pose_figures
from dev.soak.lives import Life
from dev.soak.memory import growth
from dev.soak.records import Ledger, Record, poses_of, read_ledger, read_record
from dev.soak.schedule import GUEST, NODES, Kind, schedule
from tirgeo_ros.core.types.poses import CameraPose

MB = 1 << 20


def life(node="ekf_node", last_s=300, mb=lambda _: 100.0, began_s=0.0, shared=lambda _: 0.0):
    """Own and shared memory over the seconds of a life."""
    memory = [
        (float(t), int((mb(t) + shared(t)) * MB), int(shared(t) * MB)) for t in range(last_s)
    ]
    return Life(node, None, began_s, memory=memory)


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
    grown = growth(life(mb=mb).memory)
    assert max(grown.own, 0.0) == pytest.approx(expected, abs=0.003)
    assert grown.resident == grown.own


def test_pages_of_shared_memory_are_told_and_no_cover_for_a_process_s_own():
    """Pages of a peer's segment cost nothing anew; own memory is judged without them below it."""
    reads = life(shared=lambda t: 20 + 10 * (t >= 200))
    grown = growth(reads.memory)
    assert grown.own == 0.0
    assert grown.resident == pytest.approx(10 / 120)
    assert not missed(memory_figures([reads]))
    # 3 of 100 MB are 1.5 % of the 200 that are resident, and less while a segment is unmapped.
    leaks = life(mb=lambda t: 100 + 3 * (t >= 200), shared=lambda t: 100 - 10 * (t >= 200))
    assert growth(leaks.memory).own == pytest.approx(0.03)
    assert missed(memory_figures([leaks]))


def test_memory_that_grows_is_missed_and_so_is_memory_that_nobody_could_judge():
    grows = life("overlay_node", mb=lambda t: 100 + 0.05 * t)
    assert missed(memory_figures([life(), grows])) == [
        "overlay_node: memory grown after its first minute"
    ]
    assert missed(memory_figures([life(last_s=30)]))
    assert not missed(memory_figures([life(last_s=30)], short=True))
    assert missed(memory_figures([life(last_s=30), grows], short=True))


def test_frames_without_account_are_missed():
    good = Balance(10)
    good.fates["drawn"] = 10
    assert not missed(frame_figures(good))
    good.sent = 11
    assert missed(frame_figures(good)) == ["  without account"]
    lost = Balance(10, unaccounted=1)
    lost.fates["drawn"] = 9
    assert missed(frame_figures(lost)) == ["  without account"]
    odd = Balance(10, contradictions=["1 of 100"])
    odd.fates["drawn"] = 10
    assert missed(frame_figures(odd)) == ["reports that contradict themselves"]


def test_each_life_is_run_in_within_its_first_minute():
    """A minute, less what a node takes to start on a busy machine (5 s)."""
    events = schedule(1, 1200.0)
    begins = [(0.0, node) for node in ("ekf_node", "gimbal_node", "overlay_node")]
    kills = [e for e in events if e.kind is Kind.KILL and e.node in NODES]
    begins += [(e.at_s + e.lasts_s, e.node) for e in kills if e.at_s < 1100.0]
    assert len(begins) > 10
    for begin_s, node in begins:
        early = [e for e in events if begin_s < e.at_s and e.at_s + e.lasts_s < begin_s + 55.0]
        assert {(Kind.STOP, node), (Kind.KILL, GUEST)} <= {(e.kind, e.node) for e in early}
        assert {Kind.JUMP, Kind.BUSY} <= {e.kind for e in early}


def test_what_was_written_is_read_again(tmp_path):
    ledger = tmp_path / "ledger.txt"
    ledger.write_text("epoch 3 20000003\nframe 1000000003 5.25\nframe 1050000003 5.5\nframe 11000")
    found = read_ledger(ledger)
    assert found.shift_ns == {3: 20000003}
    assert found.stamps_ns == [1000000003, 1050000003]  # the last one was cut by a kill
    assert found.place(1050000003) == 1
    assert found.sent_before(5.3) == 1
    record = tmp_path / "record.jsonl"
    pose = ["pose", 1.5, 1000000003, *range(13)]
    lines = [pose, ["picture", 1.75, 1000000003, 88], ["said", 2.0, {"/a: b": {"c": "1"}}]]
    record.write_text("".join(json.dumps(line) + "\n" for line in lines))
    read = read_record(record)
    assert read.poses.stamps_ns == [1000000003]
    assert read.poses.q_nc.tolist() == [[3, 4, 5, 6]]
    assert read.pictures[0].line_pixels == 88
    assert read.reports[0].items == {"/a: b": {"c": "1"}}


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
