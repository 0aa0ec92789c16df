"""A flight's samples through DJI's serial protocol and dji_node's own code, without a port."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.dji.clocks.aircraft_clock import AircraftClock
from tirgeo_ros.dji.interpret import Interpreter
from tirgeo_ros.dji.link.framing import FrameReader
from tirgeo_ros.dji.protocol.subscription import PackageTable
from tirgeo_ros.dji.simulator import frames_of
from tirgeo_ros.dji.sources.serial import Clocks, Telemetry

BYTE_NS = 10 * 1_000_000_000 // 921_600


class Line:
    """A wire that takes its time and a reader that takes his: he never sees a byte too early."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._free_ns = self._read_ns = 0

    def read_ns(self, sent_ns: int, length: int) -> int:
        """When the last byte of a frame is read: half a millisecond late, at times 20."""
        self._free_ns = max(self._free_ns, sent_ns) + length * BYTE_NS
        late_ns = self._rng.exponential(0.5e6) + 20e6 * (self._rng.random() < 0.01)
        self._read_ns = max(self._read_ns, self._free_ns + round(late_ns))
        return self._read_ns


def heard(aircraft, arrivals, dji, seed=7):
    """The samples that dji_node makes of an aircraft's bytes, and its interpreter.

    ``arrivals``: what the aircraft is told, with arrival times; ``dji``: dji_node's parameters.
    """
    clocks = Clocks(
        AircraftClock(dji.clock), AircraftClock(dji.clock), AircraftClock(dji.clock, 2_500_000)
    )
    reader, line = FrameReader(), Line(seed)
    telemetry = Telemetry(clocks, PackageTable())
    interpreter = Interpreter(dji)
    samples = []
    for sent_ns, data in frames_of(aircraft, arrivals):
        read_ns = line.read_ns(sent_ns, len(data))
        for frame in reader.feed(data):
            for reading in telemetry.read(frame, read_ns):
                samples += interpreter.take(reading)
    return samples + interpreter.flush(), interpreter
