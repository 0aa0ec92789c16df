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
"""Serve the operator's page: video, clicks, targets, map and checks, for any tablet."""

from __future__ import annotations

import asyncio
import math
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.config.schema import config_from, parameters_of, values_of
from tirgeo_ros.core.config.viewer_parameters import split_namespaces
from tirgeo_ros.core.ground.frame_geometry import frame_geometry
from tirgeo_ros.core.ground.ground_point import (
    Answer,
    Located,
    Refusal,
    circular_error_90,
    linear_error_90,
)
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.errors import ConfigError, TargetError, shown
from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings
from tirgeo_ros.core.types.missing_package import missing_line
from tirgeo_ros.io.coordinates.crs import has_mgrs
from tirgeo_ros.io.files.child_process import parent_ended
from tirgeo_ros.io.files.whole_files import read_text
from tirgeo_ros.io.messages import DiagnosticItem, body_pose
from tirgeo_ros.io.messages.json_codec import targets_text
from tirgeo_ros.io.targets.cot_events import AircraftState
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.nodes.aircraft_topics import ODOMETRY, terrain_of
from tirgeo_ros.nodes.aircraft_view import AircraftView, velocity_n
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.map_watch import PageMap
from tirgeo_ros.nodes.monitor import OK, WARN
from tirgeo_ros.nodes.recordings import PageStreams, Recordings
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.page.actions import Click, Pixel
from tirgeo_ros.page.routes import invitation
from tirgeo_ros.page.server import PageServer

if TYPE_CHECKING:
    from tirgeo_ros.page.cot.link import CotLink

_REPORT_S, _LOOK_S, _WATCH_S = 0.2, 0.1, 1.0
_SECRET_BYTES = 1000
#: A stamp that is older, or in the future, is from another clock: a bag's or a camera's.
_SAME_CLOCK_NS = 60_000_000_000
#: An older position (s) is not sent to the team, which has it already.
_NEW_S = 2.0
#: Waits for the answer to a click. After the first wait the click is sent once more: overlay_node
#: subscribes best effort, to fit any publisher, so a click may be lost on its way.
_TRIES_S = (0.35, 0.65)

_Key = tuple[str, int, float, float]  # aircraft, stamp, column, row


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
            try:
                from tirgeo_ros.page.cot.link import CotLink  # noqa: PLC0415  PyTAK is an extra

                self.link = CotLink(config, partial(node.log, OK))
            except ModuleNotFoundError as error:
                evidence = f"nothing is sent to the team: {missing_line(str(error.name))}"
                node.log(WARN, evidence)
                self._find(evidence, "install it, then start again")

    def go_on(self) -> None:
        """Share again, as before the last run was killed; without a link, report that it ended."""
        if self.link is not None:
            self.link.share(True)
        elif not self.findings:
            end = "sharing has ended: it was on when viewer_node was killed; cot is not set now"
            self._find(end, "set cot to the address that it had, and start again")

    def _find(self, evidence: str, mend: str) -> None:
        self.findings = [Finding("sharing", Severity.CAUTION, evidence, "viewer_node cot", mend)]

    @property
    def state(self) -> dict[str, Any] | None:
        """Return what the page shows; None without a link."""
        return None if self.link is None else asdict(self.link.status)

    def send(self) -> None:
        """Send the state of each aircraft as it is now; call each second."""
        if self.link is None or not self.link.status.on:
            return
        for name, view in self._aircraft.items():
            state = aircraft_state(name or "aircraft", view)
            if state is not None:
                self.link.aircraft(name, state)


def aircraft_state(name: str, aircraft: AircraftView) -> AircraftState | None:
    """Return an aircraft's state for the team; None without a recent position."""
    odometry, plane, age_s = aircraft.newest(ODOMETRY), aircraft.plane, aircraft.age_s(ODOMETRY)
    if odometry is None or plane is None or age_s is None or age_s > _NEW_S:
        return None
    pose, v_n = body_pose(odometry), velocity_n(odometry)
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(pose.position_n))
    sight = aircraft.sight(aircraft.newest_ns)
    return AircraftState(
        name,
        math.degrees(latitude),
        math.degrees(longitude),
        height_m,
        circular_error_90(pose.covariance[:3, :3]),
        linear_error_90(pose.covariance[:3, :3]),
        math.degrees(math.atan2(v_n[1], v_n[0])) % 360,
        math.hypot(v_n[0], v_n[1]),
        frame_geometry(sight, aircraft.confidence) if sight else None,
    )


class PageBackend:
    """Serve as the page's ``Backend``. The thread of the node calls ``answered``."""

    def __init__(
        self,
        aircraft: Mapping[str, AircraftView],
        targets: TargetStore,
        page_map: PageMap,
        recordings: Recordings,
        cot: CotLink | None,
    ) -> None:
        self._aircraft, self.targets, self._map = aircraft, targets, page_map
        self._recordings, self._cot = recordings, cot
        self._lock = threading.Lock()
        self._waiting: defaultdict[_Key, list[asyncio.Future[Answer]]] = defaultdict(list)

    async def click(self, click: Click) -> Located | str:
        """Return the ground point at a pixel, or why there is none; within a second."""
        key = click.aircraft, click.stamp_ns, click.u, click.v
        future: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        with self._lock:
            self._waiting[key].append(future)
        try:
            for wait_s in _TRIES_S:
                has_subscriber = self._aircraft[click.aircraft].click(*key[1:])
                done, _ = await asyncio.wait([future], timeout=wait_s)
                if done:
                    answer = future.result()
                    return answer.reason.value if isinstance(answer, Refusal) else answer
        finally:
            with self._lock:
                self._waiting[key].remove(future)
                if not self._waiting[key]:
                    del self._waiting[key]
        late = "did not answer within a second: press again"
        return f"the overlay program {late if has_subscriber else 'does not run'}"

    def answered(self, aircraft: str, answer: Answer) -> None:
        """Pass an answer to whoever clicked there."""
        with self._lock:
            for future in self._waiting.get((aircraft, answer.stamp_ns, *answer.uv), ()):
                future.get_loop().call_soon_threadsafe(_settle, future, answer)

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
            return "no address to send to: set the parameter cot of viewer_node"
        return self._cot.share(on) + await self._kept("share", on)

    async def _kept(self, what: str, on: bool) -> str:
        """Save what is on, for the next run if this one is killed; return why that failed."""
        try:
            await asyncio.to_thread(self.targets.switch, what, on)
        except TargetError as error:
            return f"; after a crash it will not go on: {error}"
        return ""

    def vector_map(self, aircraft: str) -> bytes:  # noqa: ARG002  one map for all
        """Return the map as GeoJSON in WGS84; empty without one."""
        return self._map.read()


def _settle(future: asyncio.Future[Answer], answer: Answer) -> None:
    if not future.done():
        future.set_result(answer)


class ViewerNode(GraphNode):
    """Connect the page's server with the graphs of one aircraft or several."""

    def __init__(self) -> None:
        super().__init__("viewer_node")
        config = self._config = with_secrets(self.configured(ViewerConfig))
        if bool(config.certificate) != bool(config.key):
            absent = "key" if config.certificate else "certificate"
            raise ConfigError(f"parameter {absent}: https needs both certificate and key: set it")
        names = split_namespaces(config.namespaces) or [""]
        terrain = terrain_of(config)
        self._aircraft = {
            name: AircraftView(
                self, name, terrain, partial(self._show, name), partial(self._answered, name)
            )
            for name in names
        }
        namespaces = {name: view.namespace for name, view in self._aircraft.items()}
        self._recordings = Recordings(self, config, namespaces)
        self._streams = PageStreams(self, config, namespaces)
        self._team = TeamLink(self, config, self._aircraft)
        self._map = PageMap(self, config.map)
        self._targets = TargetStore(Path(config.targets))  # last: others may be wrong
        self._lost = lost_clicks(self._targets.lost_clicks)
        if not has_mgrs():
            self.log(OK, f"no MGRS coordinates: {missing_line('mgrs')}")
        self._backend = PageBackend(
            self._aircraft, self._targets, self._map, self._recordings, self._team.link
        )
        titles = {name: name or "aircraft" for name in names}
        self._server = PageServer(self._backend, config, titles)
        self._revision, self._drawn = -1, list[Target]()
        self.resources = self._serve()
        self._timers = [
            # One each: bad data of one aircraft must not stop the others.
            *(self.steady_timer(f"state {n}", _REPORT_S, partial(self._report, n)) for n in names),
            self.steady_timer("targets", _LOOK_S, self._draw_targets),
            self.steady_timer("recordings", _WATCH_S, self._watch),
        ]
        self.report_each_second(self._items, self._all_findings)

    @contextmanager
    def _serve(self) -> Iterator[None]:
        with ExitStack() as ends:
            ends.callback(self._targets.close)
            ends.callback(self._map.stop)
            ends.callback(self._recordings.end_all)
            self._server.start()
            ends.callback(self._server.stop)
            if self._team.link is not None:
                self._team.link.start()
                ends.callback(self._team.link.stop)
            ends.callback(self._streams.end)
            for what in self._targets.switched_on():  # on when the last run was killed
                kind, _, aircraft = what.partition(" ")
                if kind == "share":
                    self._team.go_on()
                else:
                    self._recordings.go_on(aircraft)
            self._invite()
            yield
            if not parent_ended():  # stopped, not killed: the next run resumes nothing
                for what in self._targets.switched_on():
                    self._targets.switch(what, on=False)

    def _invite(self) -> None:
        """Print the page's address and a code to scan, on stdout: tokens go into no ROS log."""
        operators, viewers = self._server.operator_url, self._server.viewer_url
        if viewers:
            sys.stdout.write(f"\n{invitation(operators)}\n\nviewers: {viewers}\n")
        sys.stdout.write(f"the page is at {operators}\n")
        sys.stdout.flush()

    def _show(self, aircraft: str, stamp_ns: int, jpeg: bytes, shapes: bytes) -> None:
        begun_ns = taken_ns(stamp_ns, time.time_ns())
        self._server.show(aircraft, stamp_ns, jpeg, begun_ns, shapes)

    def _answered(self, aircraft: str, answer: Any) -> None:
        self._backend.answered(aircraft, answer)

    def _report(self, aircraft: str) -> None:
        state = self._aircraft[aircraft].state(self._findings_of(aircraft))
        state["recording"], state["sharing"] = self._recordings.is_on(aircraft), self._team.state
        self._server.report(aircraft, state)

    def _findings_of(self, aircraft: str) -> list[Finding]:
        return [*self._recordings.findings(aircraft), *self._team.findings, *self._lost]

    def _all_findings(self) -> list[Finding]:
        names = self._aircraft
        return sorted_findings(finding for name in names for finding in self._findings_of(name))

    def _draw_targets(self) -> None:
        """Publish the targets if they have changed, and send them to pages and team."""
        revision = self._targets.revision
        if revision != self._revision:
            self._drawn = self._targets.all()
            message = self.messages.text(targets_text(self._drawn))
            for view in self._aircraft.values():
                view.targets.publish(message)
            self._server.targets_changed()
            if self._team.link is not None:
                self._team.link.targets(self._targets.for_others())
            self._revision = revision
        for view in self._aircraft.values():
            view.mark(self._drawn, revision)

    def _watch(self) -> None:
        self._recordings.watch()
        self._streams.watch()
        self._team.send()

    def _items(self) -> list[DiagnosticItem]:
        values = {"targets": str(len(self._drawn)), "listen": self._config.listen}
        values |= {name: str(count) for name, count in self._server.counts.items()}
        values |= {f"stream {name}": trouble for name, trouble in self._streams.troubles.items()}
        values |= {finding.check: shown(finding.line) for finding in self._all_findings()}
        trouble = self._map.error or next(iter(self._streams.troubles.values()), "")
        return [self.item("page", values, trouble or "ok", WARN if trouble else OK)]


def taken_ns(stamp_ns: int, now_ns: int) -> int:
    """Return a picture's time by this computer's clock: now if the stamp is of another one."""
    return stamp_ns if 0 <= now_ns - stamp_ns < _SAME_CLOCK_NS else now_ns


def with_secrets(config: ViewerConfig) -> ViewerConfig:
    """Return the configuration with the secrets read from their files; raise ConfigError."""
    values: dict[str, Any] = {**values_of(config)}
    for name, default in ((p.name, p.default) for p in parameters_of(ViewerConfig) if p.secret):
        path = values[f"{name}_file"]
        if path and values[name] != default:
            raise ConfigError(f"parameter {name}_file: {name} is set too: leave one out")
        if path:
            values[name] = read_text(path, ConfigError, _SECRET_BYTES).rstrip("\r\n")
            if not values[name].isprintable() or not values[name]:
                raise ConfigError(f"parameter {name}_file: {path}: write one line of text into it")
    return config_from(ViewerConfig, values)


def lost_clicks(numbers: Sequence[int]) -> list[Finding]:
    """Return a finding if the file has lost clicks of targets, which are named by ``numbers``."""
    evidence = f"the file has lost clicks of targets {shown(', '.join(map(str, numbers)), 60)}"
    mend = "check their places, computed from the clicks left, and click them again"
    finding = Finding("targets", Severity.CAUTION, evidence, "viewer_node targets", mend)
    return [finding] if numbers else []


main = partial(run, "viewer_node", ViewerNode)
