"""Publish the aircraft's track."""

from __future__ import annotations

from tirgeo_ros.core.navigation.track import Track
from tirgeo_ros.core.streams.rates import RateLimit
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.qos import output

_RATE_HZ = 1.0


class TrackOutput:
    """Collect the track and publish it on ``tirgeo/path`` once a second, while someone listens."""

    def __init__(self, node: GraphNode) -> None:
        self._messages = node.messages
        self._track = Track(node.messages.track_point)
        self._rate = RateLimit(_RATE_HZ)
        self._path = node.advertise("tirgeo/path", output())

    def begin(self) -> None:
        """Begin a new track, in a new plane."""
        self._track.clear()

    def add(self, body: BodyPose) -> None:
        """Add a pose of the aircraft, and publish the track if it is due."""
        self._track.add(body)
        if self._rate.due(body.stamp_ns) and self._path.get_subscription_count():
            self._path.publish(self._messages.path(body.stamp_ns, self._track.points()))
