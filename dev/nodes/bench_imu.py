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
"""Send an IMU and receivers without end, for ``python -m dev.bench.imu_load``.

Each IMU sample is sent at its stamp. At the end stamps and times of sending (ns), and the number
of IMU samples of which the filter reports a verdict, are written as JSON to the file of the
parameter ``output``.
"""

from __future__ import annotations

import dataclasses
import json
import threading
import time
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from dev.flights import LoopedFlight
from tirgeo_ros.core.types.measurements import ImuSample, NavigationInput, Source
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, STATE_TOPIC, node_state, sensed
from tirgeo_ros.io.messages.topics import STREAM_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, output
from tirgeo_ros.nodes.runner import run

_LAST_REPORT_S = 3.0  # the filter reports each second
_MEETING_S = 0.5


class ImuSource(GraphNode):
    """Send one minute of hover, again and again, as soon as the filter listens."""

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
        self._counted = 0
        self.listen(STATE_TOPIC, self._count, output())

    def _count(self, message: Any) -> None:
        status = node_state(message).navigation
        if status is not None:
            self._counted = sum(n for (source, _), n in status.counts.items() if source == "imu")

    def play(self, stop: threading.Event) -> int:
        """Send samples for ``duration_s``, then write what was sent."""
        while not (self._outputs[Source.IMU].is_wanted or stop.wait(_MEETING_S)):
            pass
        samples = chain.from_iterable(self._flight.minutes())
        first_ns = next(samples).stamp_ns
        shift_ns = time.time_ns() - first_ns
        last_ns = first_ns + round(self._duration_s * 1e9)
        for sample in samples:
            if sample.stamp_ns > last_ns or stop.is_set():
                break
            self._send(dataclasses.replace(sample, stamp_ns=sample.stamp_ns + shift_ns))
        stop.wait(_LAST_REPORT_S)
        found = {"sent": self._sent, "counted": self._counted}
        Path(self._output).write_text(json.dumps(found))
        return 0

    def _send(self, sample: NavigationInput) -> None:
        """Send an IMU sample when it is due, any other one right after that before it."""
        _, message = sensed(self.messages, sample)
        if isinstance(sample, ImuSample):
            time.sleep(max(sample.stamp_ns - time.time_ns(), 0) * 1e-9)
            self._sent.append((sample.stamp_ns, time.time_ns()))
        self._outputs[sample.source].publish(message)


main = partial(run, "bench_imu", ImuSource, ImuSource.play)
