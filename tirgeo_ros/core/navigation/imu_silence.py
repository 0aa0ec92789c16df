"""How long the IMU has been silent, told by what its aids stamp meanwhile.

An aid's clock may be off from the IMU's: what counts is by how much its stamps go on.
"""

from __future__ import annotations

from tirgeo_ros.core.types.measurements import Source

#: So many aiding samples without one of the IMU: what is fewer came in one burst.
_LEAST_AIDS = 5
#: What passed before the first aid is as long at the most; more is an offset of the clocks.
_LONGEST_LEAD_NS = 500_000_000


class ImuSilence:
    """Hears of each aid, and of the end of a silence with each sample of the IMU."""

    def __init__(self) -> None:
        self._aids = 0
        self._begun: dict[Source, tuple[int, int]] = {}  # first stamp, and the IMU's lead to it
        self._length_ns = 0

    @property
    def length_ns(self) -> int:
        """Time since the newest IMU sample; 0 while few aids have come since."""
        return self._length_ns if self._aids >= _LEAST_AIDS else 0

    def end(self) -> None:
        """The IMU has spoken."""
        if self._aids:
            self._aids = self._length_ns = 0
            self._begun.clear()

    def hear(self, source: Source, stamp_ns: int, imu_ns: int | None) -> None:
        """An aid has; ``imu_ns`` is the newest stamp of the IMU."""
        self._aids += 1
        begun = self._begun.get(source)
        if begun is None:
            lead_ns = 0 if imu_ns is None else min(max(stamp_ns - imu_ns, 0), _LONGEST_LEAD_NS)
            begun = self._begun[source] = stamp_ns, lead_ns
        self._length_ns = max(self._length_ns, stamp_ns - begun[0] + begun[1])
