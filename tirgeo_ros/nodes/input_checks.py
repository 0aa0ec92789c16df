"""Whether what a node needs is there, and of its type: else nothing comes, and nobody says why."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node

from tirgeo_ros.core.checks.recording_checks import Recording, needed_findings
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.nodes.monitor import Monitor

#: Findings are asked for once a second: nodes find each other within 4 s (the start of a graph).
_PATIENCE = 5


class InputChecks:
    """Asks the graph who publishes what a node has not heard, once other messages come to it.

    ``needed``: topics of the contract; of several in a group, one will do.
    """

    def __init__(self, node: Node, monitor: Monitor, *needed: Sequence[str]) -> None:
        self._node, self._monitor = node, monitor
        self._needed = needed
        self._waited = 0  # findings since anything came

    def findings(self) -> list[Finding]:
        """Return topics of another type at once; those that nobody publishes after a while."""
        heard = self._monitor.heard_of()
        missed = [topics for topics in self._needed if not heard.intersection(topics)]
        if not missed:
            return []
        self._waited += any(not topic.startswith("/") for topic in heard)
        found = needed_findings(self._graph(missed), missed)
        return [one for one in found if _is_type(one) or self._waited > _PATIENCE]

    def _graph(self, missed: Sequence[Sequence[str]]) -> Recording:
        node = self._node
        contract = {topic: TOPIC_TYPES[topic] for topics in missed for topic in topics}
        names = node.get_topic_names_and_types()
        types = {name: kinds[0] for name, kinds in names if node.count_publishers(name)}
        graph = Recording(types, contract, node.get_namespace(), live=True)
        for topic, wanted in contract.items():  # of these the node's own type is there too
            infos = node.get_publishers_info_by_topic(topic)
            kinds = {info.topic_type for info in infos}
            types.pop(graph.name(topic), None)
            if kinds:
                types[graph.name(topic)] = wanted if wanted in kinds else min(kinds)
        return graph


def _is_type(finding: Finding) -> bool:
    return finding.check.startswith("type_of_")


class Known:
    """Findings that are known from the start, once anything comes."""

    def __init__(self, monitor: Monitor, found: Sequence[Finding]) -> None:
        self._monitor, self._found = monitor, found

    def findings(self) -> Sequence[Finding]:
        """Return them."""
        return self._found if self._monitor.heard else ()
