"""Measure how long the IMU has been silent, by the time stamps of its aids.

An aid's clock may differ from the IMU's, so only the advance of its stamps counts.
"""

from __future__ import annotations

from tirgeo_ros.core.types.measurements import Source

#: Fewer aiding samples than this without an IMU sample may have arrived in one burst.
_LEAST_AIDS = 5
#: Longest silence assumed before the first aid; a larger difference is an offset of the clocks.
_LONGEST_LEAD_NS = 500_000_000


class ImuSilence:
    """Measure the silence from each aiding sample; each IMU sample ends it."""

    def __init__(self) -> None:
        self._aids = 0
        self._begun: dict[Source, tuple[int, int]] = {}  # first stamp, its lead over the IMU
        self._length_ns = 0

    @property
    def length_ns(self) -> int:
        """Return the time since the newest IMU sample; 0 while few aids have arrived since."""
        return self._length_ns if self._aids >= _LEAST_AIDS else 0

    def end(self) -> None:
        """Note an IMU sample."""
        if self._aids:
            self._aids = self._length_ns = 0
            self._begun.clear()

    def hear(self, source: Source, stamp_ns: int, imu_ns: int | None) -> None:
        """Note an aiding sample; ``imu_ns`` is the newest stamp of the IMU."""
        self._aids += 1
        begun = self._begun.get(source)
        if begun is None:
            lead_ns = 0 if imu_ns is None else min(max(stamp_ns - imu_ns, 0), _LONGEST_LEAD_NS)
            begun = self._begun[source] = stamp_ns, lead_ns
        self._length_ns = max(self._length_ns, stamp_ns - begun[0] + begun[1])
