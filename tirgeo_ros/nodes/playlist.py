"""Choose which topics of a bag are played and under which names, and wait for subscribers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence

from rclpy.node import Node
from rclpy.publisher import Publisher

from tirgeo_ros.core.types.errors import BagError, ConfigError, shown
from tirgeo_ros.io.messages import DJI_TOPICS
from tirgeo_ros.io.messages.offered_qos import offered_qos
from tirgeo_ros.nodes.graph_node import message_class
from tirgeo_ros.nodes.qos import latched, output

_DEPTH = 100
_STEADY_S = 1.0
_POLL_S = 0.05
#: Topics that the running graph publishes itself; the recorded ones would conflict with them.
_OUTPUTS = (
    *("tirgeo/odometry", "tirgeo/fix", "tirgeo/origin", "tirgeo/camera_pose"),
    *("tirgeo/footprint", "tirgeo/path", "tirgeo/state", "tirgeo/findings", "tf", "tf_static"),
)
_OUTPUT_FOLDERS = ("tirgeo/overlay/", "tirgeo/locate/fix", "tirgeo/locate/point")
_INFRASTRUCTURE = ("clock", "rosout", "parameter_events", "diagnostics")


def publishers_for(
    node: Node, topics: Mapping[str, str], wanted: str, otherwise: Collection[str] = ()
) -> dict[str, Publisher]:
    """Return a publisher for each topic of a bag (name -> type) that is to be played.

    ``wanted`` names topics, separated by commas; empty = all that the graph does not publish
    itself. ``otherwise`` names topics of the bag that are played in another way. Topics are
    published with relative names, so the node's namespace applies. A type that is not installed is
    skipped with a warning. Raise BagError for a wanted topic that the bag lacks, or if there is
    nothing to play.
    """
    found = {}
    for topic in _chosen(topics, names(wanted)):
        if topic in otherwise:
            continue
        relative = topic.lstrip("/")
        offered = offered_qos(relative)
        qos = latched() if offered.latched else output(max(offered.depth, _DEPTH))
        try:
            found[topic] = node.create_publisher(message_class(topics[topic]), relative, qos)
        except ConfigError as error:
            node.get_logger().warning(shown(f"{topic} is not played: {error}"))
    if not found and not otherwise:
        raise BagError(f"the bag has no topic to play (it has: {', '.join(topics) or 'none'})")
    return found


def aircraft_topics(topics: Mapping[str, str], wanted: str) -> dict[str, str]:
    """Return what a DJI aircraft sends of a bag's topics that are to be played: name -> type.

    Raise BagError if there is none.
    """
    chosen = _chosen(topics, names(wanted))
    found = {topic: topics[topic] for topic in chosen if topic.lstrip("/") in DJI_TOPICS}
    if not found:
        raise BagError(f"the bag has none of the aircraft's topics: {', '.join(DJI_TOPICS)}")
    return found


def names(listed: str) -> list[str]:
    """Return the relative names in a list separated by commas."""
    return [name.strip().lstrip("/") for name in listed.split(",") if name.strip()]


def _chosen(topics: Mapping[str, str], wanted: Sequence[str]) -> list[str]:
    if not wanted:
        return [topic for topic in topics if not _made_by_graph(topic.lstrip("/"))]
    by_name = {topic.lstrip("/"): topic for topic in topics}
    absent = [name for name in wanted if name not in by_name]
    if absent:
        raise BagError(f"the bag has no {', '.join(absent)} (it has: {', '.join(topics)})")
    return [by_name[name] for name in wanted]


def _made_by_graph(name: str) -> bool:
    # A bag recorded in a namespace has the namespace as a prefix of each name.
    own = name[name.find("tirgeo/") :] if "tirgeo/" in name else name
    return own in _OUTPUTS or own.startswith(_OUTPUT_FOLDERS) or name in _INFRASTRUCTURE


def await_readers(
    node: Node,
    publishers: Collection[Publisher],
    awaited: str,
    timeout_s: float,
    stop: threading.Event,
    attend: Callable[[], str] = lambda: "",
) -> str:
    """Wait until the awaited subscribers are there and none came or went for a second.

    ``awaited`` names topics that need a subscriber, separated by commas; empty = any. ``attend``
    is called repeatedly and returns what else is missing. Return what is missing after
    ``timeout_s``, else an empty text, also when ``stop`` is set. Raise ConfigError for an awaited
    topic that is not played.
    """
    wanted = {node.resolve_topic_name(name) for name in names(awaited)}
    unknown = wanted - {publisher.topic_name for publisher in publishers}
    if unknown:
        raise ConfigError(f"parameter wait_for: {', '.join(sorted(unknown))} is not played")
    begin = changed = time.monotonic()
    counts: dict[str, int] = {}
    while not stop.wait(_POLL_S):
        now = time.monotonic()
        before, counts = counts, {p.topic_name: p.get_subscription_count() for p in publishers}
        changed = now if counts != before else changed
        absent = ", ".join(sorted(name for name in wanted if not counts[name]))
        missing = attend() or (f"a subscriber of {absent}" if absent else "")
        heard = any(counts.values()) or not counts
        if heard and not missing and now - changed >= _STEADY_S:
            return ""
        if now - begin >= timeout_s:
            return missing or "any steady subscriber"
    return ""
