"""Watch the graph around a node: other publishers of its topics, nodes that were started again."""

from __future__ import annotations

import time
from collections import Counter, defaultdict

from rclpy.node import Node

from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io.messages import DJI_TOPICS, NodeState

_OUTPUTS = ("tirgeo/odometry", "tirgeo/camera_pose", "tirgeo/overlay/image")
_SENSORS = (*DJI_TOPICS, "thermal/image_raw", "thermal/image_raw/compressed")
_REMEDY = "end the other graph or driver (dji:=false), or give it another ROS_DOMAIN_ID"
#: DDS lists a killed node's publishers until its lease ends, by default 20 s later.
_GHOST_REPORTS = 25
#: A new start, or a gap of the IMU, is a caution for so long, then a note.
RECENT_S = 60.0
#: What rmw says of a publisher whose node has not been discovered yet.
_NOT_YET = "_NODE_NAME_UNKNOWN_"
_MOST = 1000  # starts of a node that are counted
_NODES = ("dji_node", "ekf_node", "gimbal_node", "overlay_node")


class OtherPublishers:
    """Find topics with several publishers: a node's outputs, and the sensors that it reads."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._doubled: Counter[str] = Counter()  # reports in a row, by topic
        self._reports = 0

    def findings(self) -> list[Finding]:
        """Return a finding for each such topic; call it once a second."""
        self._reports += 1
        outputs = {one.topic_name for one in self._node.publishers}
        inputs = {one.topic_name for one in self._node.subscriptions}
        own = outputs & set(map(self._node.resolve_topic_name, _OUTPUTS))
        read = inputs & set(map(self._node.resolve_topic_name, _SENSORS))
        # Late in this node's life no publisher beside its own can be its killed predecessor's.
        found = [self._several(t, Severity.STOP, self._reports) for t in sorted(own)]
        for topic in sorted(read):
            several = self._node.count_publishers(topic) > 1
            self._doubled[topic] = self._doubled[topic] + 1 if several else 0
            found.append(self._several(topic, Severity.CAUTION, self._doubled[topic]))
        return [finding for finding in found if finding]

    def _several(self, topic: str, severity: Severity, reports: int) -> Finding | None:
        infos = self._node.get_publishers_info_by_topic(topic) if reports > _GHOST_REPORTS else ()
        infos = [one for one in infos if one.node_name != _NOT_YET]
        if len(infos) < 2:
            return None
        names = sorted(f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in infos)
        evidence = f"{topic} has {len(names)} publishers: {', '.join(names)}"
        check = f"publishers_of{topic.replace('/', '_')}"
        return Finding(check, severity, evidence, topic.lstrip("/"), _REMEDY)


class Restarts:
    """Count how often the nodes of one graph were started again, by their states."""

    def __init__(self) -> None:
        #: Steady time at which each start of a node was first heard of.
        self.starts: defaultdict[str, dict[int, float]] = defaultdict(dict)

    def take(self, state: NodeState) -> None:
        """Take a node's state, which says when it started."""
        starts = self.starts[state.name] if state.name in _NODES else {}
        if len(starts) < _MOST:
            starts.setdefault(state.started_ns, time.monotonic())

    def findings(self) -> list[Finding]:
        """Return one finding for each node that was started again."""
        found = []
        for node, starts in sorted(self.starts.items()):
            recent = time.monotonic() - max(starts.values(), default=0.0) < RECENT_S
            severity = Severity.CAUTION if recent else Severity.NOTE
            evidence = f"{node} ended and was started again; restarts so far: {len(starts) - 1}"
            if len(starts) > 1:
                mend = "its log says why it ended"
                found.append(Finding(f"restarts_of_{node}", severity, evidence, node, mend))
        return found
