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
"""Define the finding of a check, and build the one-line verdict on whether to fly."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

#: First words of the verdict on a flight whose outputs are wrong.
NO_GO = "NO GO"


class Severity(IntEnum):
    """Rank how serious a finding is."""

    NOTE = 0  # for information; nothing is wrong
    CAUTION = 1  # the error of the drawn map may exceed its 95 % ellipses
    STOP = 2  # the map is drawn in a wrong place, or cannot be drawn


@dataclass(frozen=True, slots=True)
class Finding:
    """Hold one fault that a check has found.

    ``evidence`` gives the measured numbers and the expected ones. ``parameter`` names what to
    look at: a node's parameter (``gimbal_node boresight_rpy_deg``), a topic (``rtk/fix``) or an
    argument (``--map``). ``mend`` says what to do, as a sentence without a full stop.
    """

    check: str  # the check's name in snake case: the key in diagnostics and JSON
    severity: Severity
    evidence: str
    parameter: str
    mend: str

    @property
    def line(self) -> str:
        """Return ``evidence: parameter: mend`` as one line."""
        return f"{self.evidence}: {self.parameter}: {self.mend}"


def sorted_findings(findings: Iterable[Finding]) -> list[Finding]:
    """Return one finding for each check, sorted by severity, the worst first.

    Of several findings of one check the most severe is kept, the first of equals. Findings of
    equal severity keep the order in which their checks first appear.
    """
    worst: dict[str, Finding] = {}
    for finding in findings:
        before = worst.get(finding.check)
        if before is None or before.severity < finding.severity:
            worst[finding.check] = finding
    return sorted(worst.values(), key=lambda finding: -finding.severity)


def stop_line(findings: Sequence[Finding]) -> str | None:
    """Return ``NO GO: ...`` if a finding is a STOP, else None. Commands exit with 1 after it."""
    stopped = any(finding.severity is Severity.STOP for finding in findings)
    return verdict_line(findings) if stopped else None


def verdict_line(findings: Sequence[Finding]) -> str:
    """Return ``GO``, ``CAUTION: ...`` or ``NO GO: ...`` with the worst finding's evidence.

    The line also has that finding's parameter and the number of the other findings. Notes do not
    count.
    """
    worst = [finding for finding in sorted_findings(findings) if finding.severity]
    if not worst:
        return "GO"
    lead = NO_GO if worst[0].severity is Severity.STOP else "CAUTION"
    more = f" (and {len(worst) - 1} more)" if len(worst) > 1 else ""
    return f"{lead}: {worst[0].evidence}: {worst[0].parameter}{more}"
