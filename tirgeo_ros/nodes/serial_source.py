"""Read the aircraft's serial port as dji_node's source, and report its state."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from rclpy.node import Node

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.dji.link.link_watch import LinkLevel, LinkReport, LinkWatch
from tirgeo_ros.dji.link.serial_link import LinkState, SerialLink
from tirgeo_ros.dji.protocol.package_table import package_table
from tirgeo_ros.dji.protocol.subscription import PackageTable
from tirgeo_ros.dji.sources.readings import Reading
from tirgeo_ros.dji.sources.serial import SerialDecoder
from tirgeo_ros.io.messages import DiagnosticItem
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.nodes.callbacks import guarded
from tirgeo_ros.nodes.diagnostics import item_name
from tirgeo_ros.nodes.monitor import Monitor

#: Longest wait for bytes (s), so the period at which a silent link is checked.
_WAIT_S = 0.02


class SerialSource:
    """Read one port, decode its bytes, and send the host's requests."""

    def __init__(
        self,
        node: Node,
        config: DjiConfig,
        take: Callable[[list[Reading]], None],
        monitor: Monitor,
    ) -> None:
        """Raise DjiError for a key or a table of packages that cannot be used."""
        self._node = node
        self._turn = guarded(node, monitor, "serial link", self._read)
        self._take = take
        packages = PackageTable()
        if config.packages:
            packages = package_table(load_yaml(config.packages), config.packages)
        self._road = SerialDecoder(config, packages)
        self._link = SerialLink(config.port, config.baud)
        self._watch = LinkWatch(config.port, config.baud, has_key=bool(config.key.strip()))
        self._openings = 0
        self._lock = threading.Lock()  # the diagnostics read what the reading thread changes
        self._host_message = ""

    def serve(self, stop: threading.Event) -> None:
        """Read until ``stop`` is set. No cable fault and no received data ends the loop."""
        try:
            while not stop.is_set():
                if not self._turn():
                    stop.wait(_WAIT_S)
        finally:
            self._link.close()

    def _read(self) -> None:
        data = self._link.read(_WAIT_S)
        arrival_ns = self._node.get_clock().now().nanoseconds
        now_s = time.monotonic()
        readings: list[Reading] = []
        with self._lock:
            if self._link.openings != self._openings:
                self._openings = self._link.openings
                readings += self._road.reopened(arrival_ns, now_s)
            readings += self._road.take(
                data, arrival_ns, now_s, round(self._link.gathered_s * 1e9)
            )
            # On a closed port a request would only count as unanswered.
            is_open = self._link.state is LinkState.OPEN
            to_send = self._road.host.due(now_s) if is_open else b""
            road = self._road
            counts = road.counts["bytes"], road.counts["frames"], road.locked
            report = self._watch.look(now_s, self._link.state, self._link.message, *counts)
        if to_send:
            self._link.write(to_send)
        self._take(readings)
        self._log_changes(report)

    def _log_changes(self, report: LinkReport | None) -> None:
        """Log each change of the link's state and of the host's message once."""
        if report is not None:
            # Two separate calls: rclpy allows only one severity per line of code.
            if report.level is LinkLevel.OK:
                self._node.get_logger().info(shown(report.message))
            else:
                self._node.get_logger().warning(shown(report.message))
        if self._road.host.message != self._host_message:
            self._host_message = self._road.host.message
            self._node.get_logger().info(shown(self._host_message))

    def items(self) -> list[DiagnosticItem]:
        """Return the diagnostic item of the link: its state and counts of its traffic."""
        with self._lock:
            report = self._watch.report
            values = self._road.diagnostics
        name = item_name(self._node, "link")
        if report is None:
            return [DiagnosticItem(name, int(LinkLevel.WARN), "not opened yet", values)]
        state = {
            "state": report.condition,
            "state_time_s": f"{time.monotonic() - report.since_s:.1f}",
            "bytes_per_s": f"{report.bytes_per_s:.0f}",
            "frames_per_s": f"{report.frames_per_s:.1f}",
            "openings": str(self._openings),
        }
        return [DiagnosticItem(name, int(report.level), report.message, state | values)]
