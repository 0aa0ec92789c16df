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
"""Run a node's checks of its set-up and of the graph around it, for its reports and its log.

The topics that a node needs must be published, by one publisher and with the right type. Nodes
that were started again are counted.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.checks.input_checks import RecordedTopics, needed_findings
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings, verdict_line
from tirgeo_ros.io.messages import DJI_TOPICS, TOPIC_TYPES, DiagnosticItem, NodeState
from tirgeo_ros.nodes.graph_node import GraphNode

_OUTPUTS = ("tirgeo/odometry", "tirgeo/camera_pose", "tirgeo/overlay/image")
_SENSORS = (*DJI_TOPICS, "thermal/image_raw", "thermal/image_raw/compressed")
#: Reports without a finding: DDS lists a killed node's publishers for its lease, 20 s by default.
_GHOST_REPORTS = 25
#: A new start, or a gap of the IMU, is a caution for so long, then a note.
RECENT_S = 60.0
#: The name that rmw gives to the node of a publisher that is not discovered yet.
_UNDISCOVERED = "_NODE_NAME_UNKNOWN_"
_MOST_STARTS = 1000  # of one node, that are counted
_NODES = ("dji_node", "ekf_node", "gimbal_node", "overlay_node")
SUBJECT = "set-up"
#: Reports (one per second) for which a finding that is gone stays, so that a person can read it.
_KEPT_REPORTS = 10
#: The set-up is logged as good after this many reports with data and nothing worse than a note.
_SETTLED = 10
#: Reports to wait for a topic: nodes discover each other within 4 s (at the start of a graph).
_PATIENCE = 5
#: Data that the checks take at once: one alone finds the processor's caches cold.
_TOGETHER = 10


class OtherPublishers:
    """Find topics with several publishers: a node's outputs, and the sensors that it reads."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._doubled: Counter[str] = Counter()  # reports in a row, by topic
        self._reports = 0

    def findings(self) -> list[Finding]:
        """Return a finding for each such topic; call it once a second."""
        self._reports += 1
        node = self._node
        outputs = {endpoint.topic_name for endpoint in node.publishers}
        inputs = {endpoint.topic_name for endpoint in node.subscriptions}
        own = outputs & set(map(node.resolve_topic_name, _OUTPUTS))
        read = inputs & set(map(node.resolve_topic_name, _SENSORS))
        for topic in read:
            doubled = node.count_publishers(topic) > 1
            self._doubled[topic] = self._doubled[topic] + 1 if doubled else 0
        # After so many reports, another publisher of an output is not this node's predecessor.
        suspects = [(topic, "output", self._reports) for topic in sorted(own)]
        suspects += [(topic, "", self._doubled[topic]) for topic in sorted(read)]
        findings = []
        for topic, case, reports in suspects:
            infos = node.get_publishers_info_by_topic(topic) if reports > _GHOST_REPORTS else ()
            names = sorted(
                f"{info.node_namespace.rstrip('/')}/{info.node_name}"
                for info in infos
                if info.node_name != _UNDISCOVERED
            )
            if len(names) > 1:
                texts = {"topic": topic, "name": topic.lstrip("/"), "names": ", ".join(names)}
                findings.append(finding("publishers_of{topic}", case, **texts, number=len(names)))
        return findings


class Restarts:
    """Count how often the nodes of one graph were started again, by the states they report."""

    def __init__(self) -> None:
        #: Node -> start time (ns) -> steady time (s) of the first state that names it.
        self.starts: defaultdict[str, dict[int, float]] = defaultdict(dict)

    def take(self, state: NodeState) -> None:
        """Take a node's state, which says when it started."""
        starts = self.starts[state.name] if state.name in _NODES else {}
        if len(starts) < _MOST_STARTS:
            starts.setdefault(state.started_ns, time.monotonic())

    def findings(self) -> list[Finding]:
        """Return one finding for each node that was started again."""
        findings = []
        for node, starts in sorted(self.starts.items()):
            again = len(starts) - 1
            if again > 0:
                case = "recent" if time.monotonic() - max(starts.values()) < RECENT_S else ""
                findings.append(finding("restarts_of_{topic}", case, topic=node, number=again))
        return findings


class SetupChecks:
    """Run a node's checks once per report; a fault in a check does not stop the node.

    ``checks`` are classes of ``core.checks``, whose ``findings()`` are those of all data so far.
    The findings ``at_start`` count as soon as any message has come.

    The item ``NODE: set-up`` has the worst finding's severity as its level, and the verdict as its
    message. Its values are all findings: the check's name -> severity and line. Programs read
    ``findings``, which the node publishes as ``tirgeo/findings``.
    """

    def __init__(self, node: GraphNode, *checks: Any, at_start: Sequence[Finding] = ()) -> None:
        self._node = node
        self._checks, self._at_start = checks, at_start
        # Check -> its finding, and the number of reports since the check last returned it.
        self._recent: dict[str, tuple[Finding, int]] = {}
        self._logged: Severity | None = None
        self._quiet = 0  # reports with data and nothing worse than a note
        self._waiting: list[tuple[Callable[..., object], tuple[Any, ...]]] = []
        self._pass = node.guarded(SUBJECT, lambda check, *data: check(*data))
        self._renew = node.guarded(SUBJECT, self._ask)

    def take(self, check: Callable[..., object], *data: Any) -> None:
        """Pass new data to a check, with the next data of others or before the next report.

        It is passed on after what the node does now: some checks take 5 ms once a second.
        """
        self._waiting.append((check, data))
        if len(self._waiting) % _TOGETHER == 0:
            if self._node.executor is None:
                self._pass_on()
            else:
                self._node.executor.create_task(self._pass_on)

    def _pass_on(self) -> None:
        waiting, self._waiting = self._waiting, []
        for check, data in waiting:
            self._pass(check, *data)

    def findings(self) -> list[Finding]:
        """Return the findings of the last ``report``, the worst first."""
        return sorted_findings(each for each, _ in self._recent.values())

    def report(self) -> DiagnosticItem:
        """Ask the checks, log a change of the verdict, and return the item for diagnostics."""
        self._pass_on()
        self._renew()
        findings = self.findings()
        worst = findings[0].severity if findings else Severity.NOTE
        verdict = shown(verdict_line(findings))
        self._quiet += bool(self._node.monitor.received_topics() and worst is Severity.NOTE)
        decided = worst is not Severity.NOTE or self._logged is not None or self._quiet >= _SETTLED
        if decided and worst is not self._logged:
            self._logged = worst
            self._node.log(worst, f"{SUBJECT}: {verdict}")
        values = {each.check: shown(f"{each.severity.name}: {each.line}") for each in findings}
        return self._node.item(SUBJECT, values, verdict, int(worst))

    def _ask(self) -> None:
        at_start = self._at_start if self._node.monitor.received_topics() else ()
        newest = [*at_start]
        for check in self._checks:
            newest += check.findings()
            self._node.pause()
        recent = {each.check: (each, 0) for each in newest}
        absent = {
            name: (each, reports + 1)
            for name, (each, reports) in self._recent.items()
            if name not in recent and reports < _KEPT_REPORTS
        }
        self._recent = absent | recent


class InputChecks:
    """Find needed topics that nobody publishes, or with a wrong type, once other topics come.

    ``needed``: groups of topics of the contract; one topic of a group is enough.
    """

    def __init__(self, node: GraphNode, *needed: Sequence[str]) -> None:
        self._node, self._needed = node, needed
        self._waited = 0  # calls of findings() since the first message

    def findings(self) -> list[Finding]:
        """Return findings: of a wrong type at once, of topics that nobody publishes later."""
        received = self._node.monitor.received_topics()
        missing = [topics for topics in self._needed if not received.intersection(topics)]
        if not missing:
            return []
        self._waited += any(not topic.startswith("/") for topic in received)
        findings = needed_findings(self._graph(missing), missing)
        if self._waited > _PATIENCE:
            return findings
        return [each for each in findings if each.check.startswith("type_of_")]

    def _graph(self, missing: Sequence[Sequence[str]]) -> RecordedTopics:
        node = self._node
        contract = {topic: TOPIC_TYPES[topic] for topics in missing for topic in topics}
        names = node.get_topic_names_and_types()
        types = {name: kinds[0] for name, kinds in names if node.count_publishers(name)}
        graph = RecordedTopics(types, contract, node.get_namespace(), live=True)
        # The list above also contains the type of the node's own subscription.
        for topic, wanted in contract.items():
            kinds = {info.topic_type for info in node.get_publishers_info_by_topic(topic)}
            if kinds:
                types[graph.name(topic)] = wanted if wanted in kinds else min(kinds)
        return graph
