"""Read the aircraft: its serial link or psdk_ros2's topics in; the graph's input topics out."""

from __future__ import annotations

import threading
from functools import partial

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.dji.interpret import Interpreter
from tirgeo_ros.dji.sources.readings import Reading
from tirgeo_ros.io.messages import DJI_TOPICS, DiagnosticItem, SensedSample, sensed
from tirgeo_ros.nodes.dji_sources import PsdkSource, SerialSource
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.monitor import OK, WARN
from tirgeo_ros.nodes.qos import STREAM_DEPTH, output
from tirgeo_ros.nodes.runner import run


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
                    self._publish(sample)

    def _publish(self, sample: SensedSample) -> None:
        topic, message = sensed(self.messages, sample)
        self._topics[topic].publish(message)
        self.monitor.published(topic, 1e-9 * (self.now_ns - sample.stamp_ns))

    def _findings_of_aircraft(self) -> list[Finding]:
        with self._lock:
            warnings = "; ".join(self._interpreter.warnings)
        remedy = "look at its parameters and at the aircraft's settings"
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
        return [self._source.item(), self.item("aircraft", values, message, level)]


main = partial(run, "dji_node", DjiNode, DjiNode.serve)
