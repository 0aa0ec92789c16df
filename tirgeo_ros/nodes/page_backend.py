"""Answer the operator's page by way of the graph, and give its targets and aircraft to the team.

The page asks for clicks, places, recordings and the map. The team gets Cursor-on-Target, once the
page switches that on.
"""

from __future__ import annotations

import asyncio
import math
import threading
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from typing import Any

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.ground.frame_geometry import frame_geometry
from tirgeo_ros.core.ground.ground_point import (
    Answer,
    Located,
    Refusal,
    circular_error_90,
    linear_error_90,
)
from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io.messages import body_pose
from tirgeo_ros.io.targets.cot_events import AircraftState
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.nodes.aircraft_topics import ODOMETRY
from tirgeo_ros.nodes.aircraft_view import AircraftView, velocity_n
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.map_watch import PageMap
from tirgeo_ros.nodes.monitor import OK
from tirgeo_ros.nodes.recordings import Recordings
from tirgeo_ros.page.backend import Click, Pixel
from tirgeo_ros.page.cot.address import CotParameters
from tirgeo_ros.page.cot.link import CotLink

#: Of a position that is older, the team has heard already.
_NEW_S = 2.0


class TeamLink:
    """Hold the link to the team; without the parameter cot there is none.

    Nothing is sent before the page says so. Raises ConfigError for parameters that cannot work.
    """

    def __init__(
        self, node: GraphNode, config: ViewerConfig, aircraft: Mapping[str, AircraftView]
    ) -> None:
        self._aircraft = aircraft
        self.link: CotLink | None = None
        self.findings: list[Finding] = []
        if config.cot:
            files = config.cot_certificate, config.cot_key, config.cot_ca
            parameters = CotParameters(config.cot, *files, config.cot_password)
            self.link = CotLink(parameters, partial(node.log, OK))

    def go_on(self) -> None:
        """Share again, as before the last run was killed; without a link, find that it ended."""
        if self.link is not None:
            self.link.share(True)
            return
        evidence = "sharing does not go on: it was on when viewer_node was killed; cot is not set"
        mend = "set it to where it sent to, and start again"
        self.findings = [Finding("sharing", Severity.CAUTION, evidence, "viewer_node cot", mend)]

    @property
    def state(self) -> dict[str, Any] | None:
        """Return what the page shows; None without a link."""
        return None if self.link is None else asdict(self.link.status)

    def send(self) -> None:
        """Take the aircraft as they are now; call each second."""
        if self.link is None or not self.link.status.on:
            return
        for name, view in self._aircraft.items():
            state = aircraft_state(name or "aircraft", view)
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


#: Within a second an answer comes, or a refusal. A click may be lost on its way, as overlay_node
#: takes clicks of any publisher, best effort: then it is sent once more.
_TRIES_S = (0.35, 0.65)

_Key = tuple[str, int, float, float]  # aircraft, stamp, column, row


class PageBackend:
    """Serve as the page's ``Backend``. The thread that hears the graph calls ``answered``."""

    def __init__(
        self,
        aircraft: Mapping[str, AircraftView],
        targets: TargetStore,
        page_map: PageMap,
        recordings: Recordings,
        cot: CotLink | None,
    ) -> None:
        self._aircraft, self._targets, self._map = aircraft, targets, page_map
        self._recordings, self._cot = recordings, cot
        self._lock = threading.Lock()
        self._asked: defaultdict[_Key, list[asyncio.Future[Answer]]] = defaultdict(list)

    @property
    def targets(self) -> TargetStore:
        """Return the store of targets."""
        return self._targets

    async def click(self, click: Click) -> Located | str:
        """Return the ground point at a pixel, or why there is none; within a second."""
        key = click.aircraft, click.stamp_ns, click.u, click.v
        asked: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        with self._lock:
            self._asked[key].append(asked)
        try:
            for wait_s in _TRIES_S:
                heard = self._aircraft[click.aircraft].click(*key[1:])
                done, _ = await asyncio.wait([asked], timeout=wait_s)
                if done:
                    answer = asked.result()
                    return answer.reason.value if isinstance(answer, Refusal) else answer
        finally:
            with self._lock:
                self._asked[key].remove(asked)
                if not self._asked[key]:
                    del self._asked[key]
        lacks = "did not answer within a second: press again" if heard else "does not run"
        return f"the overlay program {lacks}"

    def answered(self, aircraft: str, answer: Answer) -> None:
        """Pass an answer to whoever clicked there."""
        with self._lock:
            for asked in self._asked.get((aircraft, answer.stamp_ns, *answer.uv), ()):
                asked.get_loop().call_soon_threadsafe(_settle, asked, answer)

    async def where(self, aircraft: str, latitude_deg: float, longitude_deg: float) -> Pixel | str:
        """Return where a place is in the newest picture, or why it isn't there."""
        place = math.radians(latitude_deg), math.radians(longitude_deg)
        pixel = await asyncio.to_thread(self._aircraft[aircraft].where, *place)
        return pixel if isinstance(pixel, str) else Pixel(*pixel)

    async def record(self, aircraft: str, on: bool) -> str:
        """Begin or end a recording; return words for the operator."""
        work = self._recordings.begin if on else self._recordings.end
        words = await asyncio.to_thread(work, aircraft)
        return words + await self._kept(f"record {aircraft}", self._recordings.is_on(aircraft))

    async def share(self, on: bool) -> str:
        """Begin or end to send Cursor-on-Target; return words for the operator."""
        if self._cot is None:
            return "there is nowhere to send to: set the parameter cot of viewer_node"
        return self._cot.share(on) + await self._kept("share", on)

    async def _kept(self, what: str, on: bool) -> str:
        """Remember what is on, for the next run if this one is killed; return why it can't be."""
        try:
            await asyncio.to_thread(self._targets.switch, what, on)
        except TargetError as error:
            return f"; after a crash this is forgotten: {error}"
        return ""

    def vector_map(self, aircraft: str) -> bytes:  # noqa: ARG002  one map for all
        """Return the map as GeoJSON in WGS84; empty without one."""
        return self._map.read()


def _settle(asked: asyncio.Future[Answer], answer: Answer) -> None:
    if not asked.done():
        asked.set_result(answer)
