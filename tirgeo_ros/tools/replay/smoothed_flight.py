"""Smooth the filter's poses of a recorded flight: what ``--smooth`` adds to the verbs.

A first pass through the flight records the filter, which is then smoothed backwards in time. The
second pass does what a verb does without smoothing, with the smoothed poses.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.smoothing.backward_pass import SmoothedRun
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import RecordingNavigation
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import HeadingSample
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.flight_topics import METHOD_TOPICS
from tirgeo_ros.tools.replay.registration import Sample, navigated

_FILTERS = ("ekf", "ekf_heading")
#: Share of the work, roughly, that the first pass is.
_FIRST_SHARE = 0.4


class FlightFilter(NamedTuple):
    """Hold a filter of a flight: its parameters, and what is changed of its headings."""

    ekf: EkfConfig
    baseline_step_rad: float = 0.0

    @property
    def topics(self) -> tuple[str, ...]:
        """Return the topics that it uses."""
        return METHOD_TOPICS[self.ekf.method]

    def given(self, sample: Sample) -> Sample:
        """Return a sample as the filter gets it: with the antenna baseline turned by the step."""
        if not self.baseline_step_rad or not isinstance(sample, HeadingSample):
            return sample
        return replace(sample, heading_rad=sample.heading_rad - self.baseline_step_rad)


class FilterRecording:
    """Record a filter in the first pass, then smooth it.

    Raise ConfigError for a method without a filter.
    """

    def __init__(self, one: FlightFilter) -> None:
        if not can_smooth(one.ekf.method):
            method, choices = one.ekf.method, " or ".join(_FILTERS)
            raise ConfigError(
                f"method {method} has no filter to smooth: choose {choices}, or do not smooth"
            )
        self._filter = one
        self._navigation = RecordingNavigation(one.ekf)

    def take(self, sample: Sample) -> None:
        """Process a sample."""
        navigated(self._navigation, self._filter.given(sample))

    def smoothed(self) -> list[SmoothedRun]:
        """Return the filter's runs, smoothed, once the flight has been read."""
        return self._navigation.smoothed()


def can_smooth(method: str) -> bool:
    """Return whether a method's poses come from a filter."""
    return method in _FILTERS


def passes(progress: Report) -> tuple[Report, Report]:
    """Return the progress of the first and of the second pass, as parts of the whole."""
    return _part(progress, 0.0, _FIRST_SHARE), _part(progress, _FIRST_SHARE, 1.0)


def _part(progress: Report, begin: float, end: float) -> Report:
    def report(done: float, total: float | None) -> None:
        if total is not None:
            done = begin * total + (end - begin) * done
        progress(done, total)

    return report
