"""Read the aircraft's serial port as dji_node's source, and report its state."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.dji.link.link_watch import LinkWatch
from tirgeo_ros.dji.link.serial_link import LinkState, SerialLink
from tirgeo_ros.dji.protocol.package_table import package_table
from tirgeo_ros.dji.protocol.subscription import PackageTable
from tirgeo_ros.dji.sources.readings import Reading
from tirgeo_ros.dji.sources.serial import SerialDecoder
from tirgeo_ros.io.messages import DiagnosticItem
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.monitor import OK, WARN

#: Longest wait for bytes (s), so the period at which a silent link is checked.
_WAIT_S = 0.02


class SerialSource:
    """Read one port, decode its bytes, and send the host's requests."""

    def __init__(
        self, node: GraphNode, config: DjiConfig, take: Callable[[list[Reading]], None]
    ) -> None:
        """Raise DjiError for a key or a table of packages that cannot be used."""
        self._node = node
        self._turn = node.guarded("serial link", self._read)
        self._take = take
        packages = PackageTable()
        if config.packages:
            packages = package_table(load_yaml(config.packages), config.packages)
        self._decoder = SerialDecoder(config, packages)
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
        arrival_ns = self._node.now_ns
        now_s = time.monotonic()
        readings: list[Reading] = []
        decoder = self._decoder
        with self._lock:
            if self._link.openings != self._openings:
                self._openings = self._link.openings
                readings += decoder.reopened(arrival_ns, now_s)
            readings += decoder.take(data, arrival_ns, now_s, round(self._link.gathered_s * 1e9))
            # On a closed port a request would only count as unanswered.
            is_open = self._link.state is LinkState.OPEN
            to_send = decoder.host.due(now_s) if is_open else b""
            counts = decoder.counts["bytes"], decoder.counts["frames"], decoder.locked
            report = self._watch.look(now_s, self._link.state, self._link.message, *counts)
        if to_send:
            self._link.write(to_send)
        self._take(readings)
        if report is not None:
            self._node.log(min(report.level, WARN), report.message)
        if decoder.host.message != self._host_message:
            self._host_message = decoder.host.message
            self._node.log(OK, self._host_message)

    def item(self) -> DiagnosticItem:
        """Return the diagnostic item of the link: its state and counts of its traffic."""
        with self._lock:
            report = self._watch.report
            values = self._decoder.diagnostics
        if report is None:
            return self._node.item("link", values, "not opened yet", WARN)
        state = {
            "state": report.condition,
            "state_time_s": f"{time.monotonic() - report.since_s:.1f}",
            "bytes_per_s": f"{report.bytes_per_s:.0f}",
            "frames_per_s": f"{report.frames_per_s:.1f}",
            "openings": str(self._openings),
        }
        return self._node.item("link", state | values, report.message, int(report.level))
