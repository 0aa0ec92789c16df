"""Give targets and aircraft to the team as Cursor-on-Target, once the page switches that on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, final

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.ground.frame_geometry import frame_geometry
from tirgeo_ros.core.ground.ground_point import circular_error_90, linear_error_90
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io.cot.events import AircraftState
from tirgeo_ros.io.messages import body_pose
from tirgeo_ros.nodes.aircraft_topics import ODOMETRY
from tirgeo_ros.nodes.aircraft_view import AircraftView, velocity_n
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.monitor import OK
from tirgeo_ros.page.cot.address import CotParameters
from tirgeo_ros.page.cot.link import CotLink

#: Of a position that is older, the team has heard already.
_NEW_S = 2.0


@final
class TeamLink:
    """Hold the link to the team, a context manager; without the parameter cot there is none.

    Raises ConfigError for parameters that cannot work.
    """

    def __init__(
        self, node: GraphNode, config: ViewerConfig, aircraft: Mapping[str, AircraftView]
    ) -> None:
        self._aircraft = aircraft
        self.link: CotLink | None = None
        self.findings: list[Finding] = []
        if config.cot:
            files = config.cot_certificate, config.cot_key, config.cot_ca
            given = CotParameters(config.cot, *files, config.cot_password)
            self.link = CotLink(given, partial(node.log, OK))

    def __enter__(self) -> TeamLink:
        """Begin; nothing is sent before the page says so."""
        if self.link is not None:
            self.link.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End the connection."""
        if self.link is not None:
            self.link.stop()

    def go_on(self) -> None:
        """Share as when the last run was killed; without a link a finding says that it ended."""
        if self.link is not None:
            self.link.share(True)
            return
        evidence = "sharing does not go on: it was on when viewer_node was killed; cot is not set"
        mend = "set it to where it sent to, and start again"
        self.findings = [Finding("sharing", Severity.CAUTION, evidence, "viewer_node cot", mend)]

    @property
    def state(self) -> dict[str, Any] | None:
        """Return what the page shows; None without a link."""
        if self.link is None:
            return None
        status = self.link.status
        told = {"on": status.on, "connected": status.connected, "queued": status.queued}
        return told | {"error": status.error}

    def targets(self, targets: Sequence[Target]) -> None:
        """Take the whole list of targets, at each change."""
        if self.link is not None:
            self.link.targets(targets)

    def send(self) -> None:
        """Take the aircraft as they are now; call each second."""
        if self.link is None or not self.link.status.on:
            return
        for name, one in self._aircraft.items():
            state = aircraft_state(name or "aircraft", one)
            if state is not None:
                self.link.aircraft(name, state)


def aircraft_state(name: str, aircraft: AircraftView) -> AircraftState | None:
    """Return what the team sees of an aircraft; None without a present position."""
    odometry, plane, age_s = aircraft.newest(ODOMETRY), aircraft.plane, aircraft.age_s(ODOMETRY)
    if odometry is None or plane is None or age_s is None or age_s > _NEW_S:
        return None
    pose, moving_n = body_pose(odometry), velocity_n(odometry)
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(pose.position_n))
    sight = aircraft.sight(aircraft.newest_ns)
    return AircraftState(
        name,
        math.degrees(latitude),
        math.degrees(longitude),
        height_m,
        circular_error_90(pose.covariance[:3, :3]),
        linear_error_90(pose.covariance[:3, :3]),
        math.degrees(math.atan2(moving_n[1], moving_n[0])) % 360,
        math.hypot(moving_n[0], moving_n[1]),
        frame_geometry(sight, aircraft.confidence) if sight else None,
    )
