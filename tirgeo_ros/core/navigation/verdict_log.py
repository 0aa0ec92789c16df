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
from tirgeo_ros.core.navigation.filter_status import Unused, unused
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

_WINDOW_NS = 30_000_000_000
#: Cap on the NIS of one measurement, so that a refused one does not dominate the mean.
_NIS_CAP = 25.0
#: A mean of fewer values is not reported.
_LEAST_VALUES = 20
#: A mean NIS above this gives a warning: innovations of twice their sigma.
_NIS_WARNING = 4.0


class _Window:
    """Hold the NIS of one source over the last 30 s."""

    def __init__(self) -> None:
        self._values: deque[tuple[int, float]] = deque()
        self._sum = 0.0

    def add(self, stamp_ns: int, nis: float) -> None:
        """Add a value; drop the old ones, and all of them where the clock went back."""
        values = self._values
        if values and stamp_ns < values[-1][0]:
            values.clear()
            self._sum = 0.0
        nis = min(nis, _NIS_CAP)
        values.append((stamp_ns, nis))
        self._sum += nis
        while values[0][0] < stamp_ns - _WINDOW_NS:
            self._sum -= values.popleft()[1]

    def mean(self, now_ns: int) -> float:
        """Return the mean; nan where there are too few values or the newest is old."""
        values = self._values
        if len(values) < _LEAST_VALUES or now_ns - values[-1][0] > _WINDOW_NS:
            return math.nan
        return max(self._sum, 0.0) / len(values)


class VerdictLog:
    """Record every verdict but that on an IMU sample that was used, and give it to ``heard``."""

    def __init__(self, heard: Callable[[Verdict], None] | None = None) -> None:
        self.counts: Counter[tuple[Source, Outcome]] = Counter()
        self.test_ratios: dict[Source, float] = {}
        self.unused: dict[Source, Unused] = {}
        self._windows: dict[Source, _Window] = {}
        self._heard = heard

    def begin(self) -> None:
        """Forget what belongs to the former state."""
        self.unused = {}
        self._windows = {}

    def add(self, verdict: Verdict, now_ns: int) -> None:
        """Take a verdict that was given at ``now_ns``."""
        source = verdict.source
        self.counts[source, verdict.outcome] += 1
        if not math.isnan(verdict.test_ratio):
            self.test_ratios[source] = verdict.test_ratio
        if not math.isnan(verdict.nis):
            self._windows.setdefault(source, _Window()).add(now_ns, verdict.nis)
        found = unused(verdict, now_ns)
        if found is not None:
            self.unused[source] = found
        if self._heard is not None:
            self._heard(verdict)

    def nis(self, now_ns: int) -> dict[str, float]:
        """Return the mean NIS over degrees of freedom by source, where there are enough values."""
        means = {source.value: window.mean(now_ns) for source, window in self._windows.items()}
        return {name: mean for name, mean in means.items() if not math.isnan(mean)}

    def warnings(self, now_ns: int) -> Iterator[str]:
        """Yield a warning for each source whose NIS is too high, with the parameters to check."""
        for source, aid in AIDS.items():
            window = self._windows.get(source)
            mean = math.nan if window is None else window.mean(now_ns)
            if mean > _NIS_WARNING and aid.look_at:
                times = f"{math.sqrt(mean):.1f} times their sigma over 30 s"
                yield (
                    f"{source.topic}: innovations are {times}: "
                    f"look at {aid.look_at} and at its covariances (tirgeo calibrate aircraft)"
                )
