"""What became of each frame of a soak, by what overlay_node said of itself once a second.

overlay_node counts the frames since the first that came (``frames_sent``, by the numbers of their
sender) and what became of them. Between two reports of one life, as many frames must have been
counted as were sent between the newest frames that they name, and every one must have a fate.

What no report can tell: the frames after the last report of a life that was killed, and those
before the first that the next life, or a new sender, was heard of with.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from dev.soak.records import Ledger, Report

OVERLAY, TOPICS = "/overlay_node: overlay", "/overlay_node: topics"
#: What the diagnostics call it, and what it is.
FATES = {
    "drawn": "drawn",
    "notices": "published with a notice instead of the map",
    "replaced": "replaced by a newer frame while waiting for a pose",
    "frames_missed": "replaced in the queue, or lost by the transport",
    "out_of_order": "rejected: not newer than the previous one",
    "invalid": "rejected: not a picture",
}
#: Reports, one a second.
_LONG = 20
_REFUSED = ("unreadable", "failed")


@dataclass
class Balance:
    """Where the frames are."""

    sent: int
    fates: Counter[str] = field(default_factory=Counter)  # by the keys of FATES
    died: int = 0  # counted, if at all, after the last report of a life that was killed
    down: int = 0  # sent while overlay_node was down, or had not found its sender
    changed: int = 0  # the last of a sender that was killed, the first of the next one
    unaccounted: int = 0
    blind: int = 0  # lives that have reported for long and never drawn a line
    contradictions: list[str] = field(default_factory=list)

    @property
    def told(self) -> int:
        """All that have a place; equal to ``sent`` where the books are right."""
        return self.fates.total() + self.died + self.down + self.changed + self.unaccounted


@dataclass(frozen=True)
class _Count:
    """One report: the newest frame's place in the ledger, and the counts."""

    came_s: float
    place: int
    heard: int
    fates: Counter[str]
    waiting: int


def balance(
    ledger: Ledger, reports: Iterable[Report], lives: Sequence[tuple[float, float, bool]]
) -> Balance:
    """The fates of all frames.

    ``lives``: begin and end of each life of overlay_node, in order, by the steady clock, and
    whether it was killed.
    """
    found = Balance(len(ledger.stamps_ns))
    counts = _counts(reports, ledger, found)
    done = 0  # frames before this place have their fate
    for number, (began_s, ended_s, killed) in enumerate(lives):
        next_s = lives[number + 1][0] if number + 1 < len(lives) else float("inf")
        own = [count for count in counts if began_s <= count.came_s < next_s]
        if own:
            done = _add_life(found, own, ledger, done)
        untold = max(0, ledger.sent_before(ended_s) - done) if own else 0
        if killed:
            found.died += untold
        else:
            found.unaccounted += untold
        done += untold
    found.down += found.sent - done
    return found


def _counts(reports: Iterable[Report], ledger: Ledger, found: Balance) -> list[_Count]:
    counts = []
    for report in reports:
        said = report.items.get(OVERLAY)
        if said is None or "newest_frame" not in said:
            continue
        whole, _, part = said["newest_frame"].partition(".")
        place = ledger.place(int(whole) * 1_000_000_000 + int(part))
        if place is None:
            found.contradictions.append(f"newest_frame {said['newest_frame']} was never sent")
            continue
        fates = Counter({key: int(said[key]) for key in FATES})
        topics = report.items.get(TOPICS, {})
        refused = [int(v) for k, v in topics.items() if _is_refusal(k)]
        fates["invalid"] += sum(refused)
        counts.append(
            _Count(report.came_s, place, int(said["frames_sent"]), fates, int(said["waiting"]))
        )
        off = counts[-1].heard - fates.total() - counts[-1].waiting
        if off:
            found.contradictions.append(f"{off} of {counts[-1].heard} frames have no fate: {said}")
    return counts


def _is_refusal(key: str) -> bool:
    return key.startswith("thermal/image_raw") and key.endswith(_REFUSED)


def _add_life(found: Balance, own: Sequence[_Count], ledger: Ledger, done: int) -> int:
    """Account for one life by its reports; the place behind the last frame that they tell of."""
    first, last = own[0], own[-1]
    began = first.place + 1 - first.heard
    found.down += max(0, began - done)
    found.unaccounted += max(0, done - began)  # more than were sent
    for before, after in pairwise(own):
        lacking = (after.place - before.place) - (after.heard - before.heard)
        if lacking > 0 and ledger.player(before.place) != ledger.player(after.place):
            found.changed += lacking
        else:
            found.unaccounted += abs(lacking)
    found.fates += last.fates
    found.blind += len(own) >= _LONG and not last.fates["drawn"]
    found.died += last.waiting
    return last.place + 1
