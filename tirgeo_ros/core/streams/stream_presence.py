"""Detect when a stream of samples has become steady and when it has fallen silent."""

from __future__ import annotations

#: A stream is steady after this many samples over at least this time.
_SAMPLES = 5
_STEADY_NS = 2_000_000_000
#: A steady stream is gone after this silence. Before that, a gap of this length or a step back of
#: the stamps restarts the count.
_SILENT_NS = 2_000_000_000


class StreamPresence:
    """Track whether one stream is steady, from its stamps and those of another stream."""

    def __init__(self) -> None:
        self.steady = False
        self._first_ns = 0
        self._newest_ns = 0
        self._count = 0

    def heard(self, stamp_ns: int) -> bool:
        """Take a sample's stamp (ns); return True if the stream becomes steady with it."""
        if self._count and not 0 <= stamp_ns - self._newest_ns < _SILENT_NS:
            self._count = 0
        if self._count == 0:
            self._first_ns = stamp_ns
        self._newest_ns = stamp_ns
        self._count += 1
        long_enough = self._count >= _SAMPLES and stamp_ns - self._first_ns >= _STEADY_NS
        became = long_enough and not self.steady
        self.steady = self.steady or long_enough
        return became

    def gone(self, now_ns: int) -> bool:
        """Take a stamp (ns) of another stream; return True if this one has just fallen silent.

        A clock that was set back does not count as silence.
        """
        if not self.steady or now_ns - self._newest_ns < _SILENT_NS:
            return False
        self.steady = False
        self._count = 0
        return True
