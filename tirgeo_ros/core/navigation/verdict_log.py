"""Count the verdicts; keep the newest test ratios, the NIS of 30 s, and reasons of disuse.

The mean normalised innovation squared (NIS) over its degrees of freedom is 1 for measurements
whose noise, place and time are as the parameters and messages say (Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4).
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Iterator

from tirgeo_ros.core.navigation.aiding.aids import AIDS
from tirgeo_ros.core.navigation.filter_status import Unused, disuse
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

_WINDOW_NS = 30_000_000_000
#: Cap on the NIS of one measurement, so that a refused one does not dominate the mean.
_NIS_CAP = 25.0
#: A mean of fewer values is not reported.
_LEAST_VALUES = 20
#: A mean NIS above this gives a warning: innovations of twice their sigma.
_NIS_WARNING = 4.0


class VerdictLog:
    """Record every verdict but that on an IMU sample that was used, and give it to ``heard``."""

    def __init__(self, heard: Callable[[Verdict], None] | None = None) -> None:
        self.counts: Counter[tuple[Source, Outcome]] = Counter()
        self.test_ratios: dict[Source, float] = {}
        self.unused: dict[Source, Unused] = {}
        self._nis: dict[Source, deque[tuple[int, float]]] = {}  # stamp and value, 30 s of each
        self._heard = heard

    def begin(self) -> None:
        """Forget what belongs to the former state."""
        self.unused = {}
        self._nis = {}

    def add(self, verdict: Verdict, now_ns: int) -> None:
        """Take a verdict that was given at ``now_ns``."""
        source = verdict.source
        self.counts[source, verdict.outcome] += 1
        if not math.isnan(verdict.test_ratio):
            self.test_ratios[source] = verdict.test_ratio
        if not math.isnan(verdict.nis):
            values = self._nis.setdefault(source, deque())
            if values and now_ns < values[-1][0]:  # the clock went back
                values.clear()
            values.append((now_ns, min(verdict.nis, _NIS_CAP)))
            while values[0][0] < now_ns - _WINDOW_NS:
                values.popleft()
        why = disuse(verdict)
        if why:
            self.unused[source] = now_ns, why
        if self._heard is not None:
            self._heard(verdict)

    def nis(self, now_ns: int) -> dict[str, float]:
        """Return the mean NIS over degrees of freedom by source, where there are enough values."""
        return {
            source.value: sum(nis for _, nis in values) / len(values)
            for source, values in self._nis.items()
            if len(values) >= _LEAST_VALUES and now_ns - values[-1][0] <= _WINDOW_NS
        }

    def warnings(self, now_ns: int) -> Iterator[str]:
        """Yield a warning for each source whose NIS is too high, with the parameters to check."""
        means = self.nis(now_ns)
        for source, aid in AIDS.items():
            mean = means.get(source.value, 0.0)
            if mean > _NIS_WARNING and aid.look_at:
                times = f"{math.sqrt(mean):.1f} times their sigma over 30 s"
                yield (
                    f"{source.topic}: innovations are {times}: "
                    f"look at {aid.look_at} and at its covariances (tirgeo calibrate aircraft)"
                )
