"""Run a node's checks of its set-up: findings to the diagnostics, go or no go to the log.

The topics that a node needs must be published and have the right type.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tirgeo_ros.core.checks.input_checks import RecordedTopics, needed_findings
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings, verdict_line
from tirgeo_ros.io.messages import TOPIC_TYPES, DiagnosticItem
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.qos import output

SUBJECT = "set-up"
#: Reports (one per second) for which a finding that is gone stays, so that a person can read it.
_HELD = 10
#: The set-up is logged as good after this many reports with data and nothing worse than a note.
_SETTLED = 10
#: Reports to wait for a topic: nodes discover each other within 4 s (at the start of a graph).
_PATIENCE = 5


class SetupChecks:
    """Run a node's checks once per report; a fault in a check does not stop the node.

    Each of ``checks``, those of ``core.checks``, has the findings from all data so far; those
    that are ``known`` from the start count once any message has come.

    The item ``NODE: set-up`` has the worst finding's severity as its level, and the verdict as its
    message. Its values are all findings: the check's name -> severity and line. Programs read
    them in ``tirgeo/findings``, part by part.
    """

    def __init__(self, node: GraphNode, *checks: Any, known: Sequence[Finding] = ()) -> None:
        self._node = node
        self._checks, self._known = checks, known
        self._findings = node.advertise("tirgeo/findings", output())
        # With the number of reports since it was last found.
        self._recent: dict[str, tuple[Finding, int]] = {}
        self._logged: Severity | None = None
        self._quiet = 0  # reports with data and without a finding
        #: ``take(checks.pose, pose)`` passes new data to a check.
        self.take = node.guarded(SUBJECT, lambda check, *data: check(*data))
        self._renew = node.guarded(SUBJECT, self._ask)

    def item(self) -> DiagnosticItem:
        """Return the item for diagnostics; publish the findings, log a change of the verdict."""
        self._renew()
        found = sorted_findings(finding for finding, _ in self._recent.values())
        worst = found[0].severity if found else Severity.NOTE
        verdict = shown(verdict_line(found))
        self._quiet += bool(self._node.monitor.heard() and worst is Severity.NOTE)
        known = worst is not Severity.NOTE or self._logged is not None or self._quiet >= _SETTLED
        if known and worst is not self._logged:
            self._logged = worst
            self._node.log(worst, f"{SUBJECT}: {verdict}")
        name, now_ns = self._node.get_fully_qualified_name(), self._node.now_ns
        self._findings.publish(self._node.messages.findings(name, now_ns, found))
        values = {one.check: shown(f"{one.severity.name}: {one.line}") for one in found}
        return self._node.item(SUBJECT, values, verdict, int(worst))

    def _ask(self) -> None:
        found = {one.check: one for one in (self._known if self._node.monitor.heard() else ())}
        found |= {one.check: one for check in self._checks for one in check.findings()}
        absent = {
            name: (finding, reports + 1)
            for name, (finding, reports) in self._recent.items()
            if name not in found and reports < _HELD
        }
        self._recent = absent | {name: (finding, 0) for name, finding in found.items()}


class InputChecks:
    """Ask the graph who publishes the topics that a node has not heard, once other messages come.

    ``needed``: groups of topics of the contract; one topic of a group is enough.
    """

    def __init__(self, node: GraphNode, *needed: Sequence[str]) -> None:
        self._node, self._needed = node, needed
        self._waited = 0  # calls of findings() since anything came

    def findings(self) -> list[Finding]:
        """Return findings: for a wrong type at once, for topics nobody publishes after a while."""
        heard = self._node.monitor.heard()
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
            kinds = {info.topic_type for info in node.get_publishers_info_by_topic(topic)}
            if kinds:
                types[graph.name(topic)] = wanted if wanted in kinds else min(kinds)
        return graph
