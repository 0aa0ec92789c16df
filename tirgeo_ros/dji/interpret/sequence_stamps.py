"""The stamps of one stream of samples."""

from __future__ import annotations

#: Readings of one instant that came on two roads; also what their clocks' jitter leaves.
_SAME_NS = 20_000_000


class Sequence:
    """Makes each stamp later than the one before where that changes next to nothing.

    A stamp up to 20 ms behind is put 1 ns after the newest. One further behind is another clock
    and passes as it is: whoever uses the samples judges that.
    """

    def __init__(self) -> None:
        self._newest_ns: int | None = None

    def after(self, stamp_ns: int) -> int:
        """The stamp to give a sample of ``stamp_ns``."""
        newest_ns = self._newest_ns
        if newest_ns is not None and 0 <= newest_ns - stamp_ns <= _SAME_NS:
            stamp_ns = newest_ns + 1
        self._newest_ns = stamp_ns
        return stamp_ns
