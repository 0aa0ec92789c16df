"""Keep the stamps of one stream of samples in increasing order."""

from __future__ import annotations

#: Largest difference of readings of one instant from two sources; also covers their clocks'
#: jitter.
_SAME_NS = 20_000_000


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
