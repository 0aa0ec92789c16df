"""Every frame has one fate, and books that are cooked show."""

from __future__ import annotations

import pytest

from dev.soak.balance import FATES, OVERLAY, TOPICS, balance
from dev.soak.records import Ledger, Report

START = 1_634_731_206_000_000_000
STEP = 50_000_000
LIVED = [(-3.0, 10.0, False)]
REFUSED = {"unreadable": 3, "failed": 2, "unreadable because": "12 bytes are no image"}


def ledger(player_from=100):
    """A hundred frames every 50 ms; from a place on they are another player's, of epoch 1000."""
    stamps = [START + k * STEP + 1000 * (k >= player_from) for k in range(100)]
    return Ledger({0: 0, 1000: 1000}, stamps, [k * 0.05 for k in range(100)])


def report(came_s, place, sent, waiting=0, refused=None, player_from=100, **fates):
    said = dict.fromkeys(FATES, 0) | {"frames_sent": sent, "waiting": waiting} | fates
    values = {key: str(value) for key, value in said.items()}
    stamp_ns = ledger(player_from).stamps_ns[place]
    values["newest_frame"] = "{}.{:09d}".format(*divmod(stamp_ns, 1_000_000_000))
    topics = {f"thermal/image_raw/compressed {k}": str(v) for k, v in (refused or {}).items()}
    return Report(came_s, {OVERLAY: values, TOPICS: topics})


@pytest.mark.parametrize(
    ("reports", "lives", "expected"),
    [
        (
            [
                report(1.0, 19, 20, waiting=1, drawn=15, notices=4),
                report(5.0, 99, 100, drawn=80, notices=10, replaced=3, frames_missed=7),
            ],
            LIVED,
            {},
        ),
        (  # killed at 1.5 s, when 31 were sent; the next life heard first of frame 50
            [
                report(1.0, 19, 20, drawn=20),
                report(4.0, 79, 30, drawn=30),
                report(5.5, 99, 50, drawn=50),
            ],
            [(-3.0, 1.5, True), (2.0, 10.0, False)],
            {"died": 11, "down": 19},
        ),
        ([report(4.0, 79, 80, drawn=80)], LIVED, {"unaccounted": 20}),  # must be told of
        *(
            (
                [
                    report(1.0, 19, 20, drawn=20),
                    report(2.0, 39, heard, drawn=heard),
                    report(5.5, 99, heard + 60, drawn=heard + 60),
                ],
                LIVED,
                {"unaccounted": 1},
            )
            for heard in (39, 41)
        ),
    ],
)
def test_all_frames_have_a_fate_or_are_missing_by_name(reports, lives, expected):
    found = balance(ledger(), reports, lives)
    names = ("died", "down", "changed", "unaccounted")
    assert {n: getattr(found, n) for n in names} == dict.fromkeys(names, 0) | expected
    assert not found.contradictions


def test_a_sender_that_is_killed_takes_frames_with_it():
    counts = [(2.0, 39, 40), (4.0, 79, 75), (5.5, 99, 95)]  # 5 of 80: the last, or the first
    reports = [report(*each, player_from=60, drawn=each[-1]) for each in counts]
    found = balance(ledger(60), reports, LIVED)
    assert (found.changed, found.unaccounted, found.told) == (5, 0, 100)


def test_what_could_not_be_read_or_used_is_refused():
    given = report(5.0, 99, 100, drawn=90, invalid=4, out_of_order=1, refused=REFUSED)
    found = balance(ledger(), [given], LIVED)
    assert found.fates["invalid"] == 9
    assert not found.contradictions


def test_a_frame_without_a_fate_shows():
    found = balance(ledger(), [report(5.5, 99, 100, drawn=99)], LIVED)
    assert len(found.contradictions) == 1
    assert "1 of 100" in found.contradictions[0]


@pytest.mark.parametrize(("drawn", "blind"), [(0, 1), (3, 0)])
def test_a_life_that_never_draws_shows(drawn, blind):
    each = range(5, 101, 5)
    reports = [report(n / 20, n - 1, n, drawn=drawn, notices=n - drawn) for n in each]
    assert balance(ledger(), reports, LIVED).blind == blind
