"""Whether a stream of samples is there: steadily, until it has been silent."""

from __future__ import annotations

#: A stream is steady after so many samples over so long.
_SAMPLES = 5
_STEADY_NS = 2_000_000_000
#: It is gone after so long; a longer gap on the way to steady begins anew.
_SILENT_NS = 2_000_000_000


class Presence:
    """Watches the stamps of one stream against those of the others."""

    def __init__(self) -> None:
        self.steady = False
        self._first_ns = 0
        self._newest_ns = 0
        self._count = 0

    def heard(self, stamp_ns: int) -> bool:
        """Take a sample's stamp; True where the stream becomes steady with it."""
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
        """Take the stamp of another stream; True where this one ends by its silence.

        A clock that was set back says nothing of silence.
        """
        if not self.steady or now_ns - self._newest_ns < _SILENT_NS:
            return False
        self.steady = False
        self._count = 0
        return True
