"""Every frame has one fate, and books that are cooked show."""

from __future__ import annotations

import pytest

from dev.soak.balance import OVERLAY, TOPICS, balance
from dev.soak.records import Ledger, Report

START = 1_634_731_206_000_000_000
STEP = 50_000_000


def ledger(number=100, player_from=None):
    """Frames every 50 ms; from a place on they are another player's, whose epoch is 1000."""
    epochs = [1000 if player_from is not None and k >= player_from else 0 for k in range(number)]
    stamps = [START + k * STEP + epochs[k] for k in range(number)]
    return Ledger({0: 0, 1000: 1000}, stamps, [k * 0.05 for k in range(number)])


def report(book, came_s, place, sent, waiting=0, refused=None, **fates):
    said = dict.fromkeys(
        ("drawn", "notices", "replaced", "frames_missed", "out_of_order", "invalid"), 0
    )
    said |= {"frames_sent": sent, "waiting": waiting} | fates
    values = {key: str(value) for key, value in said.items()}
    values["newest_frame"] = "{}.{:09d}".format(*divmod(book.stamps_ns[place], 1_000_000_000))
    topics = {f"thermal/image_raw/compressed {k}": str(v) for k, v in (refused or {}).items()}
    return Report(came_s, {OVERLAY: values, TOPICS: topics})


def test_one_life_that_heard_all():
    book = ledger()
    reports = [
        report(book, 1.0, 19, 20, waiting=1, drawn=15, notices=4),
        report(book, 5.0, 99, 100, drawn=80, notices=10, replaced=3, frames_missed=7),
    ]
    found = balance(book, reports, [(-3.0, 10.0, False)])
    assert (found.sent, found.told) == (100, 100)
    assert found.fates["drawn"] == 80
    assert (found.down, found.died, found.changed, found.unaccounted) == (0, 0, 0, 0)
    assert not found.contradictions


def test_what_could_not_be_read_or_used_is_refused():
    book = ledger()
    refused = {"unreadable": 3, "failed": 2, "unreadable because": "12 bytes are no image"}
    reports = [report(book, 5.0, 99, 100, drawn=90, invalid=4, out_of_order=1, refused=refused)]
    found = balance(book, reports, [(-3.0, 10.0, False)])
    assert found.fates["invalid"] == 9
    assert not found.contradictions


def test_a_killed_life_leaves_frames_that_nobody_tells_of_and_the_next_one_misses_some():
    book = ledger()
    reports = [
        report(book, 1.0, 19, 20, drawn=20),  # killed at 1.5 s: 31 were sent
        report(book, 4.0, 79, 30, drawn=30),  # heard first: 50
        report(book, 5.5, 99, 50, drawn=50),
    ]
    found = balance(book, reports, [(-3.0, 1.5, True), (2.0, 10.0, False)])
    assert (found.died, found.down, found.unaccounted) == (11, 19, 0)
    assert found.told == 100


def test_a_sender_that_is_killed_takes_frames_with_it():
    book = ledger(player_from=60)
    reports = [
        report(book, 2.0, 39, 40, drawn=40),
        report(book, 4.0, 79, 75, drawn=75),  # 5 of 80 were the last ones, or the first
        report(book, 5.5, 99, 95, drawn=95),
    ]
    found = balance(book, reports, [(-3.0, 10.0, False)])
    assert (found.changed, found.unaccounted, found.told) == (5, 0, 100)


@pytest.mark.parametrize("heard", [39, 41])
def test_a_frame_that_is_not_counted_or_counted_twice_shows(heard):
    book = ledger()
    reports = [
        report(book, 1.0, 19, 20, drawn=20),
        report(book, 2.0, 39, heard, drawn=heard),
        report(book, 5.5, 99, heard + 60, drawn=heard + 60),
    ]
    found = balance(book, reports, [(-3.0, 10.0, False)])
    assert found.unaccounted == 1


def test_a_frame_without_a_fate_shows():
    book = ledger()
    found = balance(book, [report(book, 5.5, 99, 100, drawn=99)], [(-3.0, 10.0, False)])
    assert len(found.contradictions) == 1
    assert "1 of 100" in found.contradictions[0]


@pytest.mark.parametrize(("drawn", "blind"), [(0, 1), (3, 0)])
def test_a_life_that_never_draws_shows(drawn, blind):
    book = ledger()
    reports = [
        report(book, k * 0.25, 5 * k + 4, 5 * k + 5, drawn=drawn, notices=5 * k + 5 - drawn)
        for k in range(20)
    ]
    assert balance(book, reports, [(-3.0, 10.0, False)]).blind == blind
