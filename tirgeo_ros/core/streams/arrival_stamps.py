"""Stamp samples that have no time stamp with the time of their arrival.

The latency from measurement to arrival, where it is known, is a parameter. The estimator subtracts
that of a receiver (``rtk.delay_s``, ``gps.delay_s``); that of the pictures is ``video_latency_s``.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TypeVar

from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample, NavigationInput

S = TypeVar("S", bound=NavigationInput | JointSample | CameraAttitudeSample)


class Arrivals:
    """Stamp samples without a time stamp, and count them by topic."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of samples without a stamp by topic."""
        return dict(self._counts)

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the counts as key and value strings for diagnostics."""
        return {f"stamped_at_arrival.{topic}": str(n) for topic, n in self._counts.items()}

    def stamped(self, topic: str, sample: S, arrival_ns: int) -> S:
        """Return the sample; if its stamp is 0, a copy stamped with the time of arrival."""
        stamp_ns = self.stamp_ns(topic, sample.stamp_ns, arrival_ns)
        return sample if stamp_ns == sample.stamp_ns else replace(sample, stamp_ns=stamp_ns)

    def stamp_ns(self, topic: str, stamp_ns: int, arrival_ns: int) -> int:
        """Return the stamp; if it is 0, count it and return the time of arrival."""
        if stamp_ns != 0:
            return stamp_ns
        self._counts[topic] += 1
        return arrival_ns
