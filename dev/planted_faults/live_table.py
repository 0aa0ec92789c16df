"""The table of faults on the graph, for a person."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from dev.planted_faults.live import MOST_TIMES, WITHIN_S, Outcome

_HEAD = ("fault", "shown", "named", "by", "notice", "green", "error", "")


def live_table(found: Sequence[Outcome]) -> str:
    """Return a row of Markdown for each outcome, and two lines that sum them up."""
    rows = [_HEAD, ("---",) * len(_HEAD), *(_row(one) for one in found)]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    faulty = [one for one in found if one.fault.names]
    named = sum(one.in_time for one in faulty)
    lying = [one.fault.name for one in faulty if one.lies]
    lines += [
        "",
        f"{named} of {len(faulty)} named within {WITHIN_S:g} s of when the data show them",
        f"green later than that, and beyond {MOST_TIMES:g} ellipses: {', '.join(lying) or 'none'}",
    ]
    return "\n".join(lines) + "\n"


def _row(one: Outcome) -> Iterable[str]:
    if one.refused:
        return one.fault.name, "", "yes" if one.in_time else "NO", "", "", "", "", one.refused
    named = one.named
    words = named.text if named else ""
    others = f" (also {', '.join(one.others)})" if one.others else ""
    until = f" to {one.wrong_until_s:.1f} s" if one.lies else ""
    return (
        one.fault.name,
        _seconds(one.shown_s),
        _seconds(named.at_s) if named else ("" if one.is_quiet and not one.fault.names else "NO"),
        named.node if named else "",
        _seconds(one.notice_s),
        str(one.green),
        "" if math.isnan(one.times) else f"{one.times:.1f}{until}",
        words + others,
    )


def _seconds(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.1f} s"
