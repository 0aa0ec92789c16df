"""Process the serial link's bytes without the port: bytes in, readings and bytes to send out."""

from __future__ import annotations

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.dji.clocks.aircraft_clock import AircraftClock
from tirgeo_ros.dji.clocks.running_counter import LONG_TICK_NS
from tirgeo_ros.dji.host.session import HostSession
from tirgeo_ros.dji.link.encryption import parse_key
from tirgeo_ros.dji.link.framing import PLAIN, FrameReader, ProtocolFrame
from tirgeo_ros.dji.protocol.subscription import PackageTable
from tirgeo_ros.dji.sources.readings import Reading
from tirgeo_ros.dji.sources.serial_readings import PUSH_SET, Clocks, Telemetry

#: Longer than a frame can pause on its way (1023 bytes at 230400 baud take 44 ms).
_PAUSE_S = 0.05
_BITS_A_BYTE = 10  # with start and stop


class SerialDecoder:
    """Convert the link's bytes to readings; ``host.due`` returns what is to be sent."""

    def __init__(self, config: DjiConfig, packages: PackageTable) -> None:
        """Build the parsers; raise DjiError for an invalid key."""
        key = parse_key(config.key)
        self._frames = FrameReader(key)
        broadcast, subscription = AircraftClock(config.clock), AircraftClock(config.clock)
        hard_sync = AircraftClock(config.clock, LONG_TICK_NS)
        clocks = broadcast, subscription, hard_sync
        names = "broadcast", "subscription", "hard sync"
        self._clocks = dict(zip(names, clocks, strict=True))
        self._telemetry = Telemetry(Clocks(*clocks), packages)
        self.host = HostSession(config.host, packages, key)
        self._heard_s: float | None = None
        self.locked = 0  # frames that were encrypted and not, or not rightly, decrypted
        self._byte_ns = round(_BITS_A_BYTE * 1e9 / config.baud)

    def take(
        self, data: bytes, arrival_ns: int, now_s: float, gathered_ns: int = 0
    ) -> list[Reading]:
        """Return the readings of these bytes, which were read at ``arrival_ns``.

        ``now_s`` is a monotonic clock's. The first of the bytes was there ``gathered_ns`` before.
        Those behind it come no faster than the line's rate, which gives each frame its own time of
        completion.

        Call it without bytes as well, now and then: a frame whose rest does not come is given up
        after a pause.
        """
        if data:
            self._heard_s = now_s
            first_ns = arrival_ns - gathered_ns - self.counts["bytes"] * self._byte_ns
            frames = self._frames.feed(data)
            ends = [first_ns + (f.offset + f.length) * self._byte_ns for f in frames]
            arrivals = [min(end_ns, arrival_ns) for end_ns in ends]
        elif self._heard_s is not None and now_s - self._heard_s > _PAUSE_S:
            self._heard_s = None
            frames = self._frames.rescan()
            arrivals = [arrival_ns] * len(frames)
        else:
            return []
        return self._read(frames, arrivals, now_s)

    def reopened(self, arrival_ns: int, now_s: float) -> list[Reading]:
        """Handle a port that was opened again: drop a cut frame, restart the host's session."""
        self._heard_s = None
        frames = self._frames.rescan()
        readings = self._read(frames, [arrival_ns] * len(frames), now_s)
        self.host.restart()
        return readings

    def _read(
        self, frames: list[ProtocolFrame], arrivals: list[int], now_s: float
    ) -> list[Reading]:
        readings = []
        for frame, arrival_ns in zip(frames, arrivals, strict=True):
            self.locked += _is_locked(frame)
            self.host.take(frame, now_s)
            readings += self._telemetry.read(frame, arrival_ns)
        return readings

    @property
    def counts(self) -> dict[str, int]:
        """Return how many bytes and frames came, and of which kinds (``FrameReader.counts``)."""
        return self._frames.counts

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return counts of frames, clocks that run, and the host session's state."""
        found = {f"frames {name}": str(n) for name, n in self._frames.counts.items()}
        found |= {f"telemetry {name}": str(n) for name, n in self._telemetry.counts.items()}
        for name, clock in self._clocks.items():
            found |= {f"{name} {key}": value for key, value in clock.diagnostics.items()}
        return found | self.host.diagnostics


def _is_locked(frame: ProtocolFrame) -> bool:
    """Return whether a frame's data is encrypted, or makes no sense after decryption.

    Decrypted data makes sense if it is a push: that is what an aircraft sends.
    """
    opened = frame.encryption != PLAIN and not frame.is_ack
    return frame.is_encrypted or (opened and frame.cmd_set != PUSH_SET)
