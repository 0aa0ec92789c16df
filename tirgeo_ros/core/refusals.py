"""Noticing that a filter refuses a source for so long that the filter must be wrong itself."""

from __future__ import annotations

from tirgeo_ros.core.samples import Outcome, Source, Verdict

_LONGEST_NS = 2_000_000_000
_LEAST_NUMBER = 5


class RefusalWatch:
    """Follows each source's refusals by the gate; one that is used ends them."""

    def __init__(self) -> None:
        self._since: dict[Source, tuple[int, int]] = {}  # first stamp, number

    def hopeless(self, verdict: Verdict, stamp_ns: int) -> bool:
        """Whether nothing but refusals has come from the verdict's source for two seconds."""
        if verdict.outcome is Outcome.USED:
            self._since.pop(verdict.source, None)
        if verdict.outcome is not Outcome.GATED:
            return False
        first_ns, number = self._since.get(verdict.source, (stamp_ns, 0))
        self._since[verdict.source] = (first_ns, number + 1)
        return number + 1 >= _LEAST_NUMBER and stamp_ns - first_ns >= _LONGEST_NS
