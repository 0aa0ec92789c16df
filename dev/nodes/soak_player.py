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
"""Play a flight whose end meets its start, round after round, for ``make soak``.

Stamps and /clock go on from one round to the next. SIGUSR1 makes the clock jump: all stamps are
then later or earlier by one of ``JUMPS_S``. Each stretch between two jumps is an epoch; stamps of
the flight are whole milliseconds, and the nanoseconds below say the epoch's number. So what comes
out of the graph tells which epoch it is from.

The ledger, a text file that outlives a ``kill -9``, has a line for each epoch (``epoch NUMBER
SHIFT_NS``) and each frame sent (``frame STAMP_NS TIME_S``, by the steady clock).
"""

from __future__ import annotations

import os
import signal
import threading
import time
from functools import partial
from itertools import count, cycle
from pathlib import Path

from dev.flights import stamped
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.nodes.bag_player import PlayClock, await_readers, publishers_for
from tirgeo_ros.nodes.graph_node import GraphNode, output
from tirgeo_ros.nodes.runner import run

#: What the clock jumps by, in turn.
JUMPS_S = (-20, 300, -400, 40)
FRAMES = "/thermal/image_raw/compressed"
_MS = 1_000_000


class SoakPlayer(GraphNode):
    """One flight in memory, its publishers, its clock and its ledger."""

    def __init__(self) -> None:
        super().__init__("soak_player")
        parameter = self.declare_parameter
        self._rate = parameter("rate", 2.0).value
        self._period_ns = round(parameter("period_s", 0.0).value * 1e9)
        self._epoch = parameter("first_epoch", 0).value
        self._wait_for = parameter("wait_for", "").value
        ledger = parameter("ledger", "").value
        self._ledger = os.open(ledger, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        reader = BagReader(Path(parameter("bag", "").value))
        self._start_ns = reader.span_ns[0]
        self._flight = [
            (item.log_time_ns, item.topic, bytearray(item.data))
            for item in reader.messages()
            if item.log_time_ns < self._start_ns + self._period_ns
        ]
        self._check()
        self._topics = publishers_for(self, reader.topics(), "")
        self._ticks = self.advertise("/clock", output())
        self._base_ms = parameter("shift_ms", 0).value
        self._jumps = cycle(JUMPS_S)
        self._jump_asked = threading.Event()
        signal.signal(signal.SIGUSR1, lambda *_: self._jump_asked.set())

    def _check(self) -> None:
        odd = [topic for _, topic, data in self._flight if header_stamp_ns(bytes(data)) % _MS]
        if odd or not self._flight:
            raise BagError(f"no flight for a soak: stamps of {odd[:1]} are no whole milliseconds")

    @property
    def _shift_ns(self) -> int:
        return int(self._base_ms * _MS + self._epoch)

    def play(self, stop: threading.Event) -> int:
        """Wait for subscribers, then play until stopped; the exit code."""
        await_readers(self, self._topics.values(), self._wait_for, 60.0, stop)
        self.get_logger().info("playing")
        self._note(f"epoch {self._epoch} {self._shift_ns}")
        clock = PlayClock(self._rate, self._tick)
        for rounds in count():
            flown_ns = rounds * self._period_ns
            for due_ns, topic, data in self._flight:
                if not clock.wait_until(due_ns + flown_ns, stop):
                    return 0
                self._send(topic, data, flown_ns)
        return 0

    def _send(self, topic: str, data: bytearray, flown_ns: int) -> None:
        if self._jump_asked.is_set():
            self._jump()
        original_ns = header_stamp_ns(bytes(data[:12]))
        stamp_ns = original_ns + flown_ns + self._shift_ns
        if topic == FRAMES:
            self._note(f"frame {stamp_ns} {time.monotonic():.6f}")
        self._topics[topic].publish(stamped(data, stamp_ns))

    def _jump(self) -> None:
        self._jump_asked.clear()
        self._base_ms += 1000 * next(self._jumps)
        self._epoch += 1
        self._note(f"epoch {self._epoch} {self._shift_ns}")

    def _tick(self, flown_ns: int) -> None:
        self._ticks.publish(self.messages.clock(flown_ns + self._shift_ns))

    def _note(self, line: str) -> None:
        os.write(self._ledger, f"{line}\n".encode())


main = partial(run, "soak_player", SoakPlayer, SoakPlayer.play)
