"""Convert findings to JSON items and to lines for people."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict

from tirgeo_ros.core.types.finding import Finding, Severity

_NAMES = {Severity.STOP: "fault", Severity.CAUTION: "caution", Severity.NOTE: "note"}


def finding_items(findings: Iterable[Finding]) -> list[dict[str, object]]:
    """Return findings as items for JSON."""
    return [asdict(one) | {"severity": one.severity.name.lower()} for one in findings]


def finding_lines(items: Iterable[Mapping[str, object]]) -> list[str]:
    """Return a line for each item that is worse than a note."""
    return [
        f"{str(one['severity']).upper()}: {one['evidence']}: {one['parameter']}: {one['mend']}"
        for one in items
        if one["severity"] != "note"
    ]


def tally_line(findings: Sequence[Finding]) -> str:
    """Return ``GO``, or ``NO GO`` and the numbers of faults and cautions."""
    lead = "NO GO" if any(one.severity is Severity.STOP for one in findings) else "GO"
    counts = [
        f"{number} {name}{'s' if number > 1 else ''}"
        for severity, name in _NAMES.items()
        if (number := sum(one.severity is severity for one in findings))
    ]
    return f"{lead}: {', '.join(counts)}" if counts else lead


def report(items: Sequence[Mapping[str, object]]) -> str:
    """Return three short lines for each finding: evidence, parameter, remedy."""
    blocks = [
        f"{str(one['severity']).upper():<8} {one['evidence']}\n"
        f"{'':<8} look at  {one['parameter']}\n"
        f"{'':<8} to mend  {one['mend']}"
        for one in items
    ]
    return "\n\n".join(blocks)
