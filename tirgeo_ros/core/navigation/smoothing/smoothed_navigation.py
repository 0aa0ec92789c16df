"""Run the estimator over a flight twice: to record it, and to publish it smoothed.

The second run is the filter again, with its verdicts, states and plane; only the solutions are
replaced. So whatever takes the filter's poses takes the smoothed ones unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.ins.ins_error_model import states_of
from tirgeo_ros.core.navigation.smoothing.backward_pass import SmoothedRun
from tirgeo_ros.core.navigation.timeline.epochs import FlightRecord
from tirgeo_ros.core.types.measurements import NavigationInput
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import Verdict


class RecordingNavigation(Navigation):
    """Run the filter, and record each of its runs; it begins a new one from each alignment."""

    def __init__(self, config: EkfConfig) -> None:
        self._records: list[FlightRecord] = []
        super().__init__(config)

    def smoothed(self) -> list[SmoothedRun]:
        """Return the runs, smoothed, once all samples have been processed; only once."""
        self._end_run()
        records, self._records = self._records, []
        return [SmoothedRun(self._config, record) for record in records if record.kinds]

    def _begin(self, *args: Any, **kwargs: Any) -> None:
        self._end_run()
        super()._begin(*args, **kwargs)
        self._records.append(FlightRecord(states_of(self._config)))
        self._start_up.record = self._records[-1]

    def _end_run(self) -> None:
        if self._ekf is not None:
            self._ekf.finish()


class SmoothedNavigation(Navigation):
    """Run the filter over the samples that were recorded, and publish the smoothed solutions."""

    def __init__(
        self,
        config: EkfConfig,
        runs: Sequence[SmoothedRun],
        heard: Callable[[Verdict], None] | None = None,
    ) -> None:
        self._runs = runs
        self._run = -1
        super().__init__(config, heard)

    def _align(self, sample: NavigationInput) -> None:
        super()._align(sample)
        self._run += self._ekf is not None

    def _due_solution(self, stamp_ns: int) -> NavSolution | None:
        solution = super()._due_solution(stamp_ns)
        if solution is not None:
            solution = self._newest = self._runs[self._run].at(solution.stamp_ns)
        return solution


def smoothed(config: EkfConfig, samples: Iterable[NavigationInput]) -> SmoothedNavigation:
    """Return the estimator for a second run over samples, in order of their arrival."""
    first = RecordingNavigation(config)
    for sample in samples:
        first.process(sample)
    return SmoothedNavigation(config, first.smoothed())
