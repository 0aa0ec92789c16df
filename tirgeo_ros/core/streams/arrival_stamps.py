"""Samples whose source does not stamp them: they count as measured when they arrived.

The time from measurement to arrival, where it is known, is a parameter of the receiver
(``rtk.delay_s``, ``gps.delay_s``), which the estimator takes off; of the pictures, in
``video_latency_s``.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TypeVar

from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample, NavigationInput

S = TypeVar("S", bound=NavigationInput | JointSample | CameraAttitudeSample)


class Arrivals:
    """Stamps what has none, and counts it by topic."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    @property
    def counts(self) -> dict[str, int]:
        """How many samples of each topic had no stamp."""
        return dict(self._counts)

    @property
    def diagnostics(self) -> dict[str, str]:
        """The counts as values of a diagnostic."""
        return {f"stamped_at_arrival.{topic}": str(n) for topic, n in self._counts.items()}

    def stamped(self, topic: str, sample: S, arrival_ns: int) -> S:
        """The sample; where its stamp is 0, with the time of its arrival as its stamp."""
        stamp_ns = self.stamp_ns(topic, sample.stamp_ns, arrival_ns)
        return sample if stamp_ns == sample.stamp_ns else replace(sample, stamp_ns=stamp_ns)

    def stamp_ns(self, topic: str, stamp_ns: int, arrival_ns: int) -> int:
        """The stamp; where it is 0, the time of the arrival."""
        if stamp_ns != 0:
            return stamp_ns
        self._counts[topic] += 1
        return arrival_ns
