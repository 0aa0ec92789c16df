"""A node's checks of its set-up: what they find in diagnostics, and go or no go in the log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from rclpy.node import Node

from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings, verdict_line
from tirgeo_ros.core.types.quoted_text import shown
from tirgeo_ros.io.messages import DiagnosticItem
from tirgeo_ros.nodes.callbacks import guarded
from tirgeo_ros.nodes.diagnostics import item_name
from tirgeo_ros.nodes.monitor import ERROR, OK, WARN, Monitor

SUBJECT = "set-up"
LEVELS = {Severity.NOTE: OK, Severity.CAUTION: WARN, Severity.STOP: ERROR}
#: What is no longer found stays for so many reports, a second each: a person is to read it.
_HELD = 10
#: All is well once nothing was found in so many reports with data.
_SETTLED = 10


class Checks(Protocol):
    """What ``core.checks`` has for a node."""

    def findings(self) -> Sequence[Finding]:
        """Return what is wrong by all that came."""


class SetupChecks:
    """Asks a node's checks once a report; a fault in one of them leaves the node as it is.

    The item ``NODE: set-up`` has the worst finding's level and the verdict; its values are all
    findings, each under its check's name, its severity before it.
    """

    def __init__(self, node: Node, monitor: Monitor, *checks: Checks) -> None:
        self._name = item_name(node, SUBJECT)
        self._logger = node.get_logger()
        self._monitor = monitor
        self._checks = checks
        self._held: dict[str, tuple[Finding, int]] = {}  # and for how many reports it is absent
        self._told: Severity | None = None
        self._quiet = 0  # reports without a finding
        #: ``take(checks.pose, pose)`` calls a check with what came.
        self.take: Callable[..., bool] = guarded(node, monitor, SUBJECT, _call)
        self._renew = guarded(node, monitor, SUBJECT, self._ask)

    def item(self) -> DiagnosticItem:
        """Return the item for diagnostics; a change of go or no go is logged."""
        self._renew()
        found = sorted_findings(finding for finding, _ in self._held.values())
        worst = found[0].severity if found else Severity.NOTE
        verdict = shown(verdict_line(found))
        self._tell(worst, verdict)
        return DiagnosticItem(
            self._name,
            LEVELS[worst],
            verdict,
            {one.check: shown(f"{one.severity.name}: {one.line}") for one in found},
        )

    def _ask(self) -> None:
        found = {one.check: one for check in self._checks for one in check.findings()}
        absent = {
            name: (finding, reports + 1)
            for name, (finding, reports) in self._held.items()
            if name not in found and reports < _HELD
        }
        self._held = absent | {name: (finding, 0) for name, finding in found.items()}

    def _tell(self, worst: Severity, verdict: str) -> None:
        if worst is Severity.NOTE and self._told is None:
            self._quiet += self._monitor.heard
            if self._quiet < _SETTLED:
                return
        if worst is self._told:
            return
        self._told, line = worst, f"{SUBJECT}: {verdict}"
        # Three lines of code: rclpy raises where one line logs with two severities.
        if worst is Severity.STOP:
            self._logger.error(line)
        elif worst is Severity.CAUTION:
            self._logger.warning(line)
        else:
            self._logger.info(line)


def _call(check: Callable[..., None], *arguments: Any) -> None:
    check(*arguments)
