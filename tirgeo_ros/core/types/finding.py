"""What a check has found, and the one line that says whether to fly."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum


class Severity(IntEnum):
    """How bad a finding is."""

    NOTE = 0  # worth knowing; nothing is wrong
    CAUTION = 1  # the map may be off by more than its ellipses say
    STOP = 2  # the map is wrong, or there will be none


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong.

    ``evidence`` has the numbers that show it and what they should be. ``parameter`` is what to
    look at: a node's parameter (``gimbal_node boresight_rpy_deg``), a topic (``rtk/fix``) or an
    argument (``--map``). ``mend`` says what to do, as a sentence without a full stop.
    """

    check: str  # its name, words with underscores: the key in diagnostics and JSON
    severity: Severity
    evidence: str
    parameter: str
    mend: str

    @property
    def line(self) -> str:
        """Evidence, parameter and mend in one line."""
        return f"{self.evidence}: {self.parameter}: {self.mend}"


def sorted_findings(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings, the worst first and each check's name once, in their order else."""
    kept: dict[str, Finding] = {}
    for finding in findings:
        before = kept.get(finding.check)
        if before is None or before.severity < finding.severity:
            kept[finding.check] = finding
    return sorted(kept.values(), key=lambda finding: -finding.severity)


def verdict_line(findings: Sequence[Finding]) -> str:
    """Return ``GO``, ``CAUTION: ...`` or ``NO GO: ...`` with the worst finding's evidence."""
    worst = [finding for finding in sorted_findings(findings) if finding.severity]
    if not worst:
        return "GO"
    lead = "NO GO" if worst[0].severity is Severity.STOP else "CAUTION"
    more = f" (and {len(worst) - 1} more)" if len(worst) > 1 else ""
    return f"{lead}: {worst[0].evidence}: {worst[0].parameter}{more}"
