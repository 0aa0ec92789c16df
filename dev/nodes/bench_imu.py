"""Send an IMU and receivers without end, for ``python -m dev.bench.imu_load``.

Each IMU sample is sent at its stamp. At the end stamps and times of sending (ns) are written as
JSON to the file of the parameter ``output``.
"""

from __future__ import annotations

import dataclasses
import json
import threading
import time
from functools import partial
from itertools import chain
from pathlib import Path

from dev.flights import LoopedFlight
from tirgeo_ros.core.types.measurements import ImuSample, NavigationInput
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, sensed
from tirgeo_ros.io.messages.topics import STREAM_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, output
from tirgeo_ros.nodes.runner import run


class ImuSource(GraphNode):
    """Send one minute of hover, again and again."""

    def __init__(self) -> None:
        super().__init__("bench_imu")
        self._duration_s = self.declare_parameter("duration_s", 60.0).value
        self._output = self.declare_parameter("output", "").value
        self._flight = LoopedFlight(self.declare_parameter("rate_hz", 400.0).value)
        self._outputs = {
            source: self.advertise(NAVIGATION_INPUTS[source][0], output(STREAM_DEPTH))
            for source in NAVIGATION_INPUTS
        }
        self._sent: list[tuple[int, int]] = []

    def play(self, stop: threading.Event) -> int:
        """Send samples for ``duration_s``, then write what was sent."""
        samples = chain.from_iterable(self._flight.minutes())
        first_ns = next(samples).stamp_ns
        shift_ns = time.time_ns() - first_ns
        last_ns = first_ns + round(self._duration_s * 1e9)
        for sample in samples:
            if sample.stamp_ns > last_ns or stop.is_set():
                break
            self._send(dataclasses.replace(sample, stamp_ns=sample.stamp_ns + shift_ns))
        Path(self._output).write_text(json.dumps(self._sent))
        return 0

    def _send(self, sample: NavigationInput) -> None:
        """Send an IMU sample when it is due, any other one right after that before it."""
        _, message = sensed(self.messages, sample)
        if isinstance(sample, ImuSample):
            time.sleep(max(sample.stamp_ns - time.time_ns(), 0) * 1e-9)
            self._sent.append((sample.stamp_ns, time.time_ns()))
        self._outputs[sample.source].publish(message)


main = partial(run, "bench_imu", ImuSource, ImuSource.play)
