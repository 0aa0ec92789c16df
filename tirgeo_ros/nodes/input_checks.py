"""Check that the topics a node needs are published and have the right type."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node

from tirgeo_ros.core.checks.recording_checks import RecordedTopics, needed_findings
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.nodes.monitor import Monitor

#: The checks run once a second: nodes discover each other within 4 s (at the start of a graph).
_PATIENCE = 5


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
        return [one for one in found if _is_type(one) or self._waited > _PATIENCE]

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


def _is_type(finding: Finding) -> bool:
    return finding.check.startswith("type_of_")


class Known:
    """Report findings that are known from the start, once any message has come."""

    def __init__(self, monitor: Monitor, found: Sequence[Finding]) -> None:
        self._monitor, self._found = monitor, found

    def findings(self) -> Sequence[Finding]:
        """Return the findings, or none before the first message."""
        return self._found if self._monitor.heard else ()
