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
"""Read the aircraft: its serial link or psdk_ros2's topics in; the graph's input topics out.

Two topics of psdk_ros2 need its own message package, psdk_interfaces, and are used only if it is
installed. The other topics have standard types.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.validate_topic_name import validate_topic_name

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.dji.interpret.interpreter import Interpreter
from tirgeo_ros.dji.link.serial_link import LinkWatch, SerialLink, Totals
from tirgeo_ros.dji.protocol.subscription import PackageTable, package_table
from tirgeo_ros.dji.sources.psdk import PSDK_TOPICS, PsdkDecoder
from tirgeo_ros.dji.sources.readings import Reading
from tirgeo_ros.dji.sources.serial import SerialDecoder
from tirgeo_ros.io.messages import DJI_TOPICS, DiagnosticItem, sensed, stamp_ns
from tirgeo_ros.io.messages.topics import STREAM_DEPTH
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.nodes.graph_node import GraphNode, message_class, output, sensor_input
from tirgeo_ros.nodes.monitor import OK, SILENT_S, WARN
from tirgeo_ros.nodes.runner import run

#: Longest wait for bytes (s), so the period at which a silent link is checked.
_WAIT_S = 0.02
#: Period (s) of the check for RTK values that wait for their flags.
_DUE_S = 0.01
#: Topic whose message type may not be installed -> what is missing without it.
_LOST = {"rtk_yaw": "no rtk/heading", "gps_details": "no accuracy and no kind of fix on gps/fix"}
#: Without these topics no map can be drawn on the picture.
_NEEDED = ("imu", "rtk_position", "rtk_position_info", "gimbal_angles")
_INSTALL = (
    "{lost}, as psdk_interfaces is not installed here: source the workspace that psdk_ros2 was "
    "built in, or build its package psdk_interfaces, and start again"
)
_SILENT = (
    "nothing comes from psdk_ros2 on {prefix}*: is its node running and active (it is a lifecycle "
    "node), and is psdk_prefix right?"
)
_Take = Callable[[list[Reading]], None]


class SerialSource:
    """Read one port and decode its bytes."""

    def __init__(self, node: GraphNode, config: DjiConfig, take: _Take) -> None:
        """Raise DjiError for a key or a table of packages that cannot be used."""
        self._node = node
        self._turn = node.guarded("serial link", self._read)
        self._take = take
        file = config.packages
        packages = package_table(load_yaml(file), file) if file else PackageTable()
        self._decoder = SerialDecoder(config, packages)
        self._link = SerialLink(config.port, config.baud)
        self._watch = LinkWatch(config.port, config.baud, has_key=bool(config.key.strip()))
        self._openings = 0
        self._lock = threading.Lock()  # the diagnostics read what the reading thread changes

    def serve(self, stop: threading.Event) -> None:
        """Read until ``stop`` is set. Neither cable faults nor wrong bytes end the loop."""
        with closing(self._link):
            while not stop.is_set():
                if not self._turn():
                    stop.wait(_WAIT_S)

    def _read(self) -> None:
        data = self._link.read(_WAIT_S)
        arrival_ns = self._node.now_ns
        now_s = time.monotonic()
        readings: list[Reading] = []
        decoder = self._decoder
        with self._lock:
            if self._link.openings != self._openings:
                self._openings = self._link.openings
                readings += decoder.rescan(arrival_ns)
            readings += decoder.take(data, arrival_ns, now_s, round(self._link.gathered_s * 1e9))
            counts = decoder.frames.counts
            totals = Totals(now_s, counts["bytes"], counts["frames"], decoder.locked)
            report = self._watch.look(self._link.state, self._link.message, totals)
        self._take(readings)
        if report is not None:
            self._node.log(min(report.level, WARN), report.message)

    def findings(self) -> list[Finding]:
        """Return a finding while the link brings no data, or only unreadable data."""
        with self._lock:
            report = self._watch.report
        if report is None or not report.level:
            return []
        remedy = "check the aircraft, the cable, and the parameters port, baud and key"
        return [Finding("serial_link", Severity.CAUTION, report.message, "dji_node port", remedy)]

    def report(self) -> DiagnosticItem:
        """Return the diagnostic item of the link: its state and counts of its traffic."""
        with self._lock:
            report = self._watch.report
            values = self._decoder.diagnostics
        if report is None:
            return self._node.item("link", values, "not opened yet", WARN)
        state = {"state": report.condition, "openings": str(self._openings)}
        return self._node.item("link", state | values, report.message, int(report.level))


class PsdkSource:
    """Subscribe to psdk_ros2 and pass the readings of its messages to ``take``."""

    def __init__(self, node: GraphNode, config: DjiConfig, take: _Take) -> None:
        """Raise ConfigError for a prefix that is no valid topic name."""
        self._node, self._take = node, take
        self._decoder = PsdkDecoder()
        self._prefix = _checked(config.psdk_prefix)
        self._received_s = time.monotonic()
        self._logged: list[str] = []
        missing = [topic for topic in _LOST if not _is_installed(PSDK_TOPICS[topic][0])]
        self._lost = _INSTALL.format(lost=", ".join(_LOST[t] for t in missing)) if missing else ""
        for topic, (typename, _) in PSDK_TOPICS.items():
            if topic not in missing:
                handle = partial(self.handle, topic)
                node.listen(self._prefix + topic, handle, sensor_input(), typename)
        for topic in _NEEDED:
            node.monitor.expects(self._prefix + topic)
        self._timer = node.steady_timer("waiting for flags", _DUE_S, self._due)
        self._log_changes()

    @staticmethod
    def serve(stop: threading.Event) -> None:
        """Wait until ``stop`` is set: the node's executor does the work."""
        stop.wait()

    def findings(self) -> list[Finding]:
        """Return a finding while topics of psdk_ros2 are silent or cannot be read."""
        evidence = "; ".join(self._logged)
        remedy = "check that psdk_ros2's node runs and psdk_interfaces is installed"
        finding = Finding("psdk_ros2", Severity.NOTE, evidence, "dji_node psdk_prefix", remedy)
        return [finding] if evidence else []

    def report(self) -> DiagnosticItem:
        """Log any change of the warnings, and return the source's diagnostic item."""
        warnings = self._log_changes()
        values = {name: str(number) for name, number in self._decoder.counts.items()}
        level, message = (WARN, "; ".join(warnings)) if warnings else (OK, "ok")
        return self._node.item("psdk", values, message, level)

    def handle(self, topic: str, message: Any) -> None:
        """Handle a message of psdk_ros2; ``topic`` is its name without the prefix."""
        self._received_s = time.monotonic()
        arrival_ns = self._node.now_ns
        sent_ns = 0 if topic.endswith("_info") else stamp_ns(message)  # flags have no header
        self._take(self._decoder.take(topic, message, sent_ns, arrival_ns))

    def _due(self) -> None:
        self._take(self._decoder.due(self._node.now_ns))

    def _log_changes(self) -> list[str]:
        """Return the current warnings; log each when it begins and when it is over."""
        silent = time.monotonic() - self._received_s > SILENT_S
        warnings = [_SILENT.format(prefix=self._prefix)] if silent else []
        warnings += [self._lost] if self._lost else []
        for text in warnings:
            if text not in self._logged:
                self._node.log(WARN, text)
        for text in self._logged:
            if text not in warnings:
                self._node.log(OK, f"no longer: {text}")
        self._logged = warnings
        return warnings


def _is_installed(typename: str) -> bool:
    try:
        message_class(typename)
    except ConfigError:
        return False
    return True


def _checked(prefix: str) -> str:
    """Return the prefix with its slash; raise ConfigError if no topic name can begin so."""
    topics = f"{prefix.rstrip('/')}/" if prefix else ""
    try:
        validate_topic_name(f"{topics}imu")
    except InvalidTopicNameException:
        raise ConfigError(
            f"psdk_prefix: {prefix!r} is not a valid prefix of topic names: write e.g. psdk_ros2"
        ) from None
    return topics


class DjiNode(GraphNode):
    """Connect one source of readings, one Interpreter and the aircraft's topics."""

    def __init__(self) -> None:
        super().__init__("dji_node")
        config = self.configured(DjiConfig, self._reconfigure)
        self._interpreter = Interpreter(config)
        self._topics = {t: self.advertise(t, output(STREAM_DEPTH)) for t in DJI_TOPICS}
        self._lock = threading.Lock()  # the port is read in a thread beside the executor
        self._warned: set[str] = set()
        source = SerialSource if config.source == "serial" else PsdkSource
        self._source = source(self, config, self._take)
        self.report_each_second(self._items, self._findings_of_aircraft)

    def serve(self, stop: threading.Event) -> int:
        """Read the source until ``stop`` is set; return the exit code."""
        self._source.serve(stop)
        return 0

    def _reconfigure(self, config: DjiConfig) -> None:
        with self._lock:
            self._interpreter.configure(config)

    def _take(self, readings: list[Reading]) -> None:
        with self._lock:
            for reading in readings:
                for sample in self._interpreter.take(reading):
                    topic, message = sensed(self.messages, sample)
                    self._topics[topic].publish(message)
                    self.monitor.published(topic, 1e-9 * (self.now_ns - sample.stamp_ns))

    def _findings_of_aircraft(self) -> list[Finding]:
        with self._lock:
            warnings = "; ".join(self._interpreter.warnings)
        remedy = "check dji_node's parameters and the aircraft's settings"
        own = Finding("aircraft_data", Severity.NOTE, warnings, "dji_node", remedy)
        return [*self._source.findings(), *([own] if warnings else [])]

    def _items(self) -> list[DiagnosticItem]:
        with self._lock:
            warnings = list(self._interpreter.warnings)
            counts = {name: str(n) for name, n in self._interpreter.counts.items()}
            values = self._interpreter.diagnostics | counts
        for warning in warnings:
            if warning not in self._warned:
                self._warned.add(warning)
                self.log(WARN, warning)
        level, message = (WARN, "; ".join(warnings)) if warnings else (OK, "ok")
        return [self._source.report(), self.item("aircraft", values, message, level)]


main = partial(run, "dji_node", DjiNode, DjiNode.serve)
