"""Run a node's checks of its set-up: findings to the diagnostics, go or no go to the log.

The topics that a node needs must be published and have the right type.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node

from tirgeo_ros.core.checks.recording_checks import RecordedTopics, needed_findings
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings, verdict_line
from tirgeo_ros.io.messages import TOPIC_TYPES, DiagnosticItem
from tirgeo_ros.nodes.callbacks import guarded
from tirgeo_ros.nodes.diagnostics import item_name
from tirgeo_ros.nodes.monitor import ERROR, OK, WARN, Monitor

SUBJECT = "set-up"
LEVELS = {Severity.NOTE: OK, Severity.CAUTION: WARN, Severity.STOP: ERROR}
#: A finding that is gone stays for this many reports, one per second, so that a person can read
#: it.
_HELD = 10
#: The set-up is logged as good after this many reports with data and nothing worse than a note.
_SETTLED = 10
#: The checks run once a second: nodes discover each other within 4 s (at the start of a graph).
_PATIENCE = 5


class SetupChecks:
    """Run a node's checks once per report; a fault in a check does not stop the node.

    Each of ``checks``, those of ``core.checks``, has the findings from all data so far; those
    that are ``known`` from the start count once any message has come.

    The item ``NODE: set-up`` has the worst finding's level, and the verdict as its message. Its
    values are all findings: the check's name -> severity and line.
    """

    def __init__(
        self, node: Node, monitor: Monitor, *checks: Any, known: Sequence[Finding] = ()
    ) -> None:
        self._name = item_name(node, SUBJECT)
        self._logger = node.get_logger()
        self._monitor = monitor
        self._checks, self._known = checks, known
        # With the number of reports since it was last found.
        self._recent: dict[str, tuple[Finding, int]] = {}
        self._logged: Severity | None = None
        self._quiet = 0  # reports without a finding
        #: ``take(checks.pose, pose)`` passes new data to a check.
        self.take: Callable[..., bool] = guarded(
            node, monitor, SUBJECT, lambda check, *data: check(*data)
        )
        self._renew = guarded(node, monitor, SUBJECT, self._ask)

    def item(self) -> DiagnosticItem:
        """Return the item for diagnostics; log a change of the verdict."""
        self._renew()
        found = sorted_findings(finding for finding, _ in self._recent.values())
        worst = found[0].severity if found else Severity.NOTE
        verdict = shown(verdict_line(found))
        self._log_verdict(worst, verdict)
        return DiagnosticItem(
            self._name,
            LEVELS[worst],
            verdict,
            {one.check: shown(f"{one.severity.name}: {one.line}") for one in found},
        )

    def _ask(self) -> None:
        known = self._known if self._monitor.heard else ()
        found = {one.check: one for one in known}
        found |= {one.check: one for check in self._checks for one in check.findings()}
        absent = {
            name: (finding, reports + 1)
            for name, (finding, reports) in self._recent.items()
            if name not in found and reports < _HELD
        }
        self._recent = absent | {name: (finding, 0) for name, finding in found.items()}

    def _log_verdict(self, worst: Severity, verdict: str) -> None:
        if worst is Severity.NOTE and self._logged is None:
            self._quiet += self._monitor.heard
            if self._quiet < _SETTLED:
                return
        if worst is self._logged:
            return
        self._logged, line = worst, f"{SUBJECT}: {verdict}"
        # Three separate calls: rclpy raises if one line of code logs with two severities.
        if worst is Severity.STOP:
            self._logger.error(line)
        elif worst is Severity.CAUTION:
            self._logger.warning(line)
        else:
            self._logger.info(line)


class InputChecks:
    """Ask the graph who publishes the topics that a node has not heard, once other messages come.

    ``needed``: groups of topics of the contract; one topic of a group is enough.
    """

    def __init__(self, node: Node, monitor: Monitor, *needed: Sequence[str]) -> None:
        self._node, self._monitor = node, monitor
        self._needed = needed
        self._waited = 0  # calls of findings() since anything came

    def findings(self) -> list[Finding]:
        """Return findings: for a wrong type at once, for topics nobody publishes after a while."""
        heard = self._monitor.heard_of()
        missed = [topics for topics in self._needed if not heard.intersection(topics)]
        if not missed:
            return []
        self._waited += any(not topic.startswith("/") for topic in heard)
        found = needed_findings(self._graph(missed), missed)
        if self._waited > _PATIENCE:
            return found
        return [one for one in found if one.check.startswith("type_of_")]

    def _graph(self, missed: Sequence[Sequence[str]]) -> RecordedTopics:
        node = self._node
        contract = {topic: TOPIC_TYPES[topic] for topics in missed for topic in topics}
        names = node.get_topic_names_and_types()
        types = {name: kinds[0] for name, kinds in names if node.count_publishers(name)}
        graph = RecordedTopics(types, contract, node.get_namespace(), live=True)
        # The list above also contains the type of the node's own subscription.
        for topic, wanted in contract.items():
            infos = node.get_publishers_info_by_topic(topic)
            kinds = {info.topic_type for info in infos}
            types.pop(graph.name(topic), None)
            if kinds:
                types[graph.name(topic)] = wanted if wanted in kinds else min(kinds)
        return graph
