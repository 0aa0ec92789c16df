"""Serve the operator's page: video, clicks, targets, map and checks, for any tablet."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.config.schema import config_from, parameters_of, values_of
from tirgeo_ros.core.config.viewer_parameters import split_namespaces
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.errors import ConfigError, shown
from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings
from tirgeo_ros.io.files.child_process import parent_ended
from tirgeo_ros.io.files.whole_files import read_text
from tirgeo_ros.io.messages import DiagnosticItem
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.io.video.live_stream import stream_url
from tirgeo_ros.nodes.aircraft_topics import terrain_of
from tirgeo_ros.nodes.aircraft_view import AircraftView
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.map_watch import PageMap
from tirgeo_ros.nodes.monitor import OK, WARN
from tirgeo_ros.nodes.page_backend import PageBackend, TeamLink
from tirgeo_ros.nodes.recordings import ChildNode, Recordings, ground_values
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.page.routes import invitation
from tirgeo_ros.page.server import PageServer

_RETRY_S = 5.0
_REPORT_S, _LOOK_S, _WATCH_S = 0.2, 0.1, 1.0
_SECRET_BYTES = 1000
#: A stamp that is older, or of the future, is of another clock: a bag's, a camera's own.
_SAME_CLOCK_NS = 60_000_000_000


class PageStreams:
    """Run a video_writer for each aircraft, the first at the given port.

    ``troubles`` says of each aircraft why its stream ended. Raises VideoError for an address that
    is none.
    """

    def __init__(
        self, node: GraphNode, config: ViewerConfig, namespaces: Mapping[str, str]
    ) -> None:
        self.troubles: dict[str, str] = {}
        self._node, self._config, self._namespaces = node, config, namespaces
        if config.stream:
            stream_url(config.stream)
        self._children: dict[str, ChildNode] = {}
        self._retry_s = 0.0

    def end(self) -> None:
        """End all."""
        for child in self._children.values():
            child.end()

    def watch(self) -> None:
        """Start each stream that does not run; call it each second, in a thread that lasts."""
        if not self._config.stream or time.monotonic() < self._retry_s:
            return
        for number, (name, namespace) in enumerate(self._namespaces.items()):
            fault = self._children[name].fault if name in self._children else ""
            if fault:
                self.troubles[name] = fault
                self._node.log(WARN, f"the stream begins again: {fault}")
                self._retry_s = time.monotonic() + _RETRY_S
            if fault or name not in self._children:
                parts = urlsplit(self._config.stream)
                port = f"{parts.netloc.rpartition(':')[0]}:{(parts.port or 0) + number}"
                values = {"stream": parts._replace(netloc=port).geturl(), "platform": name}
                values |= ground_values(self._config)
                self._children[name] = ChildNode(self._node, "video_writer", values, namespace)


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
        self._targets = TargetStore(Path(config.targets))  # last: another may not be right
        self._lost = lost_clicks(self._targets.lost_clicks)
        self._backend = PageBackend(
            self._aircraft, self._targets, self._map, self._recordings, self._team.link
        )
        titles = {name: name or "aircraft" for name in names}
        self._server = PageServer(self._backend, config, titles)
        self._revision, self._drawn = -1, list[Target]()
        self.resources = self._serve()
        self._timers = [
            # One each: what cannot be read of one aircraft takes nothing from the others.
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
            for what in self._targets.switched_on():  # when the last run was killed
                kind, _, aircraft = what.partition(" ")
                if kind == "share":
                    self._team.go_on()
                else:
                    self._recordings.go_on(aircraft)
            self._invite()
            yield
            if not parent_ended():  # stopped, not killed: nothing is to go on
                for what in self._targets.switched_on():
                    self._targets.switch(what, on=False)

    def _invite(self) -> None:
        """Say where the page is, on stdout alone: tokens go into no ROS log.

        Where other computers reach it there is a code to scan.
        """
        operators, viewers = self._server.operator_url, self._server.viewer_url
        if viewers:
            sys.stdout.write(f"\n{invitation(operators)}\n\nviewers: {viewers}\n")
        sys.stdout.write(f"the page is at {operators}\n")
        sys.stdout.flush()

    def _show(self, aircraft: str, stamp_ns: int, jpeg: bytes) -> None:
        self._server.show(aircraft, stamp_ns, jpeg, taken_ns(stamp_ns, time.time_ns()))

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
        """Publish the targets where they have changed, and tell pages and team."""
        revision = self._targets.revision
        if revision != self._revision:
            self._drawn = self._targets.all()
            message = self.messages.targets(self._drawn)
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
    """Return a picture's time by this computer's clock: now if the stamp is of another."""
    return stamp_ns if 0 <= now_ns - stamp_ns < _SAME_CLOCK_NS else now_ns


def with_secrets(config: ViewerConfig) -> ViewerConfig:
    """Return the configuration with the secrets that are in files; raise ConfigError."""
    values: dict[str, Any] = {**values_of(config)}
    for name, default in ((p.name, p.default) for p in parameters_of(ViewerConfig) if p.secret):
        path = values[f"{name}_file"]
        if path and values[name] != default:
            raise ConfigError(f"parameter {name}_file: {name} is given too: leave one out")
        if path:
            values[name] = read_text(path, ConfigError, _SECRET_BYTES).rstrip("\r\n")
            if not values[name].isprintable() or not values[name]:
                raise ConfigError(f"parameter {name}_file: {path}: write one line of text into it")
    return config_from(ViewerConfig, values)


def lost_clicks(numbers: Sequence[int]) -> list[Finding]:
    """Return a finding if the file has lost clicks of targets, which are named by ``numbers``."""
    evidence = f"their file has lost clicks of targets {shown(', '.join(map(str, numbers)), 60)}"
    mend = "look at their places, which are of what is left, and click them again"
    finding = Finding("targets", Severity.CAUTION, evidence, "viewer_node targets", mend)
    return [finding] if numbers else []


main = partial(run, "viewer_node", ViewerNode)
