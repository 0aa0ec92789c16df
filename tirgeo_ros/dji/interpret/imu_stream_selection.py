"""Select which of several IMU streams is used; keep the stamps of a stream in order."""

from __future__ import annotations

from tirgeo_ros.dji.sources.readings import ImuOrigin

#: A stream counts as silent after this time: five samples of the slowest (50 Hz), half of the gap
#: that the filter bridges.
_SILENT_NS = 100_000_000
#: A better stream is selected once it has been there for this time without such a silence.
_STEADY_NS = 100_000_000
#: A stamp that goes back further comes from another clock: the earlier stamps are no longer valid.
_CLOCK_NS = 1_000_000_000
#: Largest difference of readings of one instant from two sources; also covers their clocks'
#: jitter.
_SAME_NS = 20_000_000

_RANK = {origin: rank for rank, origin in enumerate(ImuOrigin)}


class DrivingStream:
    """Select one stream: the best that is present."""

    def __init__(self) -> None:
        self.driver: ImuOrigin | None = None
        self.handovers = 0
        self._newest_ns = 0
        self._better: ImuOrigin | None = None
        self._better_since_ns = self._better_newest_ns = 0

    def drives(self, origin: ImuOrigin, stamp_ns: int) -> bool:
        """Return whether a reading of this stream is to be used."""
        if origin is not self.driver and not self._takes_over(origin, stamp_ns):
            return False
        self._newest_ns = stamp_ns
        return True

    def _takes_over(self, origin: ImuOrigin, stamp_ns: int) -> bool:
        if self.driver is None:
            self.driver = origin
            return True
        silent = not -_CLOCK_NS < stamp_ns - self._newest_ns <= _SILENT_NS
        if not (silent or self._is_steadily_better(self.driver, origin, stamp_ns)):
            return False
        self.driver, self._better = origin, None
        self.handovers += 1
        return True

    def _is_steadily_better(self, driver: ImuOrigin, origin: ImuOrigin, stamp_ns: int) -> bool:
        if _RANK[origin] >= _RANK[driver]:
            return False
        newest_ns = self._better_newest_ns
        if origin is not self._better or not 0 <= stamp_ns - newest_ns <= _SILENT_NS:
            self._better, self._better_since_ns = origin, stamp_ns
        self._better_newest_ns = stamp_ns
        return stamp_ns - self._better_since_ns >= _STEADY_NS


class Sequence:
    """Make each stamp later than the one before, where the change is negligible.

    A stamp up to 20 ms behind is moved to 1 ns after the newest. One further behind comes from
    another clock and passes unchanged: the user of the samples judges it.
    """

    def __init__(self) -> None:
        self._newest_ns: int | None = None

    def after(self, stamp_ns: int) -> int:
        """Return the stamp to use for a sample of ``stamp_ns``."""
        newest_ns = self._newest_ns
        if newest_ns is not None and 0 <= newest_ns - stamp_ns <= _SAME_NS:
            stamp_ns = newest_ns + 1
        self._newest_ns = stamp_ns
        return stamp_ns
